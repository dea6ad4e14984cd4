"""Features of one short window: its power in bands, and the shape of its waveform.

Sixteen bands, spaced evenly in mel from 40 Hz to 7.6 kHz, as powers on a log scale: rough and smooth surfaces differ
more up there than under the paper's 1 kHz (docs/research/detector.md). Four values describe the newest half of the
window's waveform: its level, its crest (peak over RMS), its clicks (fourth moment of the slope over the squared
second: 3 for Gaussian noise, more for separate impacts) and its steepness (power of the slope over power).

Under a hard tip there is one value more, the unevenness of the treble: standard deviation over mean of its envelope in
steps of a millisecond. Single strikes of a hard tip ring for a few milliseconds; a smooth surface's treble is even.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.features.real_fft import real_fft
from tactophone.types import FloatArray

BAND_COUNT = 16
LOWEST, HIGHEST = 40.0, 7600.0
"""Hz. Above 7.6 kHz public recordings contain nothing of the surface, only their own noise floor."""

SHAPES = 4
CREST_INDEX = BAND_COUNT + 1
"""Index of the crest among the values."""

BAND_VALUES = BAND_COUNT + SHAPES
"""Values that describe one channel of a window."""

FLOOR = 1e-9
"""Power added to each band, -90 dBFS: what is under it is the converter's noise."""

FAINT = 1e-12
"""The same for a waveform's moments, which cover all bands together."""

TREBLE_FROM = 2000.0
"""Hz: lowest frequency of the treble whose unevenness is measured."""

_TREBLE_TAPS = 33
"""Of its high-pass: 2 ms, short beside a window; it falls from -1 to -30 dB between 2.4 and 1.3 kHz at 16 kHz."""

_ENVELOPE_STEP = 1e-3
"""Seconds of a step of its envelope."""

LEAST_POWER, LEAST_SHARE = 1e-14, 1e-6
"""Of the treble, and of its variance over its squared mean: silence and a steady tone have finite logarithms."""

_SHAPE_MATRIX = np.array([[1, -0.5, 0, -1], [0, 0, -2, 1], [0, 0, 1, 0], [0, 1, 0, 0]], np.float32)
"""From the logarithms of four measures (rows: power, the slope's power and fourth moment, peak) to the four shapes
(columns: level, crest, clicks, steepness)."""


class WindowSpectrum(NamedTuple):
    """A window, channels first: its sound ``(..., channels, samples)``, and its powers ``(..., channels, 2 * bins)``.

    Powers are those of the real and of the imaginary part of each bin of the tapered spectrum, alternating.
    """

    sound: FloatArray
    powers: FloatArray


class BandFeatures:
    """Describes windows of a fixed size and rate, with or without the unevenness of the treble.

    Under 15.2 kHz the highest bands stay empty.

    Examples
    --------
    >>> bands = BandFeatures(512, 16_000)
    >>> bands.describe(bands.spectrum(np.zeros((512, 2), np.float32))).shape
    (2, 20)
    """

    def __init__(self, size: int, sample_rate: int, *, unevenness: bool = False) -> None:
        self._high_pass = _design_high_pass(sample_rate) if unevenness else None
        self._step = round(_ENVELOPE_STEP * sample_rate)
        # A periodic Hann window; its power and that of the two sides of a real spectrum are divided out, so that
        # the bands of white noise show its power per bin at any size.
        taper = np.hanning(size + 1)[:-1]
        power = np.square(taper).sum() * size / 2
        # A row for the real and one for the imaginary part of each bin, in their order in memory. Single precision
        # takes half the time, and its errors are 120 dB under the loudest band.
        self._banks = np.repeat(design_bands(size, sample_rate) / power, 2, axis=0).astype(np.float32)
        self._taper = taper.astype(np.float32)
        self._floors = np.array([FLOOR] * BAND_COUNT + [FAINT, FAINT, FAINT**2, FAINT**0.5], np.float32)
        self._newest = size // 2
        slopes = self._newest - 1
        self._scales = np.array([1.0] * BAND_COUNT + [1 / self._newest, 1 / slopes, 1 / slopes, 1], np.float32)

    def spectrum(self, window: FloatArray) -> WindowSpectrum:
        """Return the spectrum of windows of shape ``(..., samples, channels)``."""
        sound = np.ascontiguousarray(window.swapaxes(-1, -2))
        # Complex bins viewed as floats: real and imaginary parts alternate, and one product squares both.
        parts = real_fft(sound * self._taper).view(np.float32)
        return WindowSpectrum(sound, np.multiply(parts, parts, out=parts))

    def describe(self, spectrum: WindowSpectrum) -> FloatArray:
        """Describe each channel.

        Shape ``(..., channels, BAND_VALUES)``: log10 of the power in each band, then the four shapes; one value more
        with the unevenness.
        """
        sound, powers = spectrum
        # Bands and waveform measures stand side by side in one array, so that they are scaled and logged together.
        values = np.empty((*sound.shape[:-1], BAND_VALUES), np.float32)
        np.matmul(powers, self._banks, out=values[..., :BAND_COUNT])
        _measure(sound[..., -self._newest :], out=values[..., BAND_COUNT:])
        values *= self._scales
        values += self._floors
        np.log10(values, out=values)
        values[..., BAND_COUNT:] = values[..., BAND_COUNT:] @ _SHAPE_MATRIX
        if self._high_pass is None:
            return values
        return np.concatenate((values, _unevenness(sound, self._high_pass, self._step)[..., None]), axis=-1)


