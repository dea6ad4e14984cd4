"""The contact gate: detects the start and end of a touch within milliseconds, where a
window of 256 ms cannot.

A window still contains a touch 240 ms after the finger has lifted, and is only a
twentieth full when the finger has just landed. So the gate measures the level four
thousand times a second, beside the classifier. A clearly loud touch opens it by the
level over 4 ms; any other by the level over 32 ms, because motor noise and hum
sometimes rise 5 dB for 4 ms, but not for 32. The gate closes when the longer level has
fallen under the threshold.

A level cannot tell motors from touch: a moving robot raises it by 3 dB, and the gate
opens 2 dB over the floor. So sixteen bands decide, each over its own floor: motors
raise few of them, and little; a touch raises many. Their windows are longer, so the
level gate alone counts for the first 50 ms after it opens.

A robot that says when it starts and stops (`core.types.AudioBlock.moving`) is not felt
then: around both, contact has to last before it counts.

The threshold follows the noise floor (`signal.perception.noise_floor`) unless it was
given or calibrated; then the level decides alone. A touch is held over a silence as
short as that of a finger that has just landed, or of a stroke that turns.

The paper has no such gate (it compares the level of the whole window): `feel --contact
window` turns it off.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from tactophone.core.microphones import CONTACT
from tactophone.core.types import AudioBlock, ContactThreshold, FloatArray
from tactophone.signal.perception.levels import (
    BANDS,
    BANDS_HOP,
    BANDS_WINDOW,
    LevelMeter,
    LoudnessRule,
)
from tactophone.signal.perception.noise_floor import (
    HIGHEST_DBFS,
    Floats,
    NoiseFloor,
    RecordingFloor,
)

CLEAR_DB = 5.0
"""Margin over the threshold at which the fast level opens the gate by itself."""

RELEASE_DB = 0.5
"""Margin under a fixed threshold at which the slow level closes the gate. One measured
in silence is 1.9 dB over noise that varies by 0.3 dB (`margin_db`): at 3 dB, that noise
itself would keep a touch open."""

SHORTEST_GATED_TOUCH = 0.03
"""Shortest touch in s: a shorter one is not perceived as vibration (Sci. Rep. 2025,
15:5057)."""

BANDS_ON_DB, BANDS_OFF_DB = 1.15, 0.3
"""Mean over the bands of what exceeds floor and margin that begins contact, and that
ends it."""

EARLY = 0.05
"""Seconds from the opening of the level gate in which its word counts alone: the bands'
windows are 64 ms long."""

LONGEST_WAIT = 0.011
"""Longest time in s that sound waits while the level says what it said before: a window
of the shipped models. A change that the bands alone tell, whose windows are six times
as long, comes with the model's window."""

DISTRUST = 1.0
"""Seconds after an opening that no band confirmed in which another counts for nothing:
motors open the level gate."""

JERK, PERSISTENT = 0.5, 0.15
"""Seconds from a start or stop of the robot in which new contact counts only once it
has lasted so long."""


@dataclass(frozen=True, slots=True)
class Contact:
    """State of the contact gate from a moment on.

    - ``time``: seconds since the stream began.
    - ``touching``: whether there is contact.
    - ``held``: whether that is only held over a silence.
    - ``threshold_dbfs``: level from which there was contact at that time.
    """

    time: float
    touching: bool
    held: bool = field(default=False, repr=False)
    threshold_dbfs: float = field(default=-math.inf, repr=False, compare=False)


