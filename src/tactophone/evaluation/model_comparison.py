"""Two models on the same recordings, such as before and after finetuning: scores, and their difference in pairs."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.errors import DatasetError
from tactophone.evaluation.bootstrap import DRAWS, Estimate, interval
from tactophone.evaluation.metrics import rough_score
from tactophone.evaluation.predictions import TakePredictions
from tactophone.types import Touch

Counts = NDArray[np.float64]
"""Shape ``(clusters, 4)``: smooth windows, smooth classified as rough, rough windows, rough classified as rough."""


@dataclass(frozen=True, slots=True)
class Change:
    """A score before and after, and their difference over the same draws."""

    before: Estimate
    after: Estimate
    difference: Estimate

    def as_json(self) -> dict[str, Any]:
        """Return plain dictionaries."""
        return asdict(self)


def by_surface(recording: Recording) -> str:
    """Cluster by surface: windows of one surface are correlated."""
    return recording.surface


def by_take(recording: Recording) -> str:
    """Cluster by take, where a few new objects leave nothing else to draw: intervals hold for these objects only."""
    return str(recording.path)


def compare_models(
    before: Sequence[TakePredictions],
    after: Sequence[TakePredictions],
    *,
    by: Callable[[Recording], str],
    seed: int = 0,
) -> dict[str, Change]:
    """Compare two models on the same recordings, over windows in contact, by the two-class rule.

    ``by`` names the cluster of a recording: the bootstrap draws clusters.

    Returns
    -------
    dict
        ``balanced_accuracy``: mean over the classes present of the share of windows classified correctly.
        ``false_positive_rate``: share of smooth windows classified as rough; NaN without smooth recordings.

    Raises
    ------
    DatasetError
        If neither model detected contact.
    """
    names = sorted({by(take.recording) for take in before})
    counts = [_count(predictions, names, by) for predictions in (before, after)]
    if not counts[0].any():
        raise DatasetError("the contact gate never opened on these recordings; lower the threshold, or calibrate")
    rng = np.random.default_rng(seed)
    rough = counts[0][:, 2] > 0
    strata = [np.flatnonzero(rough == label) for label in (False, True) if (rough == label).any()]
    draws = [np.concatenate([rng.choice(stratum, len(stratum)) for stratum in strata]) for _ in range(DRAWS)]
    metrics = {"balanced_accuracy": balanced_accuracy, "false_positive_rate": false_positive_rate}
    return {
        name: _change(
            [metric(table) for table in counts], [[metric(table[draw]) for draw in draws] for table in counts]
        )
        for name, metric in metrics.items()
    }


def balanced_accuracy(counts: Counts) -> float:
    """Mean over the classes present of the share classified correctly; NaN without windows."""
    smooth, false, rough, found = counts.sum(axis=0)
    shares = [share for total, share in ((smooth, 1 - false / max(smooth, 1)), (rough, found / max(rough, 1))) if total]
    return float(np.mean(shares)) if shares else float("nan")


def false_positive_rate(counts: Counts) -> float:
    """Share of smooth windows classified as rough; NaN without smooth windows."""
    smooth, false, _, _ = counts.sum(axis=0)
    return float(false / smooth) if smooth else float("nan")


def accuracy_of(predictions: Sequence[TakePredictions]) -> float:
    """Balanced accuracy of a model on recordings, by the two-class rule."""
    return balanced_accuracy(_count(predictions, [""], lambda recording: ""))


def _count(predictions: Sequence[TakePredictions], names: Sequence[str], by: Callable[[Recording], str]) -> Counts:
    row = {name: number for number, name in enumerate(names)}
    counts = np.zeros((len(names), 4))
    for take in predictions:
        called_rough = rough_score(take.probabilities[take.contact], "two-class") >= 0.5
        column = 2 if take.recording.label is Touch.ROUGH else 0
        counts[row[by(take.recording)], column : column + 2] += (len(called_rough), called_rough.sum())
    return counts


def _change(values: Sequence[float], drawn: Sequence[Sequence[float]]) -> Change:
    differences = np.subtract(drawn[1], drawn[0])
    return Change(
        interval(values[0], drawn[0]), interval(values[1], drawn[1]), interval(values[1] - values[0], differences)
    )
