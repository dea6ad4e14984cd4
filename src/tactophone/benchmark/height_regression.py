"""Roughness as a number: a surface's Ra told from its sound, and beliefs ranked against the true one.

Ra spans four decades from glass to lava, so that errors are told in decades: 0.3 is a factor of two.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.benchmark.recipe_methods import version_of
from tactophone.dataset import Recording
from tactophone.evaluation.metrics import rough_score
from tactophone.evaluation.predictions import Judge, TakePredictions
from tactophone.training.features.baselines import fit_height
from tactophone.training.features.feature_tracks import FeatureSpec, listen
from tactophone.training.features.training_set import prepare

LOWEST, HIGHEST = -4.0, 4.0
"""log10 of Ra in micrometres, from 0.1 nm to 1 cm: a take_predictions holds a height as a place between them."""


@dataclass(frozen=True, slots=True)
class Heights:
    """How well Ra is told from the sound of surfaces that were never heard.

    Parameters
    ----------
    surfaces
        Name, true and estimated Ra in micrometres, of each; the estimate is the mean in decades over its updates.
    error_decades
        Root mean square error over surfaces, in decades of Ra.
    update_error_decades
        The same over single updates, every surface weighing the same.
    spread_decades
        Root mean square error of saying the same of every surface: what hearing must beat.
    correlation
        Spearman's, over surfaces.
    """

    surfaces: tuple[tuple[str, float, float], ...]
    error_decades: float
    update_error_decades: float
    spread_decades: float
    correlation: float


@dataclass(frozen=True, slots=True)
class HeightMethod:
    """Ridge regression from our features to log Ra: the half of the way ``surface`` that comes before its boundary."""

    ear: FeatureSpec
    name: str = "surface, as a height"

    @property
    def identity(self) -> str:
        """How it hears, and the version of the way that it is half of."""
        return f"height {version_of('surface')} {self.ear!r}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Learn from recordings that tell their ``ra_um``."""
        lesson = prepare(self.ear, recordings)
        weights, centre, bias, _ = fit_height(lesson)

        def judge(recording: Recording) -> TakePredictions:
            (track,) = listen([recording], self.ear)
            off = np.nan_to_num(lesson.features(track) - centre)
            place = np.clip((bias + off @ weights - LOWEST) / (HIGHEST - LOWEST), 0, 1)
            shares = np.stack((np.zeros_like(place), 1 - place, place), axis=1).astype(np.float32)
            return TakePredictions(recording, track.end, shares, track.level_dbfs >= lesson.threshold_dbfs)

        return judge


def compare_heights(judged: Iterable[TakePredictions]) -> Heights:
    """Compare what a :class:`HeightMethod` said with what is true, over updates in contact."""
    said = _by_surface(judged)
    true = np.array([height for height, _ in said.values()])
    told = [LOWEST + (HIGHEST - LOWEST) * shares for _, shares in said.values()]
    means = np.array([one.mean() for one in told])
    return Heights(
        tuple((name, float(10**a), float(10**b)) for name, a, b in zip(said, true, means, strict=True)),
        _rms(means - true),
        _rms(np.array([_rms(one - height) for one, height in zip(told, true, strict=True)])),
        _rms(true - true.mean()),
        _correlation(true, means),
    )


def height_correlation(judged: Iterable[TakePredictions]) -> float:
    """Rank surfaces by mean confidence in rough and by true Ra: Spearman's correlation, NaN for under three."""
    said = _by_surface(judged)
    return _correlation(
        np.array([height for height, _ in said.values()]), np.array([shares.mean() for _, shares in said.values()])
    )


def _by_surface(judged: Iterable[TakePredictions]) -> dict[str, tuple[float, NDArray[np.float64]]]:
    """True log10 Ra and all scores of each surface that tells it; objects of one surface may differ a little."""
    heights: dict[str, list[float]] = {}
    scores: dict[str, list[NDArray[np.float64]]] = {}
    for one in judged:
        told = one.recording.known("ra_um")
        if told and one.recording.label is not None and one.contact.any():
            heights.setdefault(one.recording.surface, []).append(float(np.log10(float(told))))
            scores.setdefault(one.recording.surface, []).append(
                rough_score(one.probabilities[one.contact], "two-class")
            )
    return {name: (float(np.mean(heights[name])), np.concatenate(scores[name])) for name in sorted(heights)}


def _correlation(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    if len(one) < 3:
        return float("nan")
    from scipy.stats import spearmanr

    return float(spearmanr(one, other).statistic)


def _rms(errors: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.square(errors).mean()))
