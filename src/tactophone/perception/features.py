"""The features of each kind of model, from windows of sound.

``texture``: sixteen bands, spaced evenly in mel from 40 Hz to 7.6 kHz, as powers on a log scale, since rough and smooth
surfaces differ more up there than under the paper's 1 kHz (docs/research/detector.md); and four values of the newest
half of the window's waveform: its level, its crest (peak over RMS), its clicks (fourth moment of the slope over the
squared second: 3 for Gaussian noise, more for separate impacts) and its steepness (power of the slope over power).
Under a hard tip there is one value more, the unevenness of the treble: standard deviation over mean of its envelope in
steps of a millisecond. Single strikes of a hard tip ring for a few milliseconds; a smooth surface's treble is even.
`tactophone.perception.texture` turns these values into running statistics of a touch.

``paper``: the magnitudes of a window's spectrum. They are not normalised (paper, section III): the level of the air
microphone relative to the contact microphone separates rough from smooth.

``scalogram``: log band powers over time, as a convolutional network classifies tyre noise on road surfaces.

``cues``: level, crest and transients are the paper's hand-made classifier (section III-C: rough is louder and more
transient); the median frequency of a microphone's signal drives the stimulus in Svensson et al. (2021).
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.perception.levels import LOUDNESS, LoudnessRule, band_of_powers
from tactophone.perception.model_file import ModelCard
from tactophone.perception.texture import MEMORY, SILENT_POWER, RunningStatistics, fading_of, texture_features
from tactophone.types import AIR, CONTACT, FloatArray

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
        parts = np.fft.rfft(sound * self._taper).view(np.float32)
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


def magnitudes(window: FloatArray) -> FloatArray:
    """Return the magnitude of each channel's real FFT, concatenated; of windows ``(..., samples, channels)``.

    Shape ``(..., (samples // 2 + 1) * channels)``, float32: all of channel 0, then all of channel 1.

    >>> magnitudes(np.ones((512, 2), np.float32)).shape
    (514,)
    >>> float(magnitudes(np.ones((512, 2), np.float32))[257])
    512.0
    """
    # Sound is (samples, channels), a spectrum is (channels, bins).
    sound = window.swapaxes(-1, -2)
    flat: FloatArray = np.abs(np.fft.rfft(sound)).reshape(*sound.shape[:-2], -1)
    return flat


SPAN, STRIDE = 512, 160
"""Samples of each column, and from one to the next: 32 and 10 ms at 16 kHz."""


class LogSpectrogram:
    """Computes the spectrogram of a window, flattened; features of kind ``scalogram``."""

    def __init__(self, sample_rate: int) -> None:
        self._taper = np.hanning(SPAN + 1)[:-1].astype(np.float32)
        power = np.square(self._taper).sum() * SPAN / 2
        self._banks = (design_bands(SPAN, sample_rate) / power).astype(np.float32)

    def of(self, window: FloatArray) -> FloatArray:
        """Return log10 of the band powers of a window, in the order channel, band, time."""
        pieces = sliding_window_view(window, SPAN, axis=0)[::STRIDE]
        spectra = np.fft.rfft(pieces * self._taper)
        powers = (np.square(spectra.real) + np.square(spectra.imag)) @ self._banks
        spectrogram: FloatArray = np.log10(powers + FLOOR, dtype=np.float32)
        # From (time, channel, band).
        return spectrogram.transpose(1, 2, 0).reshape(-1)


CUES = ("level_db", "crest_db", "transients_db", "centroid_octaves", "median_octaves", "air_to_contact_db")
"""The values of :func:`cues`, in order; octaves are over 1 Hz."""

CUES_FROM = 100.0
"""Hz; hum and motors are under it."""

PIECE_DURATION = 0.004
"""Seconds over which a transient's level is measured: a tap on stone rings for about so long."""

FAINT_POWER = 1e-10
"""Power, -100 dBFS, added to every power: it counts as silence."""


def cues(window: FloatArray, sample_rate: int) -> NDArray[np.float64]:
    """Compute :data:`CUES` of a window ``(samples, channels)``; all but the last are of channel 0.

    >>> sine = np.sin(2 * np.pi * 500 * np.arange(4096) / 16_000).astype(np.float32)[:, None]
    >>> dict(zip(CUES, cues(sine, 16_000).round(1).tolist()))["crest_db"]
    3.0
    """
    contact = window[:, CONTACT].astype(np.float64)
    power = np.square(contact).mean() + FAINT_POWER
    peak = np.square(contact).max() + FAINT_POWER
    air = np.square(window[:, AIR].astype(np.float64)).mean() + FAINT_POWER if window.shape[1] > AIR else np.nan
    centroid, median = _frequencies(contact, sample_rate)
    levels = 10 * np.log10([power, peak / power, _transients(contact, round(PIECE_DURATION * sample_rate))])
    return np.array([*levels, np.log2(centroid), np.log2(median), 10 * np.log10(air / power)])


def _transients(sound: NDArray[np.float64], size: int) -> float:
    """Return the power of the loudest pieces (one in twenty) over that of the median piece."""
    pieces = np.square(sound[: len(sound) // size * size]).reshape(-1, size).mean(axis=1) + FAINT_POWER
    return float(np.quantile(pieces, 0.95) / np.median(pieces))


def _frequencies(sound: NDArray[np.float64], sample_rate: int) -> tuple[float, float]:
    """Return the centroid of the power spectrum, and the frequency with half of the power on either side."""
    bins = np.fft.rfftfreq(len(sound), 1 / sample_rate)
    powers = np.square(np.abs(np.fft.rfft(sound * np.hanning(len(sound))))) * (bins >= CUES_FROM) + FAINT_POWER
    total = np.cumsum(powers)
    median = bins[np.searchsorted(total, total[-1] / 2)]
    return float(max(powers @ bins / total[-1], CUES_FROM)), float(max(median, CUES_FROM))


class Extractor(Protocol):
    """Turns windows into the features that a model's network takes: first what each holds, then its place in a touch.

    Several fingers with the same model are described together, and then each pushed to its own extractor.
    """

    def describe(self, windows: FloatArray) -> Sequence[Any]:
        """Return a description of each window; shape ``(windows, samples, channels)``. It depends on that one alone."""

    def push(self, description: Any, *, contact: bool) -> FloatArray:
        """Return the features, shape ``(features,)``, of the newest window by its description."""

    def reset(self) -> None:
        """Forget the touch so far."""


class MemorylessExtractor:
    """Returns what a function computes from each window alone."""

    def __init__(self, features_of: Callable[[FloatArray], FloatArray]) -> None:
        self._features_of = features_of

    def describe(self, windows: FloatArray) -> list[FloatArray]:
        return [self._features_of(window) for window in windows]

    def push(self, description: FloatArray, *, contact: bool) -> FloatArray:
        """Return the description: it is the features."""
        del contact
        return description

    def reset(self) -> None:
        """Do nothing: there is no state."""


class Description(NamedTuple):
    """A window as :class:`~tactophone.perception.features.WindowSpectrum` has it, and its values."""

    sound: FloatArray
    powers: FloatArray
    values: FloatArray


class TextureExtractor:
    """Returns the features of kind ``texture``: channel after channel, means then deviations of its values.

    The prior in the card shows how many values there are: ``BAND_VALUES``, or one more with the treble's unevenness.
    The card's settings hold ``prior``, the moments of the average touch, ``change_metric``, see :data:`ChangeMetric`,
    and ``memory`` in s.
    """

    def __init__(self, card: ModelCard) -> None:
        channels = card.channels
        unevenness = np.shape(card.settings["prior"])[-1:] == (BAND_VALUES + 1,)
        values = BAND_VALUES + unevenness
        self._bands = BandFeatures(card.window_size, card.sample_rate, unevenness=unevenness)
        self._prior = _read_array(card, "prior", (2, channels, values))
        change_metric = _read_array(card, "change_metric", (channels, values, values))
        fading = fading_of(float(card.settings.get("memory", MEMORY)), float(card.hop / card.sample_rate))
        self._statistics = RunningStatistics(change_metric, fading=fading)

    def describe(self, windows: FloatArray) -> list[Description]:
        """Describe windows, each by itself."""
        spectrum = self._bands.spectrum(windows)
        return list(map(Description, spectrum.sound, spectrum.powers, self._bands.describe(spectrum)))

    def level_dbfs(self, window: FloatArray, description: Description) -> float:
        """Return the banded level of the first channel, from the spectrum that the features need too."""
        del window
        return band_of_powers(description.powers[CONTACT], description.sound.shape[1])

    def push(self, description: Description, *, contact: bool) -> FloatArray:
        """Return the features of the touch so far; NaN for a channel that is missing."""
        statistics, sound = self._statistics, description.sound
        statistics.push(description.values, contact=contact)
        features = texture_features(statistics.moments + statistics.prior_weight * self._prior)
        energies = np.vecdot(sound, sound)
        if min(energies.tolist()) < SILENT_POWER * sound.shape[1]:
            features[energies < SILENT_POWER * sound.shape[1]] = np.nan
        return features.reshape(-1)

    def reset(self) -> None:
        self._statistics.reset()


def _read_array(card: ModelCard, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    entries: Sequence[object] = card.settings[name]
    array = np.asarray(entries, np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} of shape {array.shape}, but it must be {shape}")
    return array


EXTRACTORS: Mapping[str, Callable[[ModelCard], Extractor]] = MappingProxyType(
    {
        "paper": lambda card: MemorylessExtractor(magnitudes),
        "texture": TextureExtractor,
        "cues": lambda card: MemorylessExtractor(lambda window: cues(window, card.sample_rate).astype(np.float32)),
        "scalogram": lambda card: MemorylessExtractor(LogSpectrogram(card.sample_rate).of),
    }
)
"""The extractor of each kind of model."""

SUPPORTS_MISSING_CHANNEL = frozenset({"texture", "cues"})
"""Kinds whose features are NaN where a channel is missing, and whose networks can do without it."""


def level_meter(extractor: Extractor, rule: LoudnessRule) -> Callable[[FloatArray, Any], float]:
    """Return the function that measures a window's level in dBFS by a rule, from the window and its description.

    It is the extractor's own method where the extractor computes the spectrum that the rule needs.
    """
    if isinstance(extractor, TextureExtractor) and rule == "banded":
        return extractor.level_dbfs
    loudness = LOUDNESS[rule]
    return lambda window, description: loudness(window[:, CONTACT])
