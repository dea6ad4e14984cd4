"""Detects from outside that a process has stalled.

JACK repeats the last period of a stalled client for ever (measured), which vibrates
without end. Nothing inside a stalled process can help; a process that is *disconnected*
from the server or *killed* is silent within some periods.

While the last period was silent, a stall does no harm and the timeout is long. While it
vibrated, the process counts as late after a short timeout, and is to be silenced; after
the long one it counts as stalled. Only checks that were themselves on time count: if
the whole machine stood still, so did the watchdog, and the client may be late for the
same reason.
"""

from enum import Enum

from tactophone.core.settings import ProcessSettings
from tactophone.live.telemetry.watcher import Pulse

CHECK_INTERVAL = 0.005
"""Seconds between two checks."""

SILENT_TIMEOUT = 2.0
"""Seconds without any sign of life after which a process counts as stalled; the much
shorter time for one that vibrates is the setting `stall_timeout`."""

HARMLESS = ("file", "none")
"""Actuators that nobody feels: they may stand still. Those of other packages count as
felt."""

LATE_PERIODS = 8
"""Periods for which a process that vibrates may be late. A busy machine is late by a
number of periods rather than by a time: 50 ms are 19 periods of 128 samples, but under
five of 512, and the watchdog ended processes that were only late. With the two periods
that the server takes to remove a client, silence comes within ten."""


class Verdict(Enum):
    """What a check found."""

    ALIVE = 0
    """Nothing is wrong, or it is known already."""
    LATE = 1
    """It shows no sign of life while it vibrates."""
    STALLED = 2
    """It has shown no sign of life for `SILENT_TIMEOUT`."""
    RESUMED = 3
    """It was late, and shows signs of life again."""


class Watchdog:
    """Decides from pulses whether a process is late or has stalled; it has no clock and
    no process of its own.

    ``late_after``: seconds that a process may show no sign of life while it vibrates.

    >>> watchdog = Watchdog(late_after=0.035)
    >>> pulse = Pulse(7, amplitude=0.5, beat=0.0)
    >>> found = [watchdog.check(pulse, now=0.005 * n) for n in range(500)]
    >>> found.index(Verdict.LATE), found.index(Verdict.STALLED)
    (8, 401)
    """

    def __init__(self, late_after: float = ProcessSettings().stall_timeout) -> None:
        self._late_after = late_after
        self._last: float | None = None
        self._callbacks = -1
        self._beat = 0.0
        self._without_callback = 0.0
        self._without_beat = 0.0
        self._reported = False

    def check(self, pulse: Pulse, *, now: float) -> Verdict:
        """Compare a pulse with the one before; reports `Verdict.LATE` once, then
        `Verdict.RESUMED` once, after which the process may be late again."""
        # A late check counts as two intervals at most: the time beyond was lost to the
        # machine, not to the process.
        passed = 0.0
        if self._last is not None:
            passed = min(now - self._last, 2 * CHECK_INTERVAL)
        self._last = now
        # Before its first callback a process has nothing to be late with.
        moved = pulse.callbacks != self._callbacks or pulse.callbacks == 0
        beats = pulse.beat != self._beat
        self._without_callback = 0.0 if moved else self._without_callback + passed
        self._without_beat = 0.0 if beats else self._without_beat + passed
        self._callbacks = pulse.callbacks
        self._beat = pulse.beat
        # A process that resumes after it was silenced may be late again, and is then
        # reported again.
        resumed = self._reported and moved
        self._reported &= not moved
        if self._without_beat > SILENT_TIMEOUT:
            return Verdict.STALLED
        if resumed:
            return Verdict.RESUMED
        if pulse.amplitude > 0.0 and not self._reported:
            late = max(self._late_after, LATE_PERIODS * max(0.0, pulse.period))
            self._reported = self._without_callback > late
            return Verdict.LATE if self._reported else Verdict.ALIVE
        # It was reported, and still vibrates: either nothing silenced it, or it is
        # stopped for good.
        vibrates = pulse.amplitude > 0.0
        silenced_in_vain = vibrates and self._without_callback > SILENT_TIMEOUT
        return Verdict.STALLED if silenced_in_vain else Verdict.ALIVE