def design_bands(size: int, sample_rate: int) -> NDArray[np.float64]:
    """Return triangular bands that overlap by half; shape ``(size // 2 + 1, BAND_COUNT)``, each column sums to 1.

    Source: the mel scale of O'Shaughnessy, "Speech Communication" (1987), 2595 log10(1 + f / 700).
    """
    lowest, highest = 2595 * np.log10(1 + np.array([LOWEST, HIGHEST]) / 700)
    edges = 700 * (10 ** (np.linspace(lowest, highest, BAND_COUNT + 2) / 2595) - 1)
    bins = np.fft.rfftfreq(size, 1 / sample_rate)[:, None]
    low, middle, high = edges[:-2], edges[1:-1], edges[2:]
    bands = np.clip(np.minimum((bins - low) / (middle - low), (high - bins) / (high - middle)), 0, None)
    # A narrow low band may fall between two bins; it then takes the nearer one.
    empty = np.flatnonzero(~bands.any(axis=0))
    bands[np.abs(bins - middle[empty]).argmin(axis=0), empty] = 1
    return np.asarray(bands / bands.sum(axis=0))


def _design_high_pass(sample_rate: int) -> FloatArray:
    """Return the taps of a linear-phase high-pass: a windowed sinc (Hamming), of unit gain at the highest frequency."""
    place = np.arange(_TREBLE_TAPS) - _TREBLE_TAPS // 2
    cutoff = 2 * TREBLE_FROM / sample_rate
    taps = ((place == 0) - cutoff * np.sinc(cutoff * place)) * np.hamming(_TREBLE_TAPS)
    return np.asarray(taps / abs((taps * (-1.0) ** place).sum()), np.float32)


def _unevenness(sound: FloatArray, high_pass: FloatArray, step: int) -> FloatArray:
    """Return log10 of the envelope's deviation over its mean, of sound of shape ``(..., samples)``; ``(...)``."""
    rows = sound.reshape(-1, sound.shape[-1])
    # One by one: a product with a view of all places takes ten times as long.
    treble = np.array([np.convolve(row, high_pass, "valid") for row in rows])
    steps = treble.shape[-1] // step
    pieces = treble[:, -steps * step :].reshape(len(rows), steps, step)
    powers = np.vecdot(pieces, pieces) / step + LEAST_POWER
    mean = np.add.reduce(np.sqrt(powers), axis=-1) / steps
    share = np.add.reduce(powers, axis=-1) / (steps * mean * mean) - 1
    return np.asarray(np.log10(np.maximum(share, LEAST_SHARE)) / 2).reshape(sound.shape[:-1])


def _measure(sound: FloatArray, *, out: FloatArray) -> None:
    """Measure energy, the slope's energy, the sum of its fourth powers, and the peak."""
    slope = sound[..., 1:] - sound[..., :-1]
    squares = slope * slope
    out[..., 0] = np.vecdot(sound, sound)
    out[..., 1] = np.vecdot(slope, slope)
    out[..., 2] = np.vecdot(squares, squares)
    out[..., 3] = np.maximum.reduce(np.abs(sound), axis=-1)
