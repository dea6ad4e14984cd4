"""Confidence intervals of scores and of differences between two methods, by resampling
surfaces.

Windows of one surface are not independent samples, so surfaces are drawn, with
replacement. Rough and smooth ones are drawn apart, so that no draw lacks a class
(stratified percentile bootstrap; Efron & Tibshirani, "An Introduction to the
Bootstrap", 1993, chapters 8 and 13). Two methods are compared on the same draws
(paired, section 16.4). Fewer than five surfaces of a class say too little of others:
then a score has no interval.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Recording
from tactophone_lab.evaluation.metrics import (
    Floats,
    Scores,
    balanced_accuracy,
    count_by_surface,
    measure,
    measure_counts,
    rough_score,
)
from tactophone_lab.evaluation.predict import TakePredictions

DRAWS = 1000
"""Bootstrap draws of the surfaces behind each interval."""

FEWEST_SURFACES = 5
"""Surfaces of each class that an interval needs: of two, a draw holds one alone in half
of all cases, and the interval comes out far too narrow."""

COVERAGE = 0.90
"""Share of the draws that an interval covers."""

LEAST_RISE = 0.02
"""Of a rate whose interval is unknown, or of no width as all draws are 0: as much as
fine-tuning may cost elsewhere."""

SCORE_BINS = 2048
"""Bins of scores, used in draws alone: they move an interval's end by less than 0.001
and make a draw 100x faster."""

Statistic = Callable[[Floats], Mapping[str, Floats]]
"""From tables summed over surfaces, any number of cases side by side, to each case's
scores by name."""

Strata = Sequence[NDArray[np.intp]]
"""Rows of the table that are drawn among themselves: smooth surfaces, and rough
ones."""

Key = TypeVar("Key")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A score with its 90 % interval; ``low`` and ``high`` are NaN where no interval
    can be computed."""

    value: float
    low: float = math.nan
    high: float = math.nan

    def __str__(self) -> str:
        return self.written(".3f", ".2f")

    def written(self, value: str, ends: str) -> str:
        """Write it by the formats of its value and its interval's ends; without an
        interval, no brackets."""
        if math.isnan(self.value):
            return "-"
        return f"{self.value:{value}}" + (
            "" if math.isnan(self.low) else f" ({self.low:{ends}}-{self.high:{ends}})"
        )

    def rounded(self, digits: int) -> list[float]:
        """Return value, low and high, those that are known, for JSON."""
        return [
            round(float(each), digits)
            for each in (self.value, self.low, self.high)
            if not math.isnan(each)
        ]

    def is_exceeded_by(self, other: float) -> bool:
        """Whether another value is higher than its interval, or by `LEAST_RISE` where
        the interval has no width."""
        return other > (
            self.high if self.high > self.value else self.value + LEAST_RISE
        )


@dataclass(frozen=True, slots=True)
class Difference:
    """One method's score less another's."""

    estimate: Estimate
    """The difference with its 90 % interval."""
    p: float
    """Two-sided: twice the share of draws on the rarer side of zero, at least one
    draw."""
    corrected: float = math.nan
    """The same, corrected for the number of differences in its table: see
    :func:`correct_for_number`. NaN before."""


@dataclass(frozen=True, slots=True)
class Change:
    """A score before and after, and their difference over the same draws."""

    before: Estimate
    after: Estimate
    difference: Estimate


def bootstrap(
    table: Floats, statistic: Statistic, *, strata: Strata, draws: int = DRAWS
) -> dict[str, Estimate]:
    """Compute the scores of a table with a row for each surface, each with its
    interval."""
    drawn = resample(table, statistic, strata=strata, draws=draws)
    return {
        name: interval(float(value), drawn[name])
        for name, value in statistic(table.sum(axis=0)).items()
    }


def resample(
    table: Floats, statistic: Statistic, *, strata: Strata, draws: int = DRAWS
) -> Mapping[str, Floats]:
    """Compute the scores of each draw of a table's rows; of no draw where a stratum has
    one row.

    The same strata draw the same rows of any table: so two methods are compared in
    pairs.
    """
    rng = np.random.default_rng(0)
    times = np.zeros(
        (0 if any(len(stratum) == 1 for stratum in strata) else draws, len(table))
    )
    for row in times:
        for stratum in strata:
            if len(stratum):
                np.add.at(row, rng.choice(stratum, len(stratum)), 1.0)
    return statistic(np.tensordot(times, table, axes=1))


def interval(value: float, drawn: Sequence[float] | Floats) -> Estimate:
    """Return a score with the interval that the middle 90 % of its draws span."""
    if not len(drawn) or np.isnan(drawn).all():
        return Estimate(value)
    low, high = np.nanquantile(drawn, [(1 - COVERAGE) / 2, (1 + COVERAGE) / 2])
    return Estimate(value, float(low), float(high))


def estimate(scores: Scores, *, draws: int = DRAWS) -> dict[str, Estimate]:
    """Compute every score of :func:`tactophone_lab.evaluation.metrics.measure`, each
    with its interval."""
    table, called = count_by_surface(scores, bins=SCORE_BINS)
    strata = [
        np.unique(scores.surface[scores.rough == rough]) for rough in (False, True)
    ]
    draws = (
        0 if any(0 < len(stratum) < FEWEST_SURFACES for stratum in strata) else draws
    )
    drawn = resample(
        table, lambda counts: measure_counts(counts, called), strata=strata, draws=draws
    )
    return {
        name: interval(value, drawn[name]) for name, value in measure(scores).items()
    }


