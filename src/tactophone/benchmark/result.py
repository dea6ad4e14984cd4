"""How a method did on one split of one data set: scored, felt, and compared with the reference in pairs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tactophone.benchmark.crossvalidation import Method
from tactophone.benchmark.dataset_difficulty import false_positives
from tactophone.benchmark.height_regression import height_correlation
from tactophone.dataset import Dataset
from tactophone.errors import DatasetError
from tactophone.evaluation.bootstrap import Estimate, estimate
from tactophone.evaluation.event_metrics import (
    Delays,
    calibration_error,
    contact_delays,
    edge_delays,
    false_bumps_per_minute,
    truly_touching,
)
from tactophone.evaluation.metrics import Scores
from tactophone.evaluation.paired import Difference, compare
from tactophone.evaluation.predictions import TakePredictions, scores_of
from tactophone.perception import DecisionRule

MEASURES = ("balanced_accuracy", "auc", "recall_at_1", "false_positive_rate")


@dataclass(frozen=True, slots=True)
class BenchmarkEntry:
    """A method with how the live system acts on it.

    Parameters
    ----------
    method
        Learns and judges.
    rule
        Of the decision.
    latency
        Seconds from a window's end to its take_predictions.
    control
        Whether it is here to be distrusted by, not to compete.
    """

    method: Method
    rule: DecisionRule = field(default_factory=DecisionRule)
    latency: float = 0.0
    control: bool = False

    @property
    def name(self) -> str:
        """Of the method."""
        return self.method.name


@dataclass(frozen=True, slots=True)
class Result:
    """How a method did on one split of one data set.

    Parameters
    ----------
    method, dataset, split
        Which.
    control
        Whether the method is a control.
    scores
        By rule and measure, with intervals over surfaces; of updates while the finger truly touches.
    false_positives_at_reference
        Share of smooth updates called rough at the threshold that finds as many rough ones as the reference does.
    bumps_per_minute, calibration_error
        See :mod:`tactophone.evaluation.event_metrics`.
    contact_ms, edge_ms
        Median and 95th percentile of the time to a right decision, and the share that never came.
    differences
        From the reference, in pairs, by the two-class rule.
    by_surface
        Share of updates judged rightly.
    curve
        Points of the ROC curve: false positive rate, recall.
    reliability
        Mean confidence and share of rough in ten bins of confidence.
    height_correlation
        Spearman's, over surfaces, of the mean confidence in rough with the true Ra; NaN where that is not told.
    """

    method: str
    dataset: str
    split: str
    control: bool
    scores: dict[str, dict[str, Estimate]]
    false_positives_at_reference: float
    bumps_per_minute: float
    calibration_error: float
    contact_ms: tuple[float, float, float]
    edge_ms: tuple[float, float, float]
    differences: dict[str, Difference]
    by_surface: dict[str, float]
    curve: tuple[tuple[float, float], ...]
    reliability: tuple[tuple[float, float], ...]
    height_correlation: float


def compare_entries(
    dataset: Dataset, contenders: Sequence[BenchmarkEntry], split: str, judged: Mapping[str, list[TakePredictions]]
) -> list[Result]:
    """Score contenders on one split of a data set, each also as its difference from the first.

    Parameters
    ----------
    dataset
        What was judged.
    contenders
        The first is the reference.
    split
        Its name.
    judged
        What each said, by its name.

    Raises
    ------
    DatasetError
        If one's contact gate was never open.
    """
    scores = {method: scores_of(map(scored, some), "two-class") for method, some in judged.items()}
    reference = scores[contenders[0].name]
    results = []
    for one in contenders:
        try:
            results.append(_result(dataset, one, split, judged[one.name], scores[one.name], reference))
        except DatasetError as error:
            raise DatasetError(f"{dataset.name}, {split}, {one.name}: {error}") from error
    return results


def scored(take_predictions: TakePredictions) -> TakePredictions:
    """Let the truth be the gate: all methods answer for the same moments, whatever their own gates say."""
    return replace(take_predictions, contact=truly_touching(take_predictions))


def _result(  # one line for each thing that is told
    dataset: Dataset, one: BenchmarkEntry, split: str, judged: list[TakePredictions], scores: Scores, reference: Scores
) -> Result:
    labelled = [scored(take_predictions) for take_predictions in judged if take_predictions.recording.label is not None]
    contact = contact_delays(judged, one.rule, latency=one.latency)
    edge = edge_delays(judged, one.rule, latency=one.latency)
    recall = float((reference.score[reference.rough] >= 0.5).mean())
    return Result(
        one.name,
        dataset.name,
        split,
        one.control,
        {rule: _estimates(labelled, rule) for rule in ("authors", "two-class")},
        false_positives(scores, np.ones(len(scores.score)), recall=recall),
        false_bumps_per_minute(judged, one.rule),
        calibration_error(labelled),
        _told(contact),
        _told(edge),
        {} if scores is reference else _differences(scores, reference),
        _by_surface(scores),
        _curve(scores),
        _reliability(scores),
        height_correlation(labelled),
    )


def _estimates(judged: Sequence[TakePredictions], rule: Any) -> dict[str, Estimate]:
    found = estimate(scores_of(judged, rule))
    return {name: found[name] for name in (*MEASURES, "smooth_accuracy", "rough_accuracy")}


def _differences(scores: Scores, reference: Scores) -> dict[str, Difference]:
    found = compare(scores, reference)
    return {name: found[name] for name in MEASURES}


def _told(delays: Delays) -> tuple[float, float, float]:
    return delays.quantile_ms(0.5), delays.quantile_ms(0.95), delays.missed_share


def _by_surface(scores: Scores) -> dict[str, float]:
    right = (scores.score >= 0.5) == scores.rough
    return {name: float(right[scores.surface == number].mean()) for number, name in enumerate(scores.names)}


def _curve(scores: Scores, points: int = 120) -> tuple[tuple[float, float], ...]:
    smooth, rough = scores.score[~scores.rough], scores.score[scores.rough]
    shares = np.concatenate((np.geomspace(1e-3, 0.1, points // 2), np.linspace(0.1, 1, points // 2)))
    limits = np.quantile(smooth, 1 - shares)
    return tuple((float(share), float((rough > limit).mean())) for share, limit in zip(shares, limits, strict=True))


def _reliability(scores: Scores, bins: int = 10) -> tuple[tuple[float, float], ...]:
    place = np.minimum((scores.score * bins).astype(int), bins - 1)
    return tuple(
        (float(scores.score[place == one].mean()), float(scores.rough[place == one].mean()))
        for one in range(bins)
        if (place == one).sum() >= 20
    )
