"""Regressions beside the detectors: a control, and renderers without a detector.

The control uses only the band over 8 kHz of recordings whose microphone ends at 7.5 kHz, which carries the noise of the
day and nothing of the surface. Where it scores above chance, it recognises days, and any other method might do so.

A renderer of :data:`~tactophone.haptics.passthrough.PASSTHROUGH` has no detector: the finger itself must separate rough
from smooth. The regression takes its place, on what a finger can perceive of the vibration: its level, its peaks, and
its strength in bands from 35 Hz to 1 kHz.
"""

import functools
import itertools
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.dataset.values import Recording
from tactophone.evaluation.metrics import rough_score
from tactophone.evaluation.predict import TakePredictions
from tactophone.haptics.limits import Limits
from tactophone.haptics.passthrough import PASSTHROUGH, STEP_SIZE
from tactophone.perception.resample import Resampler
from tactophone.training.recipes import FEATURE_RECIPES
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray

Floats = NDArray[np.float64]

HIGH_BAND_CONTROL = "control: only over 8 kHz"

WINDOW_SIZE = 1024
"""Samples: at the vibration's 4 kHz the paper's 256 ms; at 44.1 kHz 23 ms."""

HIGH_BAND_EDGES = np.geomspace(8000, 20_000, 9)
HIGH_BAND_HOP = 0.01
"""Seconds."""

HIGH_BAND_MEAN = 24
"""Updates averaged: as long as the paper's window."""

VIBRATION_EDGES = np.geomspace(35, 1000, 9)
VIBRATION_RATE = LIVE_SAMPLE_RATE // STEP_SIZE
VIBRATION_HOP = 128 / 3
"""Samples at 4 kHz: the paper's 10.67 ms."""

FAINT = 1e-8
FULL_DRIVE = Limits(ceiling=1.0)


@functools.lru_cache(maxsize=1 << 12)
def high_band_features(recording: Recording) -> tuple[Floats, Floats]:
    """Log power in eight bands from 8 to 20 kHz; for recordings at 40 kHz or more.

    Returns the end of each window in s, and features of shape ``(windows, 8)``.
    """
    sound = recording.read()
    rate = sound.sample_rate
    ends = np.arange(WINDOW_SIZE, sound.size + 1, round(HIGH_BAND_HOP * rate))
    windows = sliding_window_view(sound.samples[:, 0], WINDOW_SIZE)[ends - WINDOW_SIZE]
    rows = np.log10(_band_powers(windows, rate, HIGH_BAND_EDGES) + 1e-9)
    # A running mean as the difference of two running sums.
    total = np.concatenate((np.zeros((1, rows.shape[1])), np.cumsum(rows, axis=0)))
    last = np.arange(1, len(rows) + 1)
    first = np.maximum(last - HIGH_BAND_MEAN, 0)
    return ends / rate, np.asarray((total[last] - total[first]) / (last - first)[:, None])


@functools.lru_cache(maxsize=1 << 13)
def vibration_features(recording: Recording, renderer: str) -> tuple[Floats, Floats]:
    """Log of eight band powers, level and crest of the vibration that a renderer makes of a recording.

    Returns the end of each window in s, and features of shape ``(windows, 10)``.
    """
    vibration = PASSTHROUGH[renderer](FULL_DRIVE).render_whole(_contact(recording))[STEP_SIZE - 1 :: STEP_SIZE]
    count = max(0, int((len(vibration) - WINDOW_SIZE) / VIBRATION_HOP) + 1)
    starts = np.floor(np.arange(count) * VIBRATION_HOP).astype(np.intp)
    windows = sliding_window_view(vibration, WINDOW_SIZE)[starts].astype(np.float64)
    bands = _band_powers(windows, VIBRATION_RATE, VIBRATION_EDGES) / WINDOW_SIZE
    power, peak = np.square(windows).mean(axis=1), np.square(windows).max(axis=1)
    rows = np.log10(np.column_stack([bands, power, (peak + FAINT) / (power + FAINT)]) + FAINT)
    return (starts + WINDOW_SIZE) / VIBRATION_RATE, rows


RENDERERS: Mapping[str, str] = {f"{name}/felt" if name in FEATURE_RECIPES else name: name for name in PASSTHROUGH}
"""The renderer of each method: a name that a recipe has too gets ``/felt``."""

REGRESSION_FEATURES: Mapping[str, Callable[[Recording], tuple[Floats, Floats]]] = {
    HIGH_BAND_CONTROL: high_band_features,
    **{name: functools.partial(vibration_features, renderer=renderer) for name, renderer in RENDERERS.items()},
}
"""By name: recording to the end of each window, in s, and its features, shape ``(windows, features)``."""


def _band_powers(windows: NDArray[np.floating], rate: int, edges: Floats) -> Floats:
    powers = np.square(np.abs(np.fft.rfft(windows * np.hanning(windows.shape[1]))))
    bins = np.fft.rfftfreq(windows.shape[1], 1 / rate)
    bands = [powers[:, (bins >= low) & (bins < high)].mean(axis=1) for low, high in itertools.pairwise(edges)]
    return np.stack(bands, axis=1)


def _contact(recording: Recording) -> FloatArray:
    sound = recording.read(channels=1)
    if sound.sample_rate == LIVE_SAMPLE_RATE:
        return sound.samples
    resampler = Resampler(sound.sample_rate, LIVE_SAMPLE_RATE, channels=1)
    return np.concatenate([resampler.push(sound.samples), resampler.flush()])


def height_correlation(predictions: Iterable[TakePredictions]) -> float:
    """Spearman's correlation over surfaces of the mean P(rough) and the true Ra; NaN for fewer than three surfaces."""
    by_surface = _by_surface(predictions).values()
    return _correlation(np.array([height for height, _ in by_surface]), np.array([s.mean() for _, s in by_surface]))


def _by_surface(predictions: Iterable[TakePredictions]) -> dict[str, tuple[float, Floats]]:
    """True log10 Ra and all scores of each surface with a known Ra; the mean, where its objects differ a little."""
    heights: dict[str, list[float]] = {}
    scores: dict[str, list[Floats]] = {}
    for take in predictions:
        ra_um = take.recording.known("ra_um")
        if ra_um and take.recording.label is not None and take.contact.any():
            heights.setdefault(take.recording.surface, []).append(float(np.log10(float(ra_um))))
            of_surface = scores.setdefault(take.recording.surface, [])
            of_surface.append(rough_score(take.probabilities[take.contact], "two-class"))
    return {name: (float(np.mean(heights[name])), np.concatenate(scores[name])) for name in sorted(heights)}


def _correlation(first: Floats, second: Floats) -> float:
    if len(first) < 3:
        return float("nan")
    from scipy.stats import spearmanr

    return float(spearmanr(first, second).statistic)
