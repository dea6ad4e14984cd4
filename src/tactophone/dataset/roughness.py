r"""Roughness parameters of a height profile, by ISO 4287 and ISO 21920-2, after the Gaussian filter (ISO 16610-21).

The Gaussian profile filter has the weight :math:`s(x) = \exp(-\pi (x / \alpha\lambda_c)^2) / \alpha\lambda_c` with
:math:`\alpha = \sqrt{\ln 2 / \pi}`, so that half of a wave of the cut-off length passes. The filter passes waviness;
the rest is roughness. Half a cut-off at either end is not evaluated, unless the profile is periodic.

Choices where the standards leave room: RSm counts elements between up-crossings of the mean line whose peak and valley
both exceed a tenth of Rz; Rz is the mean over five sampling lengths, or as many as there are.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CUTOFF = 0.8e-3
"""Metres; ISO 21920-3's default for Ra of 0.1 to 2 um, and the scale of a finger pad."""

COARSE_CUTOFF = 2.5e-3
"""Metres; ISO 21920-3's default for Ra of 2 to 10 um."""

ALPHA = math.sqrt(math.log(2) / math.pi)
LENGTHS = 5
LEAST_ELEMENT = 0.1
"""Of Rz: the height discrimination of profile elements (ISO 4287, 3.1.6)."""

STANDARD_CUTOFFS = ((20e-9, 0.08e-3), (100e-9, 0.25e-3), (2e-6, 0.8e-3), (10e-6, 2.5e-3), (80e-6, 8e-3))
"""Greatest Ra and its cut-off, in m, of ISO 4288 and ISO 21920-3."""

SLOPE_WEIGHTS = np.array([1.0, -9.0, 45.0, 0.0, -45.0, 9.0, -1.0])
"""Weights of seven neighbours, newest first, in sixtieths of a step."""

Profile = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Roughness:
    """Roughness parameters."""

    ra: float
    rq: float
    """`ra` and `rq`: mean of the absolute height, and its root mean square, in m."""
    rz: float
    """Greatest height within a sampling length, averaged over five, in m."""
    rsk: float
    rku: float
    """`rsk` and `rku`: skewness (negative for plateaus with pits) and kurtosis (3 for Gaussian heights)."""
    rsm: float
    """Mean width of profile elements, in m; NaN if there is none."""
    rdq: float
    """Root mean square slope, without unit."""


def measure_profile(heights: Profile, *, step: float, cutoff: float = CUTOFF, periodic: bool = False) -> Roughness:
    """Compute the roughness parameters of a profile.

    Parameters
    ----------
    heights
        In m, equally spaced; at least two cut-offs long.
    step
        Between heights, in m.
    cutoff
        Of the Gaussian filter, in m.
    periodic
        Whether the profile repeats, so that it has no ends to leave out.

    Raises
    ------
    ValueError
        If the profile is shorter than two cut-offs and not periodic.

    Examples
    --------
    >>> place = np.arange(0, 10e-3, 1e-6)
    >>> sine = measure_profile(5e-6 * np.sin(2 * np.pi * place / 0.1e-3), step=1e-6)
    >>> round(sine.ra * 1e6, 2), round(2 * 5 / math.pi, 2), round(sine.rsm * 1e3, 3), round(sine.rdq, 3)
    (3.18, 3.18, 0.1, 0.222)
    """
    rough = roughness_profile(heights, step=step, cutoff=cutoff, periodic=periodic)
    rough = rough - rough.mean()
    rq = float(np.sqrt(np.square(rough).mean()))
    rz = _rz(rough, round(cutoff / step))
    skewness, kurtosis = (float((rough**power).mean()) / rq**power if rq else float("nan") for power in (3, 4))
    rsm = _rsm(rough, LEAST_ELEMENT * rz) * step
    return Roughness(float(np.abs(rough).mean()), rq, rz, skewness, kurtosis, rsm, _rms_slope(rough, step, periodic))


