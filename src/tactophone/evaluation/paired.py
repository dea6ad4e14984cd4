"""Difference of two methods, measured on the same drawn surfaces (paired bootstrap), corrected for their number."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from tactophone.evaluation.bootstrap import BINS, DRAWS, Estimate, interval, measure_draws
from tactophone.evaluation.metrics import Floats, Scores, count_by_surface, measure


@dataclass(frozen=True, slots=True)
class Difference:
    """One method's score less another's."""

    estimate: Estimate
    """The difference with its 90 % interval."""
    p: float
    """Two-sided: twice the share of draws on the rarer side of zero, at least one draw."""
    corrected: float = math.nan
    """The same, corrected for the number of differences in its table: see :func:`correct_for_number`. NaN before."""


Key = TypeVar("Key")


def correct_for_number(differences: Mapping[Key, Difference]) -> dict[Key, Difference]:
    """Correct the p-values of a table of differences, so that the chance of *any* false one is bounded.

    Source: Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Statist. 6, 65 (1979).

    >>> found = {name: Difference(Estimate(0, 0, 0), p) for name, p in {"a": 0.01, "b": 0.04, "c": 0.03}.items()}
    >>> {name: round(each.corrected, 3) for name, each in correct_for_number(found).items()}
    {'a': 0.03, 'b': 0.06, 'c': 0.06}
    """
    known = sorted((each.p, place) for place, each in enumerate(differences.values()) if not math.isnan(each.p))
    corrected, highest = dict.fromkeys(range(len(differences)), math.nan), 0.0
    for rank, (p, place) in enumerate(known):
        highest = max(highest, min(1.0, p * (len(known) - rank)))
        corrected[place] = highest
    return {key: replace(each, corrected=corrected[place]) for place, (key, each) in enumerate(differences.items())}


def paired_difference(first: Scores, second: Scores, *, draws: int = DRAWS, seed: int = 0) -> dict[str, Difference]:
    """Compute every score of the first method less the second's, over the surfaces that both have scores of.

    Source: Efron & Tibshirani, "An Introduction to the Bootstrap" (1993), section 16.4.
    """
    rng = np.random.default_rng(seed)
    strata = [sorted(_surfaces(first, rough) & _surfaces(second, rough)) for rough in (False, True)]
    drawn = [
        [name for stratum in strata if stratum for name in rng.choice(stratum, len(stratum))] for _ in range(draws)
    ]
    every = [name for stratum in strata for name in stratum]
    (value, in_draws), (other_value, in_other_draws) = (_measure(scores, every, drawn) for scores in (first, second))
    differences = {name: in_draws[name] - in_other_draws[name] for name in value}
    return {
        name: Difference(interval(value[name] - other_value[name], drawn), _p(drawn))
        for name, drawn in differences.items()
    }


def _surfaces(scores: Scores, rough: bool) -> set[str]:
    return {scores.names[k] for k in np.unique(scores.surface[scores.rough == rough])}


def _measure(
    scores: Scores, every: Sequence[str], drawn: Sequence[Sequence[str]]
) -> tuple[dict[str, float], dict[str, Floats]]:
    """Scores over all common surfaces once, and in each draw."""
    # The two methods number their surfaces differently, so draws are of names.
    times = np.array([[names.count(name) for name in scores.names] for names in drawn], np.float64)
    weights = np.array([float(every.count(name)) for name in scores.names])[scores.surface]
    return measure(scores, weights), measure_draws(count_by_surface(scores, bins=BINS), times)


def _p(drawn: Floats) -> float:
    known = drawn[~np.isnan(drawn)]
    if not len(known):
        return float("nan")
    rarer = min((known <= 0).mean(), (known >= 0).mean())
    return float(min(1.0, 2 * max(rarer, 1 / len(known))))
