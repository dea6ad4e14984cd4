"""Ends a process whose sound has stalled, from outside.

JACK repeats the last period of a stalled client for ever (measured), so to the finger a stall is a buzz without end.
Nothing inside a stalled process can help; a process that is *killed* is silent within two periods.

While the last period was silent, a stall hurts nobody and the patience is long; while it vibrated, it is short. The
watchdog looks often, and counts only looks that were themselves on time: if the whole machine stood still, the
watchdog did too, and the client has the same right to a late start.
"""

from dataclasses import dataclass

from tactophone.telemetry import Pulse

LOOK_EVERY = 0.005
"""Seconds between two looks."""

PATIENCE = 2.0
"""Seconds without any sign of life, while silent, after which a process counts as stalled."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long a process may give no sign, in seconds: while it vibrates, and while it is silent.

    A device with long periods calls less often, so that at least two of them are waited for.
    """

    vibrating: float = 0.05
    silent: float = PATIENCE


class Watchdog:
    """Judges pulses; no clock, no process.

    Examples
    --------
    >>> watchdog = Watchdog(Patience(vibrating=0.035))
    >>> [watchdog.look(Pulse(7, amplitude=0.5, beat=0.0), now=0.005 * n) for n in range(9)].index(True)
    8
    """

    def __init__(self, patience: Patience) -> None:
        self._patience = patience
        self._last: float | None = None
        self._callbacks = -1
        self._beat = 0.0
        self._without_callback = self._without_beat = 0.0

    def look(self, pulse: Pulse, *, now: float) -> bool:
        """Take one look; true when the process should be ended."""
        passed = 0.0 if self._last is None else min(now - self._last, 2 * LOOK_EVERY)
        self._last = now
        moved = pulse.callbacks != self._callbacks or pulse.callbacks == 0
        self._without_callback = 0.0 if moved else self._without_callback + passed
        self._without_beat = 0.0 if pulse.beat != self._beat else self._without_beat + passed
        self._callbacks, self._beat = pulse.callbacks, pulse.beat
        vibrating = max(self._patience.vibrating, 2 * pulse.period) if pulse.period > 0 else self._patience.vibrating
        if pulse.amplitude > 0.0 and self._without_callback > vibrating:
            return True
        return self._without_beat > self._patience.silent
