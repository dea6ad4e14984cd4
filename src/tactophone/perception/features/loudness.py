"""The level of the contact microphone, by one of three rules: it decides on contact.

The paper states an RMS level; its authors' code takes the mean of the absolute value, which is 2 dB lower for Gaussian
noise.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

LoudnessRule: TypeAlias = Literal["rms", "mean_absolute", "banded"]

SILENCE_DBFS = -200.0
"""Replaces minus infinity, so that levels stay finite: below the least step of 24 bit sound (-138 dBFS)."""


def rms_dbfs(samples: FloatArray) -> float:
    """Return the root mean square level of one channel, in dB of full scale.

    Examples
    --------
    >>> rms_dbfs(np.full(100, 0.1, np.float32))
    -20.0
    >>> rms_dbfs(np.zeros(100, np.float32))
    -200.0
    """
    return _dbfs(math.sqrt(np.vecdot(samples, samples) / len(samples)))


def mean_absolute_dbfs(samples: FloatArray) -> float:
    """Return the level of the mean absolute value of one channel, in dB of full scale."""
    return _dbfs(float(np.abs(samples).mean(dtype=np.float64)))


def banded_dbfs(samples: FloatArray) -> float:
    """Return the RMS level of one channel between 1/32 and 1/2 of the Nyquist frequency: 250 Hz to 4 kHz at 16 kHz.

    Hum, motors and the arm's sway are under that band, the sound of a sliding finger in it: on simulated sound it
    detects 83 % of touching windows at 1 % false alarms, the unfiltered level 42 % (docs/research/detector.md).

    Examples
    --------
    >>> hum, hiss = (np.sin(2 * np.pi * f * np.arange(512) / 512).astype(np.float32) for f in (3, 40))
    >>> banded_dbfs(hum) < -60, round(banded_dbfs(hiss), 1)
    (True, -3.0)
    """
    spectrum = np.fft.rfft(samples * _taper(len(samples))).view(np.float64)
    return band_of_powers(spectrum * spectrum, len(samples))


def band_of_powers(powers: NDArray[np.floating[Any]], size: int) -> float:
    """Return the banded level from the powers of the real and the imaginary parts of a spectrum, alternating.

    ``powers`` has the shape ``(2 * bins,)``, of ``size`` samples with a periodic Hann taper.
    """
    # Two values a bin, hence the doubled indices; two sides of a real spectrum; the taper's mean square is 3/8.
    power = 2 * float(np.add.reduce(powers[size // 32 : size // 2], dtype=np.float64)) / (3 / 8 * size * size)
    return _dbfs(math.sqrt(power))


LOUDNESS: dict[LoudnessRule, Callable[[FloatArray], float]] = {
    "rms": rms_dbfs,
    "mean_absolute": mean_absolute_dbfs,
    "banded": banded_dbfs,
}
"""The level in dBFS of one channel, shape ``(samples,)``, by each rule."""


@functools.cache
def _taper(size: int) -> NDArray[np.float64]:
    return np.asarray(np.hanning(size + 1)[:-1])


def _dbfs(amplitude: float) -> float:
    # Rounded to an inaudible 1e-6 dB, so that levels compare equal whatever the order of summation.
    return max(SILENCE_DBFS, round(20 * math.log10(amplitude), 6)) if amplitude > 0 else SILENCE_DBFS
