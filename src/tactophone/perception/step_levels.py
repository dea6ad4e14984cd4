"""The level of the contact microphone a thousand times a second, by the rule of a model's gate."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.features.loudness import LoudnessRule
from tactophone.perception.sensor_health.invalid_samples import find_invalid
from tactophone.types import CONTACT, AudioBlock, FloatArray

STEP_RATE = 1000
"""Steps a second."""

BANDED_RATE = 8000
"""Hz that ``banded`` sound is averaged down to; a step then holds eight samples."""

BANDED_LAG = 2
"""Samples at 8 kHz between the two that ``banded`` subtracts: a band around 2 kHz, without offset, hum and motors
(-22 dB at 50 Hz). Of lags 0 (all frequencies), 1, 2 and 4 and a 33-tap high-pass, it detects most touching windows of
simulated sound at 1 % false alarms: 0.85, 0.92, 0.93, 0.93 and 0.92 (32 ms, floor known)."""

BANDED_POWER = 0.7
"""Scales the power of differences so that simulated touches have the banded level of the windows (median; noise, which
is brighter, lies 1 dB lower)."""


class StepLevels:
    """Measures steps of a millisecond; the same values at any block size.

    Parameters
    ----------
    rule
        ``rms``, ``mean_absolute`` or ``banded``.
    sample_rate
        In Hz; steps are whole samples, so that 44.1 kHz has 1002 of them a second (980 by the rule ``banded``).

    Examples
    --------
    >>> levels = StepLevels("rms", sample_rate=48_000)
    >>> levels.push(AudioBlock(np.full((100, 1), 0.5, np.float32), 48_000))
    [0.25, 0.25]
    """

    def __init__(self, rule: LoudnessRule, *, sample_rate: int) -> None:
        self._rule: LoudnessRule = rule
        self._decimation = max(1, sample_rate // BANDED_RATE) if rule == "banded" else 1
        whole_steps = sample_rate / STEP_RATE / self._decimation
        count = max(1, round(whole_steps) if rule == "banded" else sample_rate // STEP_RATE)
        self.step_size = count * self._decimation
        # The level is a mean of |x| to this power; so are the thresholds that it is compared with.
        self.power = 1 if rule == "mean_absolute" else 2
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._rest: FloatArray = np.empty(0, np.float32)
        self._before: NDArray[Any] = np.zeros(BANDED_LAG, np.float32)

    def push(self, block: AudioBlock) -> list[float]:
        """Take sound; return the power, or mean absolute value, of each step that it completes.

        A step with invalid samples is NaN.
        """
        sound = np.concatenate((self._rest, block.samples[:, CONTACT]))
        whole = len(sound) // self.step_size * self.step_size
        self._rest = sound[whole:]
        return self._measure(sound[:whole].reshape(-1, self.step_size)) if whole else []

    def _measure(self, steps: FloatArray) -> list[float]:
        if len(invalid := find_invalid(steps)):
            steps = steps.copy()
            steps[invalid] = np.nan
        if self._rule == "banded":
            return self._measure_band(steps)
        sums = np.vecdot(steps, steps) if self.power == 2 else np.abs(steps).sum(axis=1)
        return [total / self.step_size for total in sums.tolist()]

    def _measure_band(self, steps: FloatArray) -> list[float]:
        # Mean of `decimation` neighbours: a low-pass that costs little; what it lets alias is quiet in a contact sound.
        slow = steps.reshape(len(steps), -1, self._decimation).sum(axis=2) / np.float32(self._decimation)
        joined = np.concatenate((self._before, slow.reshape(-1)))
        self._before = joined[-BANDED_LAG:]
        change = (joined[BANDED_LAG:] - joined[:-BANDED_LAG]).reshape(slow.shape)
        return [BANDED_POWER / slow.shape[1] * total for total in np.vecdot(change, change).tolist()]
