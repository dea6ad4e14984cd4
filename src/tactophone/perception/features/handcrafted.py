"""Handcrafted features: loudness, impacts, spectral centroid, median frequency.

Level, crest and transients are the paper's hand-made classifier (section III-C: rough is louder and more transient);
the median frequency of a microphone's signal drives the stimulus in Svensson et al. (2021).
"""

import numpy as np
from numpy.typing import NDArray

from tactophone.types import AIR, CONTACT, FloatArray

CUES = ("level_db", "crest_db", "transients_db", "centroid_octaves", "median_octaves", "air_to_contact_db")
"""The values of :func:`cues`, in order; octaves are over 1 Hz."""

LOWEST = 100.0
"""Hz; hum and motors are under it."""

PIECE_DURATION = 0.004
"""Seconds over which a transient's level is measured: a tap on stone rings for about so long."""

FAINT = 1e-10
"""Power, -100 dBFS, added to every power: it counts as silence."""


def cues(window: FloatArray, sample_rate: int) -> NDArray[np.float64]:
    """Compute :data:`CUES` of a window ``(samples, channels)``; all but the last are of channel 0.

    Examples
    --------
    >>> sine = np.sin(2 * np.pi * 500 * np.arange(4096) / 16_000).astype(np.float32)[:, None]
    >>> dict(zip(CUES, cues(sine, 16_000).round(1).tolist()))["crest_db"]
    3.0
    """
    contact = window[:, CONTACT].astype(np.float64)
    power = np.square(contact).mean() + FAINT
    peak = np.square(contact).max() + FAINT
    air = np.square(window[:, AIR].astype(np.float64)).mean() + FAINT if window.shape[1] > AIR else np.nan
    centroid, median = _frequencies(contact, sample_rate)
    levels = 10 * np.log10([power, peak / power, _transients(contact, round(PIECE_DURATION * sample_rate))])
    return np.array([*levels, np.log2(centroid), np.log2(median), 10 * np.log10(air / power)])


def _transients(sound: NDArray[np.float64], size: int) -> float:
    """Return the power of the loudest pieces (one in twenty) over that of the median piece."""
    pieces = np.square(sound[: len(sound) // size * size]).reshape(-1, size).mean(axis=1) + FAINT
    return float(np.quantile(pieces, 0.95) / np.median(pieces))


def _frequencies(sound: NDArray[np.float64], sample_rate: int) -> tuple[float, float]:
    """Return the centroid of the power spectrum, and the frequency with half of the power on either side."""
    bins = np.fft.rfftfreq(len(sound), 1 / sample_rate)
    powers = np.square(np.abs(np.fft.rfft(sound * np.hanning(len(sound))))) * (bins >= LOWEST) + FAINT
    total = np.cumsum(powers)
    median = bins[np.searchsorted(total, total[-1] / 2)]
    return float(max(powers @ bins / total[-1], LOWEST)), float(max(median, LOWEST))
