"""Roughness of a profile as drawings state it: Ra and Rq after the Gaussian filter (ISO 21920-2, ISO 16610-21)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CUTOFF = 2.5e-3
"""Metres; the profile filter's nesting index for Ra from 2 to 10 um (ISO 21920-3), here for all."""

_ALPHA = np.sqrt(np.log(2) / np.pi)
"""ISO 16610-21: the filter passes half of a sine whose wavelength is the cut-off."""


@dataclass(frozen=True, slots=True)
class Roughness:
    """Ra, the mean absolute height, and Rq, its root mean square, both in m."""

    ra: float
    rq: float


def roughness(height: NDArray[np.float64], spacing: float, cutoff: float = CUTOFF) -> Roughness:
    """Measure a periodic profile as a stylus instrument would: without its form and waviness.

    Examples
    --------
    Of a sine of amplitude A, much shorter than the cut-off, Ra is 2A/pi and Rq is A/sqrt(2).

    >>> sine = np.sin(2 * np.pi * 100 * np.arange(10_000) / 10_000)
    >>> found = roughness(sine, spacing=1e-6)
    >>> round(found.ra * np.pi / 2, 3), round(found.rq * 2**0.5, 3)
    (1.0, 1.0)
    """
    wavenumber = np.fft.rfftfreq(height.size, spacing)
    passed = 1 - np.exp(-np.pi * (_ALPHA * cutoff * wavenumber) ** 2)
    rough = np.fft.irfft(np.fft.rfft(height) * passed, height.size)
    return Roughness(ra=float(np.abs(rough).mean()), rq=float(rough.std()))
