"""The contact gate: detects the start and end of a touch within milliseconds, where a window of 256 ms cannot.

A window still contains a touch 240 ms after the finger has lifted, and is only a twentieth full when the finger has
just landed. So the gate measures the level a thousand times a second, beside the classifier. A clearly loud touch
opens it by the level over 4 ms; any other by the level over 32 ms, as noise with motors and hum in it rises by 5 dB
for 4 ms now and then, and not for 32. The gate closes when the longer level has fallen under the threshold.

The paper has no such gate (it compares the level of the whole window): `feel --contact window` turns it off.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from tactophone.perception.features.loudness import LoudnessRule
from tactophone.perception.sensor_health.invalid_samples import find_invalid
from tactophone.types import CONTACT, AudioBlock, FloatArray

STEP_RATE = 1000
"""Steps a second."""

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
    """

    time: float
    touching: bool


class ContactGate:
    """Detects contact from the level of the contact microphone.

    Parameters
    ----------
    threshold_dbfs
        Level from which there is contact.
    rule
        How the level is measured: ``rms`` or ``mean_absolute``.
    sample_rate
        Of the sound to come, in Hz; steps are whole samples, so that 44.1 kHz has 1002 steps a second.

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
        # The level is a mean of |x| to this power; so are the thresholds that it is compared with.
        self._power = 2 if rule == "rms" else 1
        self.threshold_dbfs = threshold_dbfs
        self.reset()

    @property
    def threshold_dbfs(self) -> float:
        """Level from which there is contact; may be assigned at any time."""
        return self._threshold_dbfs

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None:
        self._threshold_dbfs = level_dbfs
        self._clear_from = 10 ** (self._power * (level_dbfs + CLEAR_DB) / 20)
        self._open_from = 10 ** (self._power * level_dbfs / 20)
        self._close_under = 10 ** (self._power * (level_dbfs - RELEASE_DB) / 20)

    @property
    def latency(self) -> float:
        """Duration of a step in s."""
        return self._step_size / self._sample_rate

    def reset(self) -> None:
        """Return to the initial state: no contact."""
        self._rest: FloatArray = np.empty(0, np.float32)
        self._fast, self._slow = deque([0.0] * FAST, FAST), deque([0.0] * SLOW, SLOW)
        self._steps = 0
        self._touching = False
        self._lasted = 0

    def push(self, block: AudioBlock) -> list[Contact]:
        """Take sound; return each change of contact, and a heartbeat every ``HEARTBEAT_STEPS`` steps."""
        sound = np.concatenate((self._rest, block.samples[:, CONTACT]))
        whole = len(sound) // self._step_size * self._step_size
        self._rest = sound[whole:]
        powers = self._measure(sound[:whole].reshape(-1, self._step_size))
        return [step for power in powers if (step := self._step(power))]

    def _measure(self, steps: FloatArray) -> list[float]:
        """Return the power, or mean absolute value, of each row; NaN where it holds invalid samples."""
        if len(invalid := find_invalid(steps)):
            steps = steps.copy()
            steps[invalid] = np.nan
        sums = np.vecdot(steps, steps) if self._power == 2 else np.abs(steps).sum(axis=1)
        return [total / self._step_size for total in sums.tolist()]

    def _step(self, power: float) -> Contact | None:
        self._fast.append(power)
        self._slow.append(power)
        before = self._touching
        self._steps += 1
        self._lasted += 1
        self._touching = self._is_touching(sum(self._fast) / FAST, sum(self._slow) / SLOW)
        if self._touching and not before:
            self._lasted = 0
        if self._touching == before and self._steps % HEARTBEAT_STEPS:
            return None
        return Contact(self._steps * self._step_size / self._sample_rate, self._touching)

    def _is_touching(self, fast: float, slow: float) -> bool:
        # Every comparison with NaN is false: invalid samples close the gate at once, and keep it closed.
        if fast >= self._clear_from or slow >= self._open_from:
            return True
        return self._touching and (slow >= self._close_under or (self._lasted < MIN_STEPS and fast >= 0))
