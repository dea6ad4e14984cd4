"""How sure a score is: by drawing surfaces anew, because windows of one surface are no independent witnesses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.evaluation.metrics import Counts, Scores, count_by_surface, measure, measure_counts

DRAWS = 1000
COVERAGE = 0.90

BINS = 2048
"""Of scores, in draws alone: it moves an interval's end by less than 0.001, and makes a draw a hundred times faster."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A score with the interval that 90 % of the draws fall in; ``low`` and ``high`` are NaN where none can be had."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3f} ({self.low:.2f}-{self.high:.2f})"


def estimate(scores: Scores, *, draws: int = DRAWS, seed: int = 0) -> dict[str, Estimate]:
    """Measure scores, each with its interval.

    Surfaces are drawn with replacement, rough and smooth ones apart, so that no draw lacks a class (stratified
    percentile bootstrap; Efron & Tibshirani 1993, chapters 8 and 13).

    Parameters
    ----------
    scores
        The windows.
    draws
        How many times the surfaces are drawn anew.
    seed
        Of the draws.
    """
    rng = np.random.default_rng(seed)
    strata = _strata(scores)
    times = np.array([_draw(strata, surfaces=len(scores.names), rng=rng) for _ in range(draws)])
    drawn = measure_draws(count_by_surface(scores, bins=BINS), times)
    return {name: interval(value, drawn[name]) for name, value in measure(scores).items()}


def measure_draws(counts: Counts, times: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Measure draws of surfaces.

    Parameters
    ----------
    counts
        Of each surface.
    times
        How often each draw holds each surface, shape ``(draws, surfaces)``.
    """
    return measure_counts(counts.times(times.reshape(-1, len(counts.rough))))


def _strata(scores: Scores) -> list[NDArray[np.intp]]:
    present = [np.unique(scores.surface[scores.rough == rough]) for rough in (False, True)]
    return [surfaces for surfaces in present if len(surfaces)]


def _draw(strata: Sequence[NDArray[np.intp]], *, surfaces: int, rng: np.random.Generator) -> NDArray[np.float64]:
    times = np.zeros(surfaces)
    for stratum in strata:
        np.add.at(times, rng.choice(stratum, len(stratum)), 1.0)
    return times


def interval(value: float, drawn: Sequence[float] | NDArray[np.float64]) -> Estimate:
    """Give a score the interval that the middle 90 % of its draws span."""
    if not len(drawn) or np.isnan(drawn).all():
        return Estimate(value, float("nan"), float("nan"))
    low, high = np.nanquantile(drawn, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return Estimate(value, float(low), float(high))