def paired_difference(
    first: Scores, second: Scores, *, draws: int = DRAWS
) -> dict[str, Difference]:
    """Compute every score of the first method less the second's, over the surfaces that
    both have scores of."""
    common = []
    for label in (False, True):
        found = (
            {each.names[k] for k in np.unique(each.surface[each.rough == label])}
            for each in (first, second)
        )
        common.append(sorted(set.intersection(*found)))
    rows = sorted({name for names in common for name in names})
    strata = [
        np.array([rows.index(name) for name in names], np.intp) for names in common
    ]

    def scored(scores: Scores) -> tuple[dict[str, float], Mapping[str, Floats]]:
        """Scores over all common surfaces once, and in each draw."""
        # The two methods number their surfaces differently, so rows are ordered by
        # name.
        counts, called = count_by_surface(scores, bins=SCORE_BINS)
        table = counts[[scores.names.index(name) for name in rows]]
        weights = np.array(
            [float(sum(names.count(name) for names in common)) for name in scores.names]
        )
        drawn = resample(
            table,
            lambda counts: measure_counts(counts, called),
            strata=strata,
            draws=draws,
        )
        return measure(scores, weights[scores.surface]), drawn

    (value, drawn), (other, other_drawn) = scored(first), scored(second)
    differences = {name: drawn[name] - other_drawn[name] for name in value}
    return {
        name: Difference(interval(value[name] - other[name], each), _p(each))
        for name, each in differences.items()
    }


def _p(drawn: Floats) -> float:
    known = drawn[~np.isnan(drawn)]
    if not len(known):
        return float("nan")
    rarer = min((known <= 0).mean(), (known >= 0).mean())
    return float(min(1.0, 2 * max(rarer, 1 / len(known))))


def correct_for_number(differences: Mapping[Key, Difference]) -> dict[Key, Difference]:
    """Correct the p-values of a table of differences, so that the chance of *any* false
    one is bounded.

    Source: Holm, "A simple sequentially rejective multiple test procedure", Scand. J.
    Statist. 6, 65 (1979).

    >>> value = Estimate(0, 0, 0)
    >>> p_values = {"a": 0.01, "b": 0.04, "c": 0.03}
    >>> found = {name: Difference(value, p) for name, p in p_values.items()}
    >>> corrected = correct_for_number(found)
    >>> {name: round(each.corrected, 3) for name, each in corrected.items()}
    {'a': 0.03, 'b': 0.06, 'c': 0.06}
    """
    known = sorted(
        (each.p, place)
        for place, each in enumerate(differences.values())
        if not math.isnan(each.p)
    )
    corrected = dict.fromkeys(range(len(differences)), math.nan)
    highest = 0.0
    for rank, (p, place) in enumerate(known):
        highest = max(highest, min(1.0, p * (len(known) - rank)))
        corrected[place] = highest
    return {
        key: replace(each, corrected=corrected[place])
        for place, (key, each) in enumerate(differences.items())
    }


def compare_models(
    before: Sequence[TakePredictions],
    after: Sequence[TakePredictions],
    *,
    by: Callable[[Recording], str],
) -> dict[str, Change]:
    """Compare two models on the same recordings, such as before and after fine-tuning.

    Over windows in contact, by the two-class rule; ``by`` names the cluster of a
    recording, which the bootstrap draws. Returns ``balanced_accuracy``, over the
    classes present, and ``false_positive_rate``, the share of smooth windows classified
    as rough, NaN without any. Raises `DatasetError` if neither model detected contact.
    """
    tables = [_count(predictions, by) for predictions in (before, after)]
    rough = tables[0][:, 1].sum(axis=-1) > 0
    strata = [np.flatnonzero(rough == label) for label in (False, True)]
    old, new = (_rates(table.sum(axis=0)) for table in tables)
    drawn_old, drawn_new = (resample(table, _rates, strata=strata) for table in tables)
    return {
        name: Change(
            interval(float(old[name]), drawn_old[name]),
            interval(float(new[name]), drawn_new[name]),
            interval(float(new[name] - old[name]), drawn_new[name] - drawn_old[name]),
        )
        for name in old
    }


def accuracy_of(predictions: Sequence[TakePredictions]) -> float:
    """Balanced accuracy over the classes present, by the two-class rule; raises as
    :func:`compare_models`."""
    return float(
        _rates(_count(predictions, lambda recording: "").sum(axis=0))[
            "balanced_accuracy"
        ]
    )


def _count(
    predictions: Sequence[TakePredictions], by: Callable[[Recording], str]
) -> Floats:
    """Windows in contact by cluster, label (smooth, rough) and class (smooth, rough):
    ``(clusters, 2, 2)``."""
    names = sorted({by(take.recording) for take in predictions})
    table = np.zeros((len(names), 2, 2))
    for take in predictions:
        called_rough = rough_score(take.probabilities[take.contact], "two-class") >= 0.5
        row = table[names.index(by(take.recording)), int(take.recording.rough)]
        row += np.bincount(called_rough, minlength=2)
    if not table.any():
        raise DatasetError(
            "the contact gate never opened: the sound is under its threshold; give "
            "its --calibration"
        )
    return table


def _rates(table: Floats) -> dict[str, Floats]:
    with np.errstate(invalid="ignore"):
        share = table / table.sum(axis=-1, keepdims=True)
    right = balanced_accuracy(share[..., 0, 0], share[..., 1, 1], either=True)
    return {"balanced_accuracy": right, "false_positive_rate": share[..., 0, 1]}
