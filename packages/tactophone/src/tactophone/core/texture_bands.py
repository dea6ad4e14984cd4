"""The sixteen bands in which the texture detector hears a window: training builds them
into the model's graph, and a page draws them."""

import numpy as np
from numpy.typing import NDArray

BAND_COUNT = 16
"""Frequency bands among the values that describe one channel of a window in texture
features."""

LOWEST_HZ = 40.0
"""Lower end of the lowest band."""

HIGHEST_HZ = 7600.0
"""Upper end of the highest band. Above it public recordings contain nothing of the
surface, only their own noise floor."""

POWER_FLOOR = 1e-9
"""Power added to each band, -90 dBFS: what is under it is the converter's noise."""


def band_edges() -> NDArray[np.float64]:
    """Return where the triangular bands begin, peak and end, in Hz: band ``k`` has its
    peak at ``[k + 1]``; shape ``(BAND_COUNT + 2,)``.

    Source: the mel scale of O'Shaughnessy, "Speech Communication" (1987), 2595 log10(1
    + f / 700).

    >>> band_edges().round()[[0, 1, -2, -1]].tolist()
    [40.0, 153.0, 6500.0, 7600.0]
    """
    lowest, highest = 2595 * np.log10(1 + np.array([LOWEST_HZ, HIGHEST_HZ]) / 700)
    mels = np.linspace(lowest, highest, BAND_COUNT + 2)
    return np.asarray(700 * (10 ** (mels / 2595) - 1))


def design_bands(size: int, sample_rate: float) -> NDArray[np.float64]:
    """Return triangular bands that overlap by half; shape ``(size // 2 + 1,
    BAND_COUNT)``, each column sums to 1."""
    edges = band_edges()
    bins = np.fft.rfftfreq(size, 1 / sample_rate)[:, None]
    low = edges[:-2]
    middle = edges[1:-1]
    high = edges[2:]
    bands = np.clip(
        np.minimum((bins - low) / (middle - low), (high - bins) / (high - middle)),
        0,
        None,
    )
    # A narrow low band may fall between two bins; it then takes the nearer one.
    empty = np.flatnonzero(~bands.any(axis=0))
    bands[np.abs(bins - middle[empty]).argmin(axis=0), empty] = 1
    return np.asarray(bands / bands.sum(axis=0))
