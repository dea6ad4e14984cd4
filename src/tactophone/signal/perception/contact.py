"""The contact gate: detects the start and end of a touch within milliseconds, where a window of 256 ms cannot.

A window still contains a touch 240 ms after the finger has lifted, and is only a twentieth full when the finger has
just landed. So the gate measures the level four thousand times a second, beside the classifier. A clearly loud touch
opens it by the level over 4 ms; any other by the level over 32 ms, because motor noise and hum sometimes rise 5 dB for
4 ms, but not for 32. The gate closes when the longer level has fallen under the threshold.

The threshold follows the noise floor (`signal.perception.noise_floor`) unless it was given or calibrated. A touch
is held over a silence as short as that of a finger that has just landed, or of a stroke that turns.

The paper has no such gate (it compares the level of the whole window): `feel --contact window` turns it off.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactophone.core.types import AudioBlock, ContactThreshold, FloatArray
from tactophone.signal.perception.levels import LoudnessRule, StepLevels
from tactophone.signal.perception.noise_floor import FLOOR_WINDOW, RATE, NoiseFloor

FAST, SLOW = 0.004, FLOOR_WINDOW
"""Seconds that the two levels cover: half a period of 125 Hz, and a period of 31 Hz."""

CLEAR_DB = 5.0
"""Margin over the threshold at which the fast level opens the gate by itself."""

RELEASE_DB = 0.5
"""Margin under a fixed threshold at which the slow level closes the gate. One measured in silence is 1.9 dB over noise
that varies by 0.3 dB (`margin_db`): at 3 dB, that noise itself would keep a touch open."""

SHORTEST_GATED_TOUCH = 0.03
"""Shortest touch in s: a shorter one is not perceived as vibration (Sci. Rep. 2025, 15:5057)."""

GATE_HEARTBEAT = 1 / RATE
"""Seconds between two reports while nothing changes: downstream, no report means that something has stopped."""

MOST_STEPS = 64
"""Steps of a longer block that are taken at once."""

ROUNDING = 1e-3
"""Share of a level, far over the error of sums, by which a threshold must be missed for steps to wait."""


@dataclass(frozen=True, slots=True)
class Contact:
    """State of the contact gate from a moment on.

    Parameters
    ----------
    time
        Seconds since the stream began.
    touching
        Whether there is contact.
    held
        Whether that is only held over a silence.
    threshold_dbfs
        Level from which there was contact at that time.
    """

    time: float
    touching: bool
    held: bool = field(default=False, repr=False)
    threshold_dbfs: float = field(default=-math.inf, repr=False, compare=False)


class ContactGate:
    """Detects contact from the level of the contact microphone.

    Parameters
    ----------
    threshold_dbfs
        Level from which there is contact.
    rule
        How the level is measured: ``rms``, ``mean_absolute``, or ``banded``: without hum and motors.
    sample_rate
        Of the sound to come, in Hz.
    floor
        Where there is one, the threshold begins at its own and follows it, until another threshold is assigned.
    hold
        Seconds that contact lasts on over silence.

    Attributes
    ----------
    threshold
        A shared one may take its place.

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
        hold: float = 0.0,
    ) -> None:
        self._levels = StepLevels(rule, sample_rate=sample_rate)
        self._sample_rate = sample_rate
        count = self._levels.count
        self._fast, self._slow, self._heartbeat = count(FAST), count(SLOW), count(GATE_HEARTBEAT)
        self._shortest, self._hold = count(SHORTEST_GATED_TOUCH), count(hold)
        # Powers of the steps that the slow level covers, then of those that wait and of new ones.
        self._powers = np.zeros(self._slow + self._heartbeat + MOST_STEPS)
        self._windows = sliding_window_view(self._powers[1:], self._slow)
        self._slow_weights, self._fast_weights = (np.full(steps, 1 / steps) for steps in (self._slow, self._fast))
        self.threshold, self.floor = ContactThreshold(threshold_dbfs, follows_floor=floor is not None), floor
        self._set(threshold_dbfs, threshold_dbfs - RELEASE_DB)
        self.reset()

    def _set(self, level_dbfs: float, release_dbfs: float) -> None:
        power = self._levels.power
        self._threshold_dbfs = level_dbfs
        self._clear_from = 10 ** (power * (level_dbfs + CLEAR_DB) / 20)
        self._open_from = 10 ** (power * level_dbfs / 20)
        self._close_under = 10 ** (power * release_dbfs / 20)
        self._following = self.threshold.follows_floor

    def reset(self) -> None:
        """Return to the initial state: no contact; the floor is measured anew."""
        self._levels.reset()
        self._powers[:] = 0
        self._filled, self._room, self._steps = self._slow, 0.0, 0
        self._touching = self._held = False
        self._lasted = self._quiet = 0
        if self.floor and self.threshold.follows_floor:
            self.floor.reset()
            self._move(self.floor)

    def push(self, block: AudioBlock) -> list[Contact]:
        """Take sound; return each change of contact, and a heartbeat every ``GATE_HEARTBEAT`` s."""
        threshold = self.threshold
        if threshold.dbfs != self._threshold_dbfs or threshold.follows_floor is not self._following:
            # Another was assigned. The steps that wait are from before, and change nothing by the threshold in force.
            if self._filled > self._slow:
                self._evaluate()
            self._room = 0.0
            self._set(threshold.dbfs, threshold.dbfs - RELEASE_DB)
        powers = self._levels.push(block)
        if len(powers) <= MOST_STEPS:
            return self._take(powers)
        pieces = (powers[start : start + MOST_STEPS] for start in range(0, len(powers), MOST_STEPS))
        return [contact for piece in pieces for contact in self._take(piece)]

    def _take(self, powers: FloatArray) -> list[Contact]:
        """Keep the steps; evaluate them as soon as they could change anything."""
        if not len(powers):
            return []
        filled = self._filled + len(powers)
        self._powers[self._filled : filled] = powers
        self._filled = filled
        self._room -= sum(powers.tolist())
        until_heartbeat = self._heartbeat - self._steps % self._heartbeat
        # A comparison with NaN is false: invalid samples are evaluated at once.
        if self._room > 0 and filled - self._slow < until_heartbeat:
            return []
        return self._evaluate()

    def _evaluate(self) -> list[Contact]:
        """Evaluate all steps that wait, one after another, and return what changed."""
        # Each level is a sum of its own, so that it is the same at any block size.
        count = self._filled - self._slow
        windows = self._windows[:count]
        slow = np.vecdot(windows, self._slow_weights).tolist()
        fast = np.vecdot(windows[:, -self._fast :], self._fast_weights).tolist()
        self._powers[: self._slow] = self._powers[count : self._filled]
        self._filled = self._slow
        contacts, start = list[Contact](), 0
        while start < count:
            # A heartbeat may move the thresholds.
            end = start + self._heartbeat - self._steps % self._heartbeat
            if self._stays(slow[start:end], fast[start:end]):
                taken = len(slow[start:end])
                self._steps += taken
                self._lasted += taken
                self._quiet = 0 if self._touching else self._quiet + taken
                found = [self._report(slow[start:end][-1], changed=False)]
            else:
                found = list(map(self._step, slow[start:end], fast[start:end]))
            contacts += [contact for contact in found if contact]
            start = end
        self._room = self._room_after(slow[-1], fast[-1])
        return contacts

    def _room_after(self, slow: float, fast: float) -> float:
        """Return the sum of powers up to which further steps can change nothing until the next heartbeat.

        A level is the mean of the powers of its steps. Without contact, new steps can raise it by their sum over its
        length at most, as what falls out of it is no less than 0: so it stays under a threshold until that sum exceeds
        the length times what it is under it.
        """
        if self._held:
            return 0.0
        if self._touching:
            # The steps that the slow level will still cover then may be enough to keep the touch.
            kept = self._powers[self._heartbeat : self._slow] @ self._slow_weights[self._heartbeat :]
            return math.inf if kept >= self._close_under * (1 + ROUNDING) else 0.0
        opening = min(self._slow * (self._open_from - slow), self._fast * (self._clear_from - fast))
        return (1 - ROUNDING) * opening

    def _stays(self, slow: list[float], fast: list[float]) -> bool:
        """Whether these steps plainly change nothing, so that none needs a look of its own."""
        if self._touching:
            return not self._held and all(level >= self._close_under for level in slow)
        return max(slow) < self._open_from and max(fast) < self._clear_from

    def _step(self, slow: float, fast: float) -> Contact | None:
        touching, held = self._touching, self._held
        self._steps += 1
        self._lasted += 1
        # Every comparison with NaN is false: invalid samples close the gate at once, and keep it closed.
        loud = slow >= self._open_from or fast >= self._clear_from
        if not loud and touching and not held:
            # Hysteresis: an open gate closes at a lower level, and a touch lasts for `SHORTEST_GATED_TOUCH` at least.
            loud = slow >= self._close_under or (self._lasted < self._shortest and fast >= 0)
        self._quiet = 0 if loud else self._quiet + 1
        # A finger that has just landed, or that turns, lies still: a short silence does not end a touch.
        self._held = not loud and touching and slow >= 0 and self._quiet <= self._hold
        self._touching = loud or self._held
        if self._touching and not touching:
            self._lasted = 0
        return self._report(slow, changed=self._touching is not touching or self._held is not held)

    def _report(self, slow: float, *, changed: bool) -> Contact | None:
        """Return the state if it changed or a heartbeat is due."""
        if self._steps % self._heartbeat == 0:
            if self.floor and self._following:
                self._follow(self.floor, slow)
        elif not changed:
            return None
        time = self._steps * self._levels.step_size / self._sample_rate
        return Contact(time, self._touching, self._held, self._threshold_dbfs)

    def _follow(self, floor: NoiseFloor, slow: float) -> None:
        level_dbfs = 20 / self._levels.power * math.log10(slow) if slow > 0 else math.nan
        # Until the window is full of sound, the level is that of its zeros.
        floor.push(level_dbfs if self._steps >= self._slow else math.nan, touching=self._touching)
        if floor.threshold_dbfs != self._threshold_dbfs:
            self._move(floor)

    def _move(self, floor: NoiseFloor) -> None:
        self.threshold.follow(floor.threshold_dbfs)
        self._set(floor.threshold_dbfs, floor.release_dbfs)
