"""Every method on the same splits of a data set, its controls beside it, and never two kinds of sound in one figure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from tactophone.benchmark.crossvalidation import Cache, Method, cross_validate, shuffle_labels
from tactophone.benchmark.height_regression import HeightMethod, Heights, compare_heights
from tactophone.benchmark.job_runner import Job, Place, run_jobs
from tactophone.benchmark.result import BenchmarkEntry, Result, compare_entries, scored
from tactophone.dataset import Dataset, Fold, split
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.predictions import scores_of
from tactophone.evaluation.transitions import join_edges
from tactophone.simulation.content.render_store import read_metadata_of

SURFACE_SPLIT, EDGE_SPLIT = "leave-one-surface-out", "5-fold"
"""Edges need smooth and rough surfaces on the held-out side, which one surface at a time does not have."""

OTHER_SPLITS = ("speed", "stroke", "pressure", "scenario", "session")
"""Keys left out one value at a time, where the data tells them; the paper's strokes stand for speeds."""

MOST_VALUES = 8
"""A key with more values is dealt to five folds: one value at a time would take hours, and say no more."""

DEALS = (0, 1, 2)
"""Seeds by which labels are dealt anew for the control."""


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
    learner
        Learns labels dealt anew, for the control.
    heights
        Regresses the surfaces' Ra, where they tell it.
    """

    dataset: Dataset
    contenders: tuple[BenchmarkEntry, ...]
    splits: tuple[str, ...]
    learner: Method
    heights: HeightMethod | None = None


@dataclass(frozen=True, slots=True)
class Findings:
    """What a benchmark found on one data set.

    Parameters
    ----------
    dataset, origin
        Its name, and whether its sound is simulated, in words.
    results
        Split by split, of every contender.
    dealt
        By split: balanced accuracies of our own detector, learnt and scored on labels dealt anew over the surfaces.
    heights
        By split: how well Ra is told from sound.
    """

    dataset: str
    origin: str
    results: tuple[Result, ...]
    dealt: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    heights: Mapping[str, Heights] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Give plain dictionaries and lists."""
        return asdict(self)


def splits_of(dataset: Dataset, *, fast: bool = False) -> tuple[str, ...]:
    """Give the splits that a data set allows: by surface always, by other keys where there are two values or more."""
    if fast:
        return ("3-fold",)
    surfaces = (SURFACE_SPLIT, EDGE_SPLIT) if len(dataset.surfaces) >= 5 else (SURFACE_SPLIT,)
    values = {key: len({one.known(key) for one in dataset.labelled().recordings}) for key in OTHER_SPLITS}
    return (*surfaces, *(_split_by(key, count) for key, count in values.items() if count > 1))


def origin_of(dataset: Dataset) -> str:
    """Tell whether sound is simulated, for a heading."""
    # The simulator leaves stories beside its files, also in the authors' layout, which has no manifest.
    told = any(one.known("source") == "simulated" or read_metadata_of(one.path) for one in dataset.recordings)
    return "SIMULATED sound" if told else "as recorded"


def run_plan(
    plan: Plan,
    cache: Cache,
    *,
    place: Place = "here",
    workers: int = 2,
    report: Callable[[int, int, str], None] = lambda done, of, name: None,
) -> Findings:
    """Run a plan and score it.

    Parameters
    ----------
    plan
        What is run.
    cache
        Where folds' results are kept; edges lie beside them.
    place, workers
        See :func:`tactophone.benchmark.job_runner.run_jobs`.
    report
        Called with the number of folds done, how many there are at most, and what was done.
    """
    folds = {name: folds_with_edges(plan.dataset, name, cache.folder / "edges") for name in plan.splits}
    dealt = {name: _deal(plan.dataset, name) for name in plan.splits}
    methods = [one.method for one in plan.contenders]
    jobs = [Job(method, fold) for some in folds.values() for method in methods for fold in some]
    jobs += [Job(plan.learner, fold) for deals in dealt.values() for some in deals for fold in some]
    jobs += [Job(plan.heights, fold) for some in folds.values() for fold in some if plan.heights]
    run_jobs(jobs, cache, place=place, workers=workers, report=lambda done, name: report(done, len(jobs), name))
    return Findings(
        plan.dataset.name,
        origin_of(plan.dataset),
        tuple(one for name, some in folds.items() for one in _score(plan, name, some, cache)),
        {name: tuple(_accuracy(plan.learner, some, cache) for some in deals) for name, deals in dealt.items()},
        {name: _heights(plan.heights, some, cache) for name, some in folds.items() if plan.heights},
    )


def folds_with_edges(dataset: Dataset, name: str, folder: Path) -> list[Fold]:
    """Split, and add to each held-out side the edges between its own surfaces."""
    folds = split(dataset, name)
    if "surface" not in name and not name.endswith("-fold"):
        return list(folds)
    return [replace(fold, test=(*fold.test, *join_edges(fold.test, folder))) for fold in folds]


def _split_by(key: str, values: int) -> str:
    return f"leave-one-{key}-out" if values <= MOST_VALUES else f"5-fold-by-{key}"


def _deal(dataset: Dataset, name: str) -> list[tuple[Fold, ...]]:
    return [split(shuffle_labels(dataset, seed=seed), name) for seed in DEALS]


def _score(plan: Plan, name: str, folds: Sequence[Fold], cache: Cache) -> list[Result]:
    judged = {one.name: cross_validate(one.method, folds, cache=cache) for one in plan.contenders}
    return compare_entries(plan.dataset, plan.contenders, name, judged)


def _accuracy(method: Method, folds: Sequence[Fold], cache: Cache) -> float:
    judged = map(scored, cross_validate(method, folds, cache=cache))
    return measure(scores_of(judged, "two-class"))["balanced_accuracy"]


def _heights(method: HeightMethod, folds: Sequence[Fold], cache: Cache) -> Heights:
    return compare_heights(map(scored, cross_validate(method, folds, cache=cache)))
