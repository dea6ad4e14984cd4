"""Roughness as a number: Ra regressed from sound, and predictions ranked against the true Ra.

Ra spans four decades from glass to lava, so errors are in decades: 0.3 is a factor of two.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.evaluation import Predictor, TakePredictions, rough_score
from tactophone.training import RECIPES, FeatureSpec, build_training_set, extract_features, fit_height

Floats = NDArray[np.float64]

LOWEST, HIGHEST = -4.0, 4.0
"""log10 of Ra in micrometres, from 0.1 nm to 1 cm: P(rough) of a prediction is the height's place between them."""


@dataclass(frozen=True, slots=True)
class Heights:
    """How well Ra is estimated for held-out surfaces."""

    surfaces: tuple[tuple[str, float, float], ...]
    """Name, true and estimated Ra in micrometres, of each; the estimate is the mean in decades over its updates."""
    error_decades: float
    """Root mean square error over surfaces, in decades of Ra."""
    update_error_decades: float
    """The same over single updates, every surface at the same weight."""
    spread_decades: float
    """Root mean square error of a constant estimate, the least to beat."""
    correlation: float
    """Spearman's, over surfaces."""


@dataclass(frozen=True, slots=True)
class HeightMethod:
    """Ridge regression from features to log Ra: the recipe ``surface`` without its boundary."""

    spec: FeatureSpec
    name: str = "surface, as a height"

    @property
    def identity(self) -> str:
        """The features, and the version of the recipe ``surface``."""
        return f"height {RECIPES['surface'].version} {self.spec!r}"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Fit to recordings that have the property ``ra_um``."""
        training_set = build_training_set(self.spec, recordings)
        weights, centre, bias, _ = fit_height(training_set)

        def predict(recording: Recording) -> TakePredictions:
            (track,) = extract_features([recording], self.spec)
            centred = np.nan_to_num(training_set.features(track) - centre)
            place = np.clip((bias + centred @ weights - LOWEST) / (HIGHEST - LOWEST), 0, 1)
            shares = np.stack((np.zeros_like(place), 1 - place, place), axis=1).astype(np.float32)
            return TakePredictions(recording, track.end, shares, track.level_dbfs >= training_set.threshold_dbfs)

        return predict


def compare_heights(predictions: Iterable[TakePredictions]) -> Heights:
    """Compare the predictions of a :class:`HeightMethod` with the true Ra, over updates in contact."""
    by_surface = _by_surface(predictions)
    true = np.array([height for height, _ in by_surface.values()])
    estimates = [LOWEST + (HIGHEST - LOWEST) * shares for _, shares in by_surface.values()]
    means = np.array([heights.mean() for heights in estimates])
    return Heights(
        tuple((name, float(10**a), float(10**b)) for name, a, b in zip(by_surface, true, means, strict=True)),
        _rms(means - true),
        _rms(np.array([_rms(heights - height) for heights, height in zip(estimates, true, strict=True)])),
        _rms(true - true.mean()),
        _correlation(true, means),
    )


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


def _rms(errors: Floats) -> float:
    return float(np.sqrt(np.square(errors).mean()))