def roughness_profile(heights: Profile, *, step: float, cutoff: float = CUTOFF, periodic: bool = False) -> Profile:
    """Return heights less the Gaussian mean line; parameters and errors as in :func:`measure_profile`.

    The result is half a cut-off shorter at either end; as long as ``heights`` if periodic.
    """
    if periodic:
        wavenumber = np.fft.rfftfreq(heights.size, step)
        roughness_share = 1 - np.exp(-math.pi * np.square(ALPHA * cutoff * wavenumber))
        return np.asarray(np.fft.irfft(np.fft.rfft(heights) * roughness_share, heights.size))
    half = round(cutoff / 2 / step)
    if len(heights) < 4 * half or half < 2:
        raise ValueError(
            f"a profile of {len(heights)} heights {step:g} m apart is too short: at a cut-off of {cutoff:g} m it must "
            "be at least two cut-offs long, with five heights or more in each"
        )
    middle = heights - heights.mean()
    return np.asarray((middle - gaussian_line(middle, step=step, cutoff=cutoff))[half : len(middle) - half])


def gaussian_line(heights: Profile, *, step: float, cutoff: float) -> Profile:
    """Return the Gaussian mean line of profiles along the last axis (ISO 16610-21); near the ends it is pulled to 0.

    ``heights`` has the shape ``(..., heights)`` and mean zero; all are in m.
    """
    half = max(1, round(cutoff / 2 / step))
    place = np.arange(-2 * half, 2 * half + 1) * step / (ALPHA * cutoff)
    weights = np.exp(-math.pi * np.square(place))
    # By FFT: a cut-off may hold a thousand heights.
    size = heights.shape[-1] + len(weights) - 1
    spectrum = np.fft.rfft(heights, size) * np.fft.rfft(weights / weights.sum(), size)
    return np.asarray(np.fft.irfft(spectrum, size)[..., 2 * half : 2 * half + heights.shape[-1]])


def standard_cutoff(ra: float) -> float:
    """Return the cut-off in m that ISO 21920-3 (table for non-periodic profiles, as ISO 4288) names for an Ra in m.

    >>> standard_cutoff(1e-6), standard_cutoff(5e-6)
    (0.0008, 0.0025)
    """
    return next((cutoff for most, cutoff in STANDARD_CUTOFFS if ra <= most), STANDARD_CUTOFFS[-1][1])


def choose_cutoff(heights: Profile, *, step: float) -> tuple[float, bool]:
    """Choose the cut-off of a profile by its own Ra.

    Returns it in m, and whether the profile was long enough for the one that the standard names.
    """
    fitting = [cutoff for _, cutoff in STANDARD_CUTOFFS if 2 * cutoff <= step * len(heights) and cutoff >= 4 * step]
    if not fitting:
        raise ValueError(
            f"{len(heights)} heights {step:g} m apart are too few for any cut-off: the shortest of the standard is "
            f"{STANDARD_CUTOFFS[0][1]:g} m, and two must fit; measure a longer line"
        )
    # From the shortest: Ra grows with the cut-off, and the first that agrees with its own Ra is the standard's.
    for cutoff in fitting:
        if standard_cutoff(measure_profile(heights, step=step, cutoff=cutoff).ra) <= cutoff:
            return cutoff, True
    return fitting[-1], False


def _rms_slope(rough: Profile, step: float, periodic: bool) -> float:
    """Root mean square slope by the difference of seven heights that ISO 21920-2 and ISO 4287 name."""
    padded = np.pad(rough, 3, mode="wrap") if periodic else rough
    if len(padded) < 7:
        return float("nan")
    slope = np.convolve(padded, SLOPE_WEIGHTS, mode="valid") / (60 * step)
    return float(np.sqrt(np.square(slope).mean()))


def _rz(rough: Profile, size: int) -> float:
    count = max(1, min(LENGTHS, len(rough) // max(size, 1)))
    return float(np.mean([part.max() - part.min() for part in np.array_split(rough[: count * size], count)]))


def _rsm(rough: Profile, least: float) -> float:
    """Mean width of elements, in heights: from one up-crossing to the next, peak and valley both high enough."""
    beyond = np.flatnonzero(np.abs(rough) >= least)
    sides = np.sign(rough[beyond])
    # Small wiggles between two excursions on the same side are not crossings.
    ups = np.flatnonzero((sides[:-1] < 0) & (sides[1:] > 0))
    crossings = [_crossing(rough, int(beyond[up]), int(beyond[up + 1])) for up in ups]
    return float(np.diff(crossings).mean()) if len(crossings) > 1 else float("nan")


def _crossing(rough: Profile, low: int, high: int) -> float:
    """Where the profile first rises through the mean line between two indices, to a fraction of a step."""
    part = rough[low : high + 1]
    at = int(np.flatnonzero((part[:-1] < 0) & (part[1:] >= 0))[0])
    return low + at + float(part[at] / (part[at] - part[at + 1]))
