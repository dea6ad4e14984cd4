"""How loud the contact microphone is, by either of two rules, and so whether the finger touches anything.

The paper states an RMS level; its authors' code takes the mean of the absolute value (field.md, 2). For Gaussian noise
the second reads 2 dB lower.
"""

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from tactophone.types import FloatArray

LoudnessRule: TypeAlias = Literal["rms", "mean_absolute"]

SILENCE_DBFS = -200.0
"""Stands for minus infinity, so that levels stay numbers: below the least step of 24 bit sound (-138 dBFS)."""


def rms_dbfs(samples: FloatArray) -> float:
    """Root mean square level of one channel, in dB of full scale.

    Examples
    --------
    >>> rms_dbfs(np.full(100, 0.1, np.float32))
    -20.0
    >>> rms_dbfs(np.zeros(100, np.float32))
    -200.0
    """
    return _dbfs(float(np.sqrt(np.square(samples, dtype=np.float64).mean())))


def mean_absolute_dbfs(samples: FloatArray) -> float:
    """Level of the mean absolute value of one channel, in dB of full scale."""
    return _dbfs(float(np.abs(samples).mean(dtype=np.float64)))


LOUDNESS: dict[LoudnessRule, Callable[[FloatArray], float]] = {
    "rms": rms_dbfs,
    "mean_absolute": mean_absolute_dbfs,
}


def _dbfs(amplitude: float) -> float:
    # Rounded far below hearing (1e-6 dB), so that levels compare equal whatever the summation order.
    return max(SILENCE_DBFS, round(20 * float(np.log10(amplitude)), 6)) if amplitude > 0 else SILENCE_DBFS
