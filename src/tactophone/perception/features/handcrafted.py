"""Cues that people tried before networks: loudness, impacts, spectral centroid, median frequency.

Level, crest and transients are the paper's hand-made classifier (section III-C: rough is louder and more transient);
the median frequency of a microphone's signal drives the stimulus in Svensson et al. (2021).
"""

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.model_file import ModelCard
from tactophone.types import AIR, CONTACT, FloatArray

CUES = ("level_db", "crest_db", "transients_db", "centroid_octaves", "median_octaves", "air_to_contact_db")
"""What :func:`cues` gives, in order; octaves are over 1 Hz."""

LOWEST = 100.0
"""Hz; hum and motors lie under it."""

PIECE_DURATION = 0.004
"""Seconds over which a transient's level is taken: a tap on stone rings for about so long."""

FAINT = 1e-10
"""Power, -100 dBFS, that counts as silence."""


class HandcraftedExtractor:
    """Gives the cues of each window; features of kind ``cues``."""

    def __init__(self, card: ModelCard) -> None:
        self._sample_rate = card.sample_rate

    def push(self, window: FloatArray, *, contact: bool) -> FloatArray:
        """Give the cues, in the order of :data:`CUES`; the last is NaN for sound of one channel."""
        del contact
        return cues(window, self._sample_rate).astype(np.float32)

    def reset(self) -> None:
        """Do nothing: each window speaks for itself."""


def cues(window: FloatArray, sample_rate: int) -> NDArray[np.float64]:
    """Compute the cues of a window.

    Parameters
    ----------
    window
        Shape ``(samples, channels)``; all cues but the last are of channel 0.
    sample_rate
        In Hz.

    Examples
    --------
    >>> sine = np.sin(2 * np.pi * 500 * np.arange(4096) / 16_000).astype(np.float32)[:, None]
    >>> dict(zip(CUES, cues(sine, 16_000).round(1).tolist()))["crest_db"]
    3.0
    """
    contact = window[:, CONTACT].astype(np.float64)
    power = np.square(contact).mean() + FAINT
    peak = np.square(contact).max() + FAINT
    centroid, median = _frequencies(contact, sample_rate)
    return np.array(
        [
            _db(power),
            _db(peak / power),
            _db(_transients(contact, round(PIECE_DURATION * sample_rate))),
            np.log2(centroid),
            np.log2(median),
            _air_to_contact(window, power),
        ]
    )


def _transients(sound: NDArray[np.float64], size: int) -> float:
    """Power of the loudest pieces (one in twenty) over the median piece."""
    pieces = np.square(sound[: len(sound) // size * size]).reshape(-1, size).mean(axis=1) + FAINT
    return float(np.quantile(pieces, 0.95) / np.median(pieces))


def _frequencies(sound: NDArray[np.float64], sample_rate: int) -> tuple[float, float]:
    """Centroid of the spectrum's power, and the frequency with half of it on either side."""
    bins = np.fft.rfftfreq(len(sound), 1 / sample_rate)
    powers = np.square(np.abs(np.fft.rfft(sound * np.hanning(len(sound))))) * (bins >= LOWEST) + FAINT
    total = np.cumsum(powers)
    median = bins[np.searchsorted(total, total[-1] / 2)]
    return float(max(powers @ bins / total[-1], LOWEST)), float(max(median, LOWEST))


def _air_to_contact(window: FloatArray, contact_power: float) -> float:
    if window.shape[1] <= AIR:
        return float("nan")
    return _db((np.square(window[:, AIR].astype(np.float64)).mean() + FAINT) / contact_power)


def _db(power: float) -> float:
    return float(10 * np.log10(power))
