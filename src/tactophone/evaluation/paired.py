"""Whether one method is truly better than another: both are measured on the same drawn surfaces, draw by draw."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactophone.evaluation.bootstrap import BINS, DRAWS, Estimate, interval, measure_draws
from tactophone.evaluation.metrics import Floats, Scores, count_by_surface, measure


@dataclass(frozen=True, slots=True)
class Difference:
    """One method's measure less another's.

    Parameters
    ----------
    estimate
        The difference, with the interval that 90 % of the draws fall in.
    p
        Two-sided: twice the share of draws on the rarer side of zero, at least one draw.
    """

    estimate: Estimate
    p: float


def compare(one: Scores, other: Scores, *, draws: int = DRAWS, seed: int = 0) -> dict[str, Difference]:
    """Compare two methods on the surfaces that both judged, measure by measure (paired bootstrap over surfaces).

    Source: Efron & Tibshirani, "An Introduction to the Bootstrap" (1993), section 16.4.
    """
    rng = np.random.default_rng(seed)
    strata = [sorted(_surfaces(one, rough) & _surfaces(other, rough)) for rough in (False, True)]
    drawn = [
        [name for stratum in strata if stratum for name in rng.choice(stratum, len(stratum))] for _ in range(draws)
    ]
    every = [name for stratum in strata for name in stratum]
    first, second = (_measure(scores, every, drawn) for scores in (one, other))
    return {
        name: Difference(interval(first[0][name] - second[0][name], differences), _p(differences))
        for name, differences in ((name, first[1][name] - second[1][name]) for name in first[0])
    }


def _surfaces(scores: Scores, rough: bool) -> set[str]:
    return {scores.names[k] for k in np.unique(scores.surface[scores.rough == rough])}


def _measure(
    scores: Scores, every: Sequence[str], drawn: Sequence[Sequence[str]]
) -> tuple[dict[str, float], dict[str, Floats]]:
    """Measure all of the surfaces once, and in each draw."""
    times = np.array([[names.count(name) for name in scores.names] for names in drawn], np.float64)
    whole = np.array([float(every.count(name)) for name in scores.names])[scores.surface]
    return measure(scores, whole), measure_draws(count_by_surface(scores, bins=BINS), times)


def _p(drawn: Floats) -> float:
    known = drawn[~np.isnan(drawn)]
    if not len(known):
        return float("nan")
    rarer = min((known <= 0).mean(), (known >= 0).mean())
    return float(min(1.0, 2 * max(rarer, 1 / len(known))))
