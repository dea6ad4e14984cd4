"""Confidence intervals of scores, by resampling surfaces: windows of one surface are not independent samples."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.evaluation.metrics import Counts, Scores, count_by_surface, measure, measure_counts

DRAWS = 1000
COVERAGE = 0.90

BINS = 2048
"""Bins of scores, used in draws alone: they move an interval's end by less than 0.001 and make a draw 100x faster."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A score with its 90 % interval; ``low`` and ``high`` are NaN where no interval can be computed."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return "-" if math.isnan(self.value) else f"{self.value:.3f} ({self.low:.2f}-{self.high:.2f})"


def estimate(scores: Scores, *, draws: int = DRAWS, seed: int = 0) -> dict[str, Estimate]:
    """Compute every score of :func:`tactophone.evaluation.measure`, each with its interval from ``draws`` of surfaces.

    Surfaces are drawn with replacement, rough and smooth ones apart, so that no draw lacks a class (stratified
    percentile bootstrap; Efron & Tibshirani, "An Introduction to the Bootstrap", 1993, chapters 8 and 13).
    """
    rng = np.random.default_rng(seed)
    strata = [surfaces for rough in (False, True) if len(surfaces := np.unique(scores.surface[scores.rough == rough]))]
    times = np.array([draw_surfaces(strata, surfaces=len(scores.names), rng=rng) for _ in range(draws)])
    drawn = measure_draws(count_by_surface(scores, bins=BINS), times)
    return {name: interval(value, drawn[name]) for name, value in measure(scores).items()}


def measure_draws(counts: Counts, times: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Compute every score of each draw of surfaces, which ``times``, shape ``(draws, surfaces)``, counts."""
    return measure_counts(counts.times(times.reshape(-1, len(counts.rough))))


def interval(value: float, drawn: Sequence[float] | NDArray[np.float64]) -> Estimate:
    """Return a score with the interval that the middle 90 % of its draws span."""
    if not len(drawn) or np.isnan(drawn).all():
        return Estimate(value, float("nan"), float("nan"))
    low, high = np.nanquantile(drawn, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return Estimate(value, float(low), float(high))


def draw_surfaces(
    strata: Sequence[NDArray[np.intp]], *, surfaces: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw as many surfaces of each stratum as it has, with replacement; return how often each was drawn."""
    times = np.zeros(surfaces)
    for stratum in strata:
        np.add.at(times, rng.choice(stratum, len(stratum)), 1.0)
    return times
