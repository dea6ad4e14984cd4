"""Feels a touch begin and end within milliseconds, where a window of 256 ms cannot.

A window says what the surface is like, but it still holds a touch 240 ms after the finger has left, and is only a
twentieth full when the finger has just come. So contact is also watched beside the detector, a thousand times a
second: a touch that is clearly loud opens the gate at once, by its level over 4 ms; any other by its level over 32 ms,
as noise with motors and hum in it rises by 5 dB for 4 ms every now and then, and not for 32. When that longer level
has fallen under the threshold, the touch has ended.

The paper has no such gate (its own looks at the whole window): `feel --contact window` leaves it out.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from tactophone.perception.features.loudness import LoudnessRule
from tactophone.perception.sensor_health.invalid_samples import find_garbage
from tactophone.types import CONTACT, AudioBlock, FloatArray

STEP_RATE = 1000
"""Looks a second."""

FAST, SLOW = 4, 32
"""Steps that the two levels look back: half a period of 125 Hz, and a period of 31 Hz."""

CLEAR_DB = 5.0
"""How far over the threshold the fast level must be to open the gate by itself."""

RELEASE_DB = 3.0
"""How far under the threshold the slow level must fall: noise at the threshold would chatter otherwise."""

LEAST = 30
"""Steps that a touch lasts at least: what is shorter is not felt as vibration (Sci. Rep. 2025, 15:5057)."""

BEAT = 10
"""Steps between two signs of life while nothing changes: downstream, silence means that something has stopped."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Whether the finger touches, known from a moment on.

    Parameters
    ----------
    time
        Seconds since the stream began.
    touching
        Whether there is contact.
    """

    time: float
    touching: bool


class ContactGate:
    """Watches the level of the contact microphone.

    Parameters
    ----------
    threshold_dbfs
        Level from which there is contact.
    rule
        Loudness that the level is of.
    sample_rate
        Of the sound to come, in Hz; its steps are whole samples, so that 44.1 kHz is watched 1002 times a second.

    Examples
    --------
    >>> gate = ContactGate(-40, sample_rate=48_000)
    >>> sound = np.zeros((4800, 1), np.float32)
    >>> sound[480:960] = 0.1
    >>> [change for change in gate.push(AudioBlock(sound, 48_000)) if change.touching][0]
    Contact(time=0.011, touching=True)
    """

    def __init__(self, threshold_dbfs: float, *, sample_rate: int, rule: LoudnessRule = "rms") -> None:
        self._step_size = max(1, sample_rate // STEP_RATE)
        self._sample_rate = sample_rate
        # Loudness is a mean of |x| to this power; so are the levels that it is compared with.
        self._power = 2 if rule == "rms" else 1
        self.threshold_dbfs = threshold_dbfs
        self.reset()

    @property
    def threshold_dbfs(self) -> float:
        """Level from which there is contact; may be set at any time."""
        return self._threshold_dbfs

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None:
        self._threshold_dbfs = level_dbfs
        self._clear_from = 10 ** (self._power * (level_dbfs + CLEAR_DB) / 20)
        self._open_from = 10 ** (self._power * level_dbfs / 20)
        self._close_under = 10 ** (self._power * (level_dbfs - RELEASE_DB) / 20)

    @property
    def latency(self) -> float:
        """Seconds until a step is full."""
        return self._step_size / self._sample_rate

    def reset(self) -> None:
        """Become as new: no contact."""
        self._rest: FloatArray = np.empty(0, np.float32)
        self._newest, self._latest = deque([0.0] * FAST, FAST), deque([0.0] * SLOW, SLOW)
        self._steps = 0
        self._touching = False
        self._lasted = 0

    def push(self, block: AudioBlock) -> list[Contact]:
        """Take sound in; give each change of contact, and a sign of life every ``BEAT`` steps."""
        sound = np.concatenate((self._rest, block.samples[:, CONTACT]))
        whole = len(sound) // self._step_size * self._step_size
        self._rest = sound[whole:]
        powers = self._measure(sound[:whole].reshape(-1, self._step_size))
        return [step for power in powers if (step := self._step(power))]

    def _measure(self, steps: FloatArray) -> list[float]:
        """Give each step's power, or mean absolute value; not a number where it holds garbage."""
        if len(garbage := find_garbage(steps)):
            steps = steps.copy()
            steps[garbage] = np.nan
        sums = np.vecdot(steps, steps) if self._power == 2 else np.abs(steps).sum(axis=1)
        return [total / self._step_size for total in sums.tolist()]

    def _step(self, power: float) -> Contact | None:
        self._newest.append(power)
        self._latest.append(power)
        before = self._touching
        self._steps += 1
        self._lasted += 1
        self._touching = self._is_touching(sum(self._newest) / FAST, sum(self._latest) / SLOW)
        if self._touching and not before:
            self._lasted = 0
        if self._touching == before and self._steps % BEAT:
            return None
        return Contact(self._steps * self._step_size / self._sample_rate, self._touching)

    def _is_touching(self, fast: float, slow: float) -> bool:
        # Levels that are not numbers pass no comparison: garbage closes the gate at once, and keeps it closed.
        if fast >= self._clear_from or slow >= self._open_from:
            return True
        return self._touching and (slow >= self._close_under or (self._lasted < LEAST and fast >= 0))
