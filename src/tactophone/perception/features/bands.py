"""What one short window tells of a surface: its loudness in bands, and how jagged its waveform is.

Sixteen bands, spaced evenly in mel from 40 Hz to 7.6 kHz, as powers on a log scale: rough surfaces differ from smooth
ones up there more than under the paper's 1 kHz (docs/detector.md). Four numbers describe the newest half of the
window's waveform: its level, its crest (peak over RMS), its clicks (fourth moment of the slope over the squared
second: 3 for Gaussian noise, more for separate impacts) and its steepness (power of the slope over power).
"""

from typing import NamedTuple

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

SHAPED = np.array([[1, -0.5, 0, -1], [0, 0, -2, 1], [0, 0, 1, 0], [0, 1, 0, 0]], np.float32)
"""Makes the four shapes (level, crest, clicks, steepness: columns) of the logarithms of what is measured (rows): power,
the slope's power and its fourth moment, peak."""


class BandFeatures(NamedTuple):
    """A window, channels first: its sound ``(..., channels, samples)``, and its powers ``(..., channels, 2 * bins)``.

    Powers are those of the real and of the imaginary part of each bin of the tapered spectrum, in turn.
    """

    sound: FloatArray
    powers: FloatArray


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
    >>> bands = Bands(512, 16_000)
    >>> bands.describe(bands.hear(np.zeros((512, 2), np.float32))).shape
    (2, 20)
    """

    def __init__(self, size: int, sample_rate: int) -> None:
        # A periodic Hann window; its power and that of the two sides of a real spectrum are divided out, so that
        # the bands of white noise read its power per bin whatever the size.
        taper = np.hanning(size + 1)[:-1]
        power = np.square(taper).sum() * size / 2
        # A row for the real and one for the imaginary part of each bin, as they lie in memory. Single precision is
        # half the time, and its errors lie 120 dB under the loudest band.
        self._banks = np.repeat(design_bands(size, sample_rate) / power, 2, axis=0).astype(np.float32)
        self._taper = taper.astype(np.float32)
        self._floors = np.array([FLOOR] * BANDS + [FAINT, FAINT, FAINT**2, FAINT**0.5], np.float32)
        self._newest = size // 2
        slopes = self._newest - 1
        self._scales = np.array([1.0] * BANDS + [1 / self._newest, 1 / slopes, 1 / slopes, 1], np.float32)

    def hear(self, window: FloatArray) -> BandFeatures:
        """Take a window's spectrum.

        Parameters
        ----------
        window
            Shape ``(..., samples, channels)``; leading axes are a batch.
        """
        sound = np.ascontiguousarray(window.swapaxes(-1, -2))
        spectrum = np.fft.rfft(sound * self._taper).view(np.float32)
        return BandFeatures(sound, spectrum * spectrum)

    def describe(self, heard: BandFeatures) -> FloatArray:
        """Describe each channel.

        Returns
        -------
        Shape ``(..., channels, VALUES)``: log10 of the power in each band, then the four shapes.
        """
        sound, powers = heard
        values = np.empty((*sound.shape[:-1], VALUES), np.float32)
        np.matmul(powers, self._banks, out=values[..., :BANDS])
        _measure(sound[..., -self._newest :], out=values[..., BANDS:])
        values *= self._scales
        values += self._floors
        np.log10(values, out=values)
        values[..., BANDS:] = values[..., BANDS:] @ SHAPED
        return values


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


def _measure(sound: FloatArray, *, out: FloatArray) -> None:
    """Measure energy, the slope's energy, the sum of its fourth powers, and the peak."""
    slope = sound[..., 1:] - sound[..., :-1]
    squares = slope * slope
    out[..., 0] = np.vecdot(sound, sound)
    out[..., 1] = np.vecdot(slope, slope)
    out[..., 2] = np.vecdot(squares, squares)
    out[..., 3] = np.maximum.reduce(np.abs(sound), axis=-1)


def _to_mel(frequency: float) -> float:
    return float(2595 * np.log10(1 + frequency / 700))


def _from_mel(mel: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(700 * (10 ** (mel / 2595) - 1))
