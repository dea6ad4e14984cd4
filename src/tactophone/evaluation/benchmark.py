"""Every method on the same splits: scored, felt, compared in pairs, and never two kinds of sound in one figure."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tactophone.dataset import Dataset, Fold, split
from tactophone.errors import DatasetError
from tactophone.evaluation.bootstrap import Estimate, estimate
from tactophone.evaluation.crossvalidation import Cache, Method, cross_validate, shuffle_labels
from tactophone.evaluation.edges import join_edges
from tactophone.evaluation.farm import Job, Place, run_jobs
from tactophone.evaluation.felt import (
    Delays,
    calibration_error,
    contact_delays,
    edge_delays,
    false_bumps_per_minute,
    truly_touching,
)
from tactophone.evaluation.hardness import false_positives
from tactophone.evaluation.judging import Judgement, scores_of
from tactophone.evaluation.metrics import Scores
from tactophone.evaluation.paired import Difference, compare
from tactophone.perception import DecisionRule

MEASURES = ("balanced_accuracy", "auc", "recall_at_1", "false_positive_rate")
SURFACE_SPLIT, EDGE_SPLIT = "leave-one-surface-out", "5-fold"
"""Edges need smooth and rough surfaces on the held-out side, which one surface at a time does not have."""

OTHER_SPLITS = ("stroke", "pressure", "scenario", "session")
"""Keys left out one value at a time, where the data tells them; ``stroke`` stands for speed."""

MOST_VALUES = 8
"""A key with more values is left to ``--splits``: its folds would take hours, and say little that surfaces do not."""


@dataclass(frozen=True, slots=True)
class Contender:
    """A method with how the live system acts on it.

    Parameters
    ----------
    method
        Learns and judges.
    rule
        Of the decision.
    latency
        Seconds from a window's end to its judgement.
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
        See :mod:`tactophone.evaluation.felt`.
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

    def as_json(self) -> dict[str, Any]:
        """Give plain dictionaries and lists."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Plan:
    """What is run on one data set.

    Parameters
    ----------
    dataset
        Labelled, usable recordings.
    contenders
        The first is the reference that the others are compared with.
    splits
        Names, as ``--splits`` takes them.
    """

    dataset: Dataset
    contenders: tuple[Contender, ...]
    splits: tuple[str, ...]


def splits_of(dataset: Dataset, *, fast: bool = False) -> tuple[str, ...]:
    """Give the splits that a data set allows: by surface always, by other keys where there are two values or more."""
    if fast:
        return ("3-fold",)
    surfaces = (SURFACE_SPLIT, EDGE_SPLIT) if len(dataset.surfaces) >= 5 else (SURFACE_SPLIT,)
    values = {key: {one.known(key) for one in dataset.recordings} for key in OTHER_SPLITS}
    known = [key for key, some in values.items() if 1 < len(some) <= MOST_VALUES]
    return (*surfaces, *(f"leave-one-{key}-out" for key in known))


def run_plan(
    plan: Plan,
    cache: Cache,
    *,
    place: Place = "here",
    workers: int = 2,
    report: Callable[[int, int, str], None] = lambda done, of, name: None,
) -> list[Result]:
    """Run a plan and score it.

    Parameters
    ----------
    plan
        What is run.
    cache
        Where folds' results are kept; edges lie beside them.
    place, workers
        See :func:`tactophone.evaluation.farm.run_jobs`.
    report
        Called with the number of folds done, how many there are at most, and what was done.
    """
    folds = {name: folds_with_edges(plan.dataset, name, cache.folder / "edges") for name in plan.splits}
    jobs = [Job(one.method, fold) for some in folds.values() for one in plan.contenders for fold in some]
    run_jobs(jobs, cache, place=place, workers=workers, report=lambda done, name: report(done, len(jobs), name))
    results = []
    for name, some in folds.items():
        judged = {one.name: cross_validate(one.method, some, cache=cache) for one in plan.contenders}
        results += _results(plan, name, judged)
    return results


def folds_with_edges(dataset: Dataset, name: str, folder: Path) -> list[Fold]:
    """Split, and add to each held-out side the edges between its own surfaces."""
    folds = split(dataset, name)
    if "surface" not in name and not name.endswith("-fold"):
        return list(folds)
    return [replace(fold, test=(*fold.test, *join_edges(fold.test, folder))) for fold in folds]


def shuffled_control(plan: Plan, cache: Cache, *, seeds: Sequence[int] = (0, 1, 2)) -> list[float]:
    """Give the balanced accuracies of the last contender on labels dealt anew over the surfaces, a seed each."""
    found = []
    for seed in seeds:
        folds = split(shuffle_labels(plan.dataset, seed=seed), EDGE_SPLIT)
        judged = cross_validate(plan.contenders[-1].method, folds, cache=cache)
        scores = scores_of(map(scored, judged), "two-class")
        found.append(float(estimate(scores, draws=0)["balanced_accuracy"].value))
    return found


def scored(judgement: Judgement) -> Judgement:
    """Let the truth be the gate: all methods answer for the same moments, whatever their own gates say."""
    return replace(judgement, contact=truly_touching(judgement))


def _results(plan: Plan, name: str, judged: dict[str, list[Judgement]]) -> list[Result]:
    scores = {method: scores_of(map(scored, some), "two-class") for method, some in judged.items()}
    reference = scores[plan.contenders[0].name]
    results = []
    for one in plan.contenders:
        try:
            results.append(_result(plan.dataset, one, name, judged[one.name], scores[one.name], reference))
        except DatasetError as error:
            raise DatasetError(f"{plan.dataset.name}, {name}, {one.name}: {error}") from error
    return results


def _result(  # one line for each thing that is told
    dataset: Dataset, one: Contender, name: str, judged: list[Judgement], scores: Scores, reference: Scores
) -> Result:
    labelled = [scored(judgement) for judgement in judged if judgement.recording.label is not None]
    contact = contact_delays(judged, one.rule, latency=one.latency)
    edge = edge_delays(judged, one.rule, latency=one.latency)
    recall = float((reference.score[reference.rough] >= 0.5).mean())
    return Result(
        one.name,
        dataset.name,
        name,
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
    )


def _estimates(judged: Sequence[Judgement], rule: Any) -> dict[str, Estimate]:
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