class ContactGate:
    """Detects contact from the level of the contact microphone.

    - ``threshold_dbfs``: level from which there is contact.
    - ``rule``: how the level is measured: ``rms``, ``mean_absolute``, or ``banded``:
      without hum and motors.
    - ``sample_rate``: of the sound to come, in Hz.
    - ``floor``: where there is one, the threshold begins at its own and follows it,
      until another threshold is assigned.
    - ``bands``: let the bands decide, each over its own floor, once the floor is known;
      not by a threshold that was assigned.
    - ``hold``: seconds that contact lasts on over silence.
    - ``threshold``: a shared one may take its place.
    - ``microphone``: the channel that it hears, where there are two.
    - ``longest_wait``: samples that may wait while `stays_ahead`.

    >>> import numpy as np
    >>> gate = ContactGate(-40, sample_rate=48_000)
    >>> sound = np.zeros((4800, 1), np.float32)
    >>> sound[480:960] = 0.1
    >>> [change for change in gate.push(AudioBlock(sound, 48_000)) if change.touching][0]
    Contact(time=0.01025, touching=True)
    """

    def __init__(
        self,
        threshold_dbfs: float,
        *,
        sample_rate: int,
        rule: LoudnessRule = "rms",
        floor: NoiseFloor | None = None,
        bands: bool = False,
        hold: float = 0.0,
    ) -> None:
        self.levels = LevelMeter(rule, sample_rate=sample_rate, bands=bands)
        self._has_bands = bands
        self._finger, self._shared = 0, False
        self._sample_rate, self._step_size = sample_rate, self.levels.steps.step_size
        count = self.levels.steps.count
        self._hop = count(BANDS_HOP)
        self.microphone, self.longest_wait = CONTACT, round(LONGEST_WAIT * sample_rate)
        self._shortest, self._hold = count(SHORTEST_GATED_TOUCH), count(hold)
        self._early, self._distrust = count(EARLY), count(DISTRUST)
        self._jerk, self._persistent = count(JERK), count(PERSISTENT)
        self.threshold, self.floor = (
            ContactThreshold(threshold_dbfs, follows_floor=floor is not None),
            floor,
        )
        self.reset()

    def _set(self, level_dbfs: float, release_dbfs: float) -> None:
        power = self.levels.steps.power
        self._threshold_dbfs = level_dbfs
        self._clear_from = 10 ** (power * (level_dbfs + CLEAR_DB) / 20)
        self._open_from = 10 ** (power * level_dbfs / 20)
        self._close_under = 10 ** (power * release_dbfs / 20)
        self._following = self.threshold.follows_floor

    def reset(self) -> None:
        """Return to the initial state: no contact; the floor is measured anew."""
        if not self._shared:
            self.levels.reset()
        self._steps = self._lasted = self._quiet = self._part = 0
        # Of the level: whether it says contact, and only holds it; whether its word
        # counts before the bands can tell.
        self._open = self._held = False
        self._believed, self._believed_from = False, 0
        # Of the bands: whether they are loud now, and the steps since.
        self._heard, self._silent_for = False, self._hold + 1
        self._reported = False, False
        # Of a robot's starts and stops: until when contact has to last, since when it
        # does, whether it still has to.
        self._moving, self._jerk_until, self._begun, self._waits = False, 0, -1, False
        if self.floor:
            self.floor.reset()
        self._set(self.threshold.dbfs, self.threshold.dbfs - RELEASE_DB)
        if self.floor and self.threshold.follows_floor:
            self._move(self.floor)

    def begin(self, recording: RecordingFloor) -> None:
        """Begin at the floor of a recording; where it has none or the level decides,
        with its threshold."""
        if self.floor and self._has_bands and recording.known:
            self.floor.begin(recording)
            self._move(self.floor)
        else:
            self.threshold.dbfs = recording.threshold_dbfs

    def push(self, block: AudioBlock) -> list[Contact]:
        """Take sound; return each change of contact, and a heartbeat every second
        hop."""
        threshold = self.threshold
        if (
            threshold.dbfs != self._threshold_dbfs
            or threshold.follows_floor is not self._following
        ):
            self._set(
                threshold.dbfs, threshold.dbfs - RELEASE_DB
            )  # another was assigned
        if block.moving is not self._moving:
            self._moving, self._jerk_until = block.moving, self._steps + self._jerk
            # What begins at rest and is as young is the start itself; a landing that
            # stops the robot is none.
            self._waits |= (
                block.moving
                and self._begun >= 0
                and self._steps - self._begun < self._persistent
            )
        if not self._shared:
            self.levels.push(self.own_channel(block))
        self._part += block.size
        steps, self._part = divmod(self._part, self._step_size)
        return self._take(steps)

    def own_channel(self, block: AudioBlock) -> FloatArray:
        """Return the channel that the gate hears, ``(1, samples)``."""
        return block.samples.T[self.channel_of(block.channels) :][:1]

    def channel_of(self, channels: int) -> int:
        """Return which of so many channels it hears: its microphone's, or the only
        one."""
        return min(self.microphone, channels - 1)

    def share(self, levels: LevelMeter, finger: int) -> None:
        """Take the levels of one finger from a meter that measures all fingers, and to
        which others push sound."""
        self.levels = levels
        self._finger = finger
        self._shared = True
        self.reset()

    @property
    def is_shared(self) -> bool:
        """Whether its levels are measured together with those of other fingers."""
        return self._shared

    @property
    def stays_ahead(self) -> bool:
        """Whether the level says of the sound that it looked ahead at what it said
        before; then that sound may wait for up to `longest_wait`."""
        plain = (
            self.threshold.dbfs == self._threshold_dbfs
            and self.threshold.follows_floor is self._following
        )
        if self._open and self._lasted < self._early:
            return False  # the bands are about to confirm it, or to end it
        return plain and self._stays(
            self.levels.slow[self._finger], self.levels.fast[self._finger]
        )

    def _take(self, steps: int) -> list[Contact]:
        """Evaluate steps one after another, and a row of the bands at each hop; return
        what changed."""
        finger, levels = self._finger, self.levels
        heard_slow, heard_fast, rows = (
            levels.slow[finger],
            levels.fast[finger],
            levels.bands[finger],
        )
        slow, fast = heard_slow[:steps], heard_fast[:steps]
        del heard_slow[:steps], heard_fast[:steps]
        contacts, start, count = list[Contact](), 0, steps
        while start < count:
            end = min(count, start + self._hop - self._steps % self._hop)
            if self._stays(slow[start:end], fast[start:end]):
                self._steps += end - start
                self._lasted += end - start
                self._quiet = 0 if self._open else self._quiet + end - start
            else:
                for each in map(self._step, slow[start:end], fast[start:end]):
                    contacts += each
            if self._steps % self._hop == 0:
                contacts += self._end_hop(
                    slow[end - 1], rows.pop(0) if rows else _NO_BANDS
                )
            start = end
        return contacts

    def _stays(self, slow: list[float], fast: list[float]) -> bool:
        """Whether the level plainly says of these steps what it said before, so that
        none needs a look of its own."""
        if self._held:
            return False
        if not slow:
            return True
        if self._open:
            return min(slow) >= self._close_under
        return max(slow) < self._open_from and max(fast) < self._clear_from

    def _step(self, slow: float, fast: float) -> list[Contact]:
        was_open, held = self._open, self._held
        self._steps += 1
        self._lasted += 1
        loud = slow >= self._open_from or fast >= self._clear_from
        if not loud and was_open and not held:
            # Hysteresis: an open gate closes at a lower level, and a touch lasts for
            # `SHORTEST_GATED_TOUCH` at least.
            loud = slow >= self._close_under or self._lasted < self._shortest
        self._quiet = 0 if loud else self._quiet + 1
        # A finger that has just landed, or that turns, lies still: a short silence does
        # not end a touch.
        self._held = not loud and was_open and self._quiet <= self._hold
        self._open = loud or self._held
        if self._open and not was_open:
            self._lasted, self._believed = 0, self._steps >= self._believed_from
        return self._report()

    def _end_hop(self, slow: float, bands: Floats) -> list[Contact]:
        """Ask the bands, and let the floor follow."""
        level_dbfs = (
            20 / self.levels.steps.power * math.log10(slow) if slow > 0 else math.nan
        )
        if self._by_bands and self.floor:
            self._hear(self.floor, bands)
        touching, _ = self._decide()
        if self.floor and self._following:
            # Until the windows are full of sound, part of the levels is that of their
            # zeros.
            full = self._steps * self._step_size >= BANDS_WINDOW * self._sample_rate
            self.floor.push(
                level_dbfs if full else math.nan,
                bands,
                touching=touching,
                loud=self._open,
            )
            if self.floor.threshold_dbfs != self._threshold_dbfs:
                self._move(self.floor)
        return self._report(due=self._steps % (2 * self._hop) == 0)

    def _hear(self, floor: NoiseFloor, bands: Floats) -> None:
        over = (
            float(np.add.reduce(np.maximum(bands - floor.bands - floor.margin_db, 0.0)))
            / BANDS
        )  # their mean
        self._heard = over >= (BANDS_OFF_DB if self._heard else BANDS_ON_DB)
        self._silent_for = 0 if self._heard else self._silent_for + self._hop
        if self._open and self._believed and self._lasted >= self._early:
            self._believed = False
            if self._silent_for > self._hold:
                # The level said contact, and no band agreed: its next word counts for
                # nothing.
                self._believed_from = self._steps + self._distrust

    @property
    def _by_bands(self) -> bool:
        # Sound as loud as the highest threshold is touch, not noise, however steady it
        # is.
        known = (
            self.floor is not None
            and self.floor.known
            and self._threshold_dbfs < HIGHEST_DBFS
        )
        return known and self._has_bands and self._following

    def _decide(self) -> tuple[bool, bool]:
        """Return whether there is contact, and whether it is only held: by the level,
        as the bands lag by a window."""
        if not self._by_bands:
            return self._open, self._held
        touching = (self._open and self._believed) or self._silent_for <= self._hold
        return touching, touching and (self._held or not self._open)

    def _report(self, *, due: bool = False) -> list[Contact]:
        """Return the state if it changed or a heartbeat is due."""
        decided = self._wait(*self._decide())
        if decided == self._reported and not due:
            return []
        self._reported = decided
        return [
            Contact(
                self._steps * self._step_size / self._sample_rate,
                *decided,
                self._threshold_dbfs,
            )
        ]

    def _wait(self, touching: bool, held: bool) -> tuple[bool, bool]:
        """Return a decision as it counts: not yet, where a robot starts or stops and
        the contact is young."""
        if not touching:
            self._begun, self._waits = -1, False
        elif self._begun < 0:
            self._begun, self._waits = self._steps, self._steps < self._jerk_until
        elif self._waits and not held:
            self._waits = self._steps - self._begun < self._persistent
        return (False, False) if self._waits else (touching, held)

    def _move(self, floor: NoiseFloor) -> None:
        self.threshold.follow(floor.threshold_dbfs)
        self._set(floor.threshold_dbfs, floor.release_dbfs)


_NO_BANDS = np.zeros(0)
