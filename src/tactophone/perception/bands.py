"""What one short window tells of a surface: its loudness in bands, and how jagged its waveform is.

Sixteen bands, spaced evenly in mel from 40 Hz to 7.6 kHz, as powers on a log scale: rough surfaces differ from smooth
ones up there more than under the paper's 1 kHz (docs/detector.md). Four numbers describe the newest half of the
window's waveform: its level, its crest (peak over RMS), its clicks (fourth moment of the slope over the squared
second: 3 for Gaussian noise, more for separate impacts) and its steepness (power of the slope over power).
"""

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

BANDS = 16
LOWEST, HIGHEST = 40.0, 7600.0
"""Hz. The recordings at hand hold nothing of the surface over 7.6 kHz, only their own noise floor (findings.md)."""

SHAPES = 4
CREST = BANDS + 1
"""Where the crest stands among the values."""

VALUES = BANDS + SHAPES
"""Numbers that describe one channel of a window."""

FLOOR = 1e-9
"""Power that counts as nothing, -90 dBFS in a band: what is under it is the converter's noise."""

FAINT = 1e-12
"""The same for a waveform's moments, which are taken of all bands together."""


class Bands:
    """Describes windows of a fixed size and rate.

    Parameters
    ----------
    size
        Samples a window.
    sample_rate
        In Hz; 15.2 kHz or more, or the highest bands stay empty.

    Examples
    --------
    >>> Bands(512, 16_000).describe(np.zeros((512, 2), np.float32)).shape
    (2, 20)
    """

    def __init__(self, size: int, sample_rate: int) -> None:
        # A periodic Hann window; its power and that of the two sides of a real spectrum are divided out, so that
        # the bands of white noise read its power per bin whatever the size.
        self._taper = np.hanning(size + 1)[:-1]
        power = np.square(self._taper).sum() * size / 2
        # A row for the real and one for the imaginary part of each bin, as they lie in memory.
        self._banks = np.repeat(design_bands(size, sample_rate) / power, 2, axis=0)
        self._newest = size // 2

    def describe(self, window: FloatArray) -> FloatArray:
        """Describe each channel.

        Parameters
        ----------
        window
            Shape ``(..., samples, channels)``; leading axes are a batch.

        Returns
        -------
        Shape ``(..., channels, VALUES)``: log10 of the power in each band, then the four shapes.
        """
        sound = np.ascontiguousarray(np.swapaxes(window, -1, -2), np.float64)
        spectrum = np.fft.rfft(sound * self._taper).view(np.float64)
        powers = (spectrum * spectrum) @ self._banks + FLOOR
        powers_and_shapes = np.concatenate((powers, _shapes(sound[..., -self._newest :])), axis=-1)
        return np.asarray(np.log10(powers_and_shapes), np.float32)


def design_bands(size: int, sample_rate: int) -> NDArray[np.float64]:
    """Make triangular bands that overlap by half; shape ``(size // 2 + 1, BANDS)``, each column sums to 1.

    Source: the mel scale of O'Shaughnessy, "Speech Communication" (1987), 2595 log10(1 + f / 700).
    """
    edges = _from_mel(np.linspace(_to_mel(LOWEST), _to_mel(HIGHEST), BANDS + 2))
    bins = np.fft.rfftfreq(size, 1 / sample_rate)[:, None]
    low, middle, high = edges[:-2], edges[1:-1], edges[2:]
    bands = np.clip(np.minimum((bins - low) / (middle - low), (high - bins) / (high - middle)), 0, None)
    # A narrow low band may fall between two bins; it then takes the nearer one.
    empty = np.flatnonzero(~bands.any(axis=0))
    bands[np.abs(bins - middle[empty]).argmin(axis=0), empty] = 1
    return np.asarray(bands / bands.sum(axis=0))


def _shapes(sound: NDArray[np.float64]) -> NDArray[np.float64]:
    shapes = np.empty((*sound.shape[:-1], SHAPES))
    size = sound.shape[-1]
    slope = sound[..., 1:] - sound[..., :-1]
    squares = slope * slope
    power = _dot(sound, sound) / size + FAINT
    slope_power = _dot(slope, slope) / (size - 1) + FAINT
    shapes[..., 0] = power
    shapes[..., 1] = np.sqrt((np.abs(sound).max(axis=-1) ** 2 + FAINT) / power)
    shapes[..., 2] = (_dot(squares, squares) / (size - 1) + FAINT**2) / slope_power**2
    shapes[..., 3] = slope_power / power
    return shapes


def _dot(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum the products along the last axis, with no array of them."""
    return np.asarray(np.einsum("...i,...i->...", one, other))


def _to_mel(frequency: float) -> float:
    return float(2595 * np.log10(1 + frequency / 700))


def _from_mel(mel: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(700 * (10 ** (mel / 2595) - 1))
