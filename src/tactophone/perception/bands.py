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
VALUES = BANDS + SHAPES
"""Numbers that describe one channel of a window."""

FLOOR = 1e-9
"""Power that counts as nothing, -90 dBFS in a band: what is under it is the converter's noise."""

FAINT = 1e-12
"""The same for a waveform's moments, which are taken of all bands together."""

Description = NDArray[np.float64]


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
        self._banks = design_bands(size, sample_rate) / power
        self._newest = size // 2

    def describe(self, window: FloatArray) -> Description:
        """Describe each channel.

        Parameters
        ----------
        window
            Shape ``(..., samples, channels)``; leading axes are a batch.

        Returns
        -------
        Shape ``(..., channels, VALUES)``: log10 of the power in each band, then the four shapes.
        """
        sound = np.swapaxes(window, -1, -2).astype(np.float64)
        spectrum = np.fft.rfft(sound * self._taper)
        powers = (np.square(spectrum.real) + np.square(spectrum.imag)) @ self._banks
        return np.concatenate((np.log10(powers + FLOOR), _shapes(sound[..., -self._newest :])), axis=-1)


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


def _shapes(sound: NDArray[np.float64]) -> Description:
    power = np.square(sound).mean(axis=-1)
    peak = np.abs(sound).max(axis=-1)
    slope = np.square(np.diff(sound))
    slope_power, slope_fourth = slope.mean(axis=-1), np.square(slope).mean(axis=-1)
    shapes: Description = np.log10(
        np.stack(
            [
                power + FAINT,
                np.sqrt((peak**2 + FAINT) / (power + FAINT)),
                (slope_fourth + FAINT**2) / (slope_power + FAINT) ** 2,
                (slope_power + FAINT) / (power + FAINT),
            ],
            axis=-1,
        )
    )
    return shapes


def _to_mel(frequency: float) -> float:
    return float(2595 * np.log10(1 + frequency / 700))


def _from_mel(mel: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(700 * (10 ** (mel / 2595) - 1))
