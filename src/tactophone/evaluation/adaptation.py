"""Before and after: what a model gained on new objects and lost elsewhere, in pairs, with intervals."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.errors import DatasetError
from tactophone.evaluation.bootstrap import Estimate, interval
from tactophone.evaluation.metrics import rough_score
from tactophone.evaluation.predictions import TakePredictions
from tactophone.types import Touch

DRAWS = 1000

Counts = NDArray[np.float64]
"""Of each cluster: smooth windows, smooth called rough, rough windows, rough called rough."""


@dataclass(frozen=True, slots=True)
class Change:
    """A score before and after, and their difference, drawn in pairs."""

    before: Estimate
    after: Estimate
    difference: Estimate

    def as_json(self) -> dict[str, Any]:
        """Give plain dictionaries."""
        return asdict(self)


def by_surface(recording: Recording) -> str:
    """Draw surfaces: what a general test set's windows hang together by."""
    return recording.surface


def by_take(recording: Recording) -> str:
    """Draw takes: all that a few new objects leave to draw from, so their intervals hold for these objects only."""
    return str(recording.path)


def compare(
    before: Sequence[TakePredictions],
    after: Sequence[TakePredictions],
    *,
    by: Callable[[Recording], str],
    seed: int = 0,
) -> dict[str, Change]:
    """Compare two models on the same recordings, window by window in contact, by the two-class rule.

    Returns
    -------
    dict
        ``balanced_accuracy``: the mean share of rightly called windows over the classes that there are.
        ``false_positive_rate``: share of smooth windows called rough; NaN without smooth recordings.

    Raises
    ------
    DatasetError
        If neither model ever met contact.
    """
    names = sorted({by(one.recording) for one in before})
    counts = [_count(judged, names, by) for judged in (before, after)]
    if not counts[0].any():
        raise DatasetError("the contact gate never opened on these recordings; lower the threshold, or calibrate")
    rng = np.random.default_rng(seed)
    rough = counts[0][:, 2] > 0
    strata = [np.flatnonzero(rough == called) for called in (False, True) if (rough == called).any()]
    draws = [np.concatenate([rng.choice(stratum, len(stratum)) for stratum in strata]) for _ in range(DRAWS)]
    scores = {name: [[measure(table[draw]) for draw in draws] for table in counts]
              for name, measure in _MEASURES.items()}  # fmt: skip
    return {name: _change([measure(table) for table in counts], scores[name]) for name, measure in _MEASURES.items()}


def balanced_accuracy(counts: Counts) -> float:
    """Mean over the classes that there are of the share called rightly."""
    smooth, false, rough, found = counts.sum(axis=0)
    shares = [share for total, share in ((smooth, 1 - false / max(smooth, 1)), (rough, found / max(rough, 1))) if total]
    return float(np.mean(shares)) if shares else float("nan")


def false_positive_rate(counts: Counts) -> float:
    """Share of smooth windows called rough."""
    smooth, false, _, _ = counts.sum(axis=0)
    return float(false / smooth) if smooth else float("nan")


_MEASURES: dict[str, Callable[[Counts], float]] = {
    "balanced_accuracy": balanced_accuracy,
    "false_positive_rate": false_positive_rate,
}


def accuracy_of(judged: Sequence[TakePredictions]) -> float:
    """Balanced accuracy of a model on recordings."""
    return balanced_accuracy(_count(judged, [""], lambda recording: ""))


def _count(judged: Sequence[TakePredictions], names: Sequence[str], by: Callable[[Recording], str]) -> Counts:
    place = {name: number for number, name in enumerate(names)}
    counts = np.zeros((len(names), 4))
    for one in judged:
        called = rough_score(one.probabilities[one.contact], "two-class") >= 0.5
        column = 2 if one.recording.label is Touch.ROUGH else 0
        counts[place[by(one.recording)], column : column + 2] += (len(called), called.sum())
    return counts


def _change(values: Sequence[float], drawn: Sequence[Sequence[float]]) -> Change:
    differences = np.subtract(drawn[1], drawn[0])
    return Change(
        interval(values[0], drawn[0]), interval(values[1], drawn[1]), interval(values[1] - values[0], differences)
    )
