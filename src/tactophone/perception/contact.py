"""The contact gate: detects the start and end of a touch within milliseconds, where a window of 256 ms cannot.

A window still contains a touch 240 ms after the finger has lifted, and is only a twentieth full when the finger has
just landed. So the gate measures the level a thousand times a second, beside the classifier. A clearly loud touch
opens it by the level over 4 ms; any other by the level over 32 ms, as noise with motors and hum in it rises by 5 dB
for 4 ms now and then, and not for 32. The gate closes when the longer level has fallen under the threshold.

The threshold follows the noise floor (`tactophone.perception.noise_floor`) unless it was given or calibrated. A touch
is held over a silence as short as that of a finger that has just landed, or of a stroke that turns.

The paper has no such gate (it compares the level of the whole window): `feel --contact window` turns it off.
"""

import math
from collections import deque
from dataclasses import dataclass, field

from tactophone.perception.features.loudness import LoudnessRule
from tactophone.perception.noise_floor import NoiseFloor
from tactophone.perception.step_levels import STEP_RATE, StepLevels
from tactophone.types import AudioBlock

FAST, SLOW = 4, 32
"""Steps that the two levels cover: half a period of 125 Hz, and a period of 31 Hz."""

CLEAR_DB = 5.0
"""Margin over the threshold at which the fast level opens the gate by itself."""

RELEASE_DB = 3.0
"""Margin under the threshold at which the slow level closes the gate, or noise at the threshold would chatter."""

MIN_STEPS = 30
"""Shortest touch in steps: a shorter one is not perceived as vibration (Sci. Rep. 2025, 15:5057)."""

HEARTBEAT_STEPS = 10
"""Steps between two reports while nothing changes: downstream, no report means that something has stopped."""


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
        Where there is one, the threshold follows it, until another threshold is assigned.
    hold
        Seconds that contact lasts on over silence.

    Examples
    --------
    >>> import numpy as np
    >>> gate = ContactGate(-40, sample_rate=48_000)
    >>> sound = np.zeros((4800, 1), np.float32)
    >>> sound[480:960] = 0.1
    >>> [change for change in gate.push(AudioBlock(sound, 48_000)) if change.touching][0]
    Contact(time=0.011, touching=True)
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
        self._sample_rate, self._hold_steps = sample_rate, round(hold * STEP_RATE)
        self.floor: NoiseFloor | None = None
        self.threshold_dbfs = threshold_dbfs
        self.floor = floor  # after the threshold, whose assignment ends the following
        self.reset()

    @property
    def threshold_dbfs(self) -> float:
        """Level from which there is contact; may be assigned at any time, and then follows nothing."""
        return self._threshold_dbfs

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None:
        self.floor = None
        self._set(level_dbfs, level_dbfs - RELEASE_DB)

    def _set(self, level_dbfs: float, release_dbfs: float) -> None:
        power = self._levels.power
        self._threshold_dbfs = level_dbfs
        self._clear_from = 10 ** (power * (level_dbfs + CLEAR_DB) / 20)
        self._open_from = 10 ** (power * level_dbfs / 20)
        self._close_under = 10 ** (power * release_dbfs / 20)

    @property
    def latency(self) -> float:
        """Duration of a step in s."""
        return self._levels.step_size / self._sample_rate

    def reset(self) -> None:
        """Return to the initial state: no contact; the floor is measured anew."""
        self._levels.reset()
        self._fast, self._slow = deque([0.0] * FAST, FAST), deque([0.0] * SLOW, SLOW)
        self._steps = 0
        self._touching = self._held = False
        self._lasted = self._quiet = 0
        if self.floor:
            self.floor.reset()
            self._set(self.floor.threshold_dbfs, self.floor.release_dbfs)

    def push(self, block: AudioBlock) -> list[Contact]:
        """Take sound; return each change of contact, and a heartbeat every ``HEARTBEAT_STEPS`` steps."""
        return [step for power in self._levels.push(block) if (step := self._step(power))]

    def _step(self, power: float) -> Contact | None:
        self._fast.append(power)
        self._slow.append(power)
        touching, held = self._touching, self._held
        self._steps += 1
        self._lasted += 1
        slow = sum(self._slow) / SLOW
        loud = slow >= self._open_from or self._is_loud(sum(self._fast) / FAST, slow)
        self._quiet = 0 if loud else self._quiet + 1
        # A finger that has just landed, or that turns, lies still: a short silence does not end a touch.
        self._held = not loud and touching and slow >= 0 and self._quiet <= self._hold_steps
        self._touching = loud or self._held
        if self._touching and not touching:
            self._lasted = 0
        reported = self._steps % HEARTBEAT_STEPS == 0
        if reported and self.floor:
            self._follow(self.floor, slow)
        if not reported and self._touching is touching and self._held is held:
            return None
        time = self._steps * self._levels.step_size / self._sample_rate
        return Contact(time, self._touching, self._held, self._threshold_dbfs)

    def _is_loud(self, fast: float, slow: float) -> bool:
        """Whether there is contact although the slow level alone does not open the gate."""
        # Every comparison with NaN is false: invalid samples close the gate at once, and keep it closed.
        if fast >= self._clear_from:
            return True
        open_now = self._touching and not self._held
        return open_now and (slow >= self._close_under or (self._lasted < MIN_STEPS and fast >= 0))

    def _follow(self, floor: NoiseFloor, slow: float) -> None:
        level_dbfs = 20 / self._levels.power * math.log10(slow) if slow > 0 else math.nan
        # Until the deque is full of sound, the level is that of its zeros.
        floor.push(level_dbfs if self._steps >= SLOW else math.nan, touching=self._touching)
        if floor.threshold_dbfs != self._threshold_dbfs:
            self._set(floor.threshold_dbfs, floor.release_dbfs)
