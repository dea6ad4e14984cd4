"""Results of a benchmark: of a method as rendered, by windows, events and its
difference from the reference."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Dataset
from tactophone_lab.benchmark.methods import BenchmarkMethod
from tactophone_lab.evaluation.bootstrap import (
    Difference,
    Estimate,
    correct_for_number,
    estimate,
    paired_difference,
)
from tactophone_lab.evaluation.bumps_and_delays import (
    Delays,
    calibration_error,
    contact_delays,
    edge_delays,
    false_bumps_per_minute,
)
from tactophone_lab.evaluation.metrics import (
    SCORING_RULES,
    Scores,
    false_positives_at_recall,
)
from tactophone_lab.evaluation.predict import (
    TakePredictions,
    in_true_contact,
    scores_of,
)
from tactophone_lab.evaluation.scores import Rendered, rendered_scores

MEASURES = ("balanced_accuracy", "auc", "recall_at_1", "false_positive_rate")


@dataclass(frozen=True, slots=True)
class MethodResult:
    """Scores of a method on one split of one data set."""

    method: str
    dataset: str
    split: str
    rendered: Rendered
    """What the operator gets, contact gate, abstention and decision rule inside: the
    headline."""
    scores: dict[str, dict[str, Estimate]]
    """By rule and metric, with intervals over surfaces; over updates in true contact,
    without gate and abstention."""
    false_positives_at_reference: float
    """Share of smooth updates classified as rough, at the threshold with the
    reference's rough recall."""
    bumps_per_minute: float
    calibration_error: float
    """`bumps_per_minute` and `calibration_error`: see
    :mod:`tactophone_lab.evaluation.bumps_and_delays`."""
    contact_ms: tuple[float, float, float]
    edge_ms: tuple[float, float, float]
    """`contact_ms` and `edge_ms`: p50 and p95 of the time to a correct decision, in ms,
    over all changes, and the share of changes without a correct decision, which count
    as infinite."""
    differences: dict[str, Difference]
    """From the reference, in pairs, by the two-class rule; p-values are corrected over
    all methods and measures."""
    by_surface: dict[str, float]
    """Share of updates classified correctly."""
    curve: tuple[tuple[float, float], ...]
    """Points of the ROC curve: false positive rate, recall."""


@dataclass(frozen=True, slots=True)
class DatasetResults:
    """Results of a benchmark on one data set."""

    dataset: str
    origin: str
    """`dataset` and `origin`: its name, and whether its sound is simulated, in
    words."""
    results: tuple[MethodResult, ...]
    """Of every method, split by split."""
    permuted: Mapping[str, tuple[float, ...]]
    """By split: balanced accuracies of the method ``texture``, trained and scored on
    permuted labels."""


def compare_methods(
    dataset: Dataset,
    methods: Sequence[BenchmarkMethod],
    split: str,
    predictions: Mapping[str, list[TakePredictions]],
) -> list[MethodResult]:
    """Score methods on one split of a data set, each also as its difference from the
    first.

    Raises `DatasetError` if there is no update in true contact.
    """
    scores = {
        name: scores_of(map(in_true_contact, takes), "two-class")
        for name, takes in predictions.items()
    }
    reference = scores[methods[0].name]
    results = []
    for method in methods:
        try:
            results.append(
                _result(
                    dataset,
                    method,
                    split,
                    predictions[method.name],
                    scores[method.name],
                    reference,
                )
            )
        except DatasetError as error:
            raise DatasetError(
                f"{dataset.name}, {split}, {method.name}: {error}"
            ) from error
    # P-values are corrected for the number of comparisons.
    compared = {
        (result.method, name): each
        for result in results
        for name, each in result.differences.items()
    }
    corrected = correct_for_number(compared)
    return [
        replace(
            result,
            differences={
                name: corrected[result.method, name] for name in result.differences
            },
        )
        for result in results
    ]


def _result(
    dataset: Dataset,
    method: BenchmarkMethod,
    split: str,
    predictions: list[TakePredictions],
    scores: Scores,
    reference: Scores,
) -> MethodResult:
    labelled = [
        in_true_contact(take)
        for take in predictions
        if take.recording.label is not None
    ]
    recall = float((reference.score[reference.rough] >= 0.5).mean())
    differences = {} if scores is reference else paired_difference(scores, reference)
    correct = (scores.score >= 0.5) == scores.rough
    estimates = {rule: estimate(scores_of(labelled, rule)) for rule in SCORING_RULES}
    kept = (*MEASURES, "smooth_accuracy", "rough_accuracy")
    return MethodResult(
        method.name,
        dataset.name,
        split,
        rendered_scores(predictions, method.rule),
        {
            rule: {name: of_rule[name] for name in kept}
            for rule, of_rule in estimates.items()
        },
        false_positives_at_recall(scores, recall),
        false_bumps_per_minute(predictions, method.rule),
        calibration_error(labelled),
        _summary(contact_delays(predictions, method.rule, latency=method.latency)),
        _summary(edge_delays(predictions, method.rule, latency=method.latency)),
        {name: differences[name] for name in MEASURES if name in differences},
        {
            name: float(correct[scores.surface == number].mean())
            for number, name in enumerate(scores.names)
        },
        _curve(scores),
    )


def _summary(delays: Delays) -> tuple[float, float, float]:
    return delays.quantile_ms(0.5), delays.quantile_ms(0.95), delays.missed_share


def _curve(scores: Scores, points: int = 120) -> tuple[tuple[float, float], ...]:
    smooth = scores.score[~scores.rough]
    rough = scores.score[scores.rough]
    shares = np.concatenate(
        (np.geomspace(1e-3, 0.1, points // 2), np.linspace(0.1, 1, points // 2))
    )
    limits = np.quantile(smooth, 1 - shares)
    return tuple(
        (float(share), float((rough > limit).mean()))
        for share, limit in zip(shares, limits, strict=True)
    )
