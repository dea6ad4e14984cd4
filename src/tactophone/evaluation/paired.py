"""Whether one method is truly better than another: both are measured on the same drawn surfaces, draw by draw."""

from dataclasses import dataclass

import numpy as np

from tactophone.evaluation.bootstrap import DRAWS, Estimate, interval
from tactophone.evaluation.metrics import Scores, measure


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
    drawn: list[dict[str, float]] = []
    for _ in range(draws):
        names = [name for stratum in strata if stratum for name in rng.choice(stratum, len(stratum))]
        drawn.append(_difference(one, other, names))
    whole = _difference(one, other, [name for stratum in strata for name in stratum])
    return {
        name: Difference(interval(value, [draw[name] for draw in drawn]), _p([draw[name] for draw in drawn]))
        for name, value in whole.items()
    }


def _surfaces(scores: Scores, rough: bool) -> set[str]:
    return {scores.names[k] for k in np.unique(scores.surface[scores.rough == rough])}


def _difference(one: Scores, other: Scores, names: list[str]) -> dict[str, float]:
    first, second = (measure(scores, _weights(scores, names)) for scores in (one, other))
    return {name: first[name] - second[name] for name in first}


def _weights(scores: Scores, names: list[str]) -> np.ndarray:
    times = np.array([float(names.count(name)) for name in scores.names])
    return times[scores.surface]


def _p(drawn: list[float]) -> float:
    known = np.array(drawn)[~np.isnan(drawn)]
    if not len(known):
        return float("nan")
    rarer = min((known <= 0).mean(), (known >= 0).mean())
    return float(min(1.0, 2 * max(rarer, 1 / len(known))))
