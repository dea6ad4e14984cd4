"""A benchmark of one data set: every method on the same splits, with controls; simulated and real sound never mix."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from tactophone.benchmark.crossvalidation import Cache, Method, cross_validate, permute_labels
from tactophone.benchmark.entries import REFERENCE_SEEDS, BenchmarkEntry, channels_of, entries_for, reference_with_seed
from tactophone.benchmark.height_regression import HeightMethod, Heights, compare_heights
from tactophone.benchmark.job_runner import Job, run_jobs
from tactophone.benchmark.methods import recipe_method
from tactophone.benchmark.result import MethodResult, compare_entries
from tactophone.dataset import KIN_SPLIT, Dataset, Fold, kin_of, split
from tactophone.evaluation import in_true_contact, join_edges, measure, scores_of
from tactophone.simulation import read_render_metadata
from tactophone.training import FeatureSpec

EDGE_SPLIT = "5-fold"
"""Edges need smooth and rough surfaces on the held-out side, which one kin at a time may not have."""

OTHER_SPLITS = ("speed", "stroke", "pressure", "scenario", "session")
"""Keys left out one value at a time, where the data has them; the paper's strokes stand for speeds."""

MOST_VALUES = 8
"""A key with more values is split into five folds: one value at a time would take hours, and say no more."""

PERMUTATION_SEEDS = (0, 1, 2)
"""Of the control with permuted labels."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What runs on one data set."""

    dataset: Dataset
    """Labelled, usable recordings."""
    entries: tuple[BenchmarkEntry, ...]
    """The first is the reference that the others are compared with."""
    splits: tuple[str, ...]
    """Names, as ``--splits`` takes them."""
    permuted: Method
    """Method that learns permuted labels, as a control."""
    heights: HeightMethod | None = None
    """Regresses Ra, where surfaces have it."""
    seeds: tuple[Method, ...] = ()
    """The reference's method with each further seed."""


@dataclass(frozen=True, slots=True)
class DatasetResults:
    """Results of a benchmark on one data set."""

    dataset: str
    origin: str
    """`dataset` and `origin`: its name, and whether its sound is simulated, in words."""
    results: tuple[MethodResult, ...]
    """Of every entry, split by split."""
    permuted: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """By split: balanced accuracies of the method ``texture``, trained and scored on permuted labels."""
    heights: Mapping[str, Heights] = field(default_factory=dict)
    """By split: how well Ra is estimated from sound."""
    seeds: Mapping[str, tuple[tuple[float, float], ...]] = field(default_factory=dict)
    """By split: balanced accuracy and AUC of the reference, over windows, with each of its seeds."""

    def as_json(self) -> dict[str, Any]:
        """Return plain dictionaries and lists."""
        return asdict(self)


def plan_for(dataset: Dataset, names: Sequence[str], splits: Sequence[str], *, fast: bool = False) -> Plan:
    """Plan a benchmark of the named entries, all if there are no names, with its controls.

    The reference runs with several seeds; with ``fast``, with one, and fewer steps. Raises `ConfigError` if a name is
    unknown.
    """
    channels = channels_of(dataset)
    has_heights = any(recording.known("ra_um") for recording in dataset.recordings)
    heights = HeightMethod(FeatureSpec("texture", channels)) if has_heights else None
    permuted = recipe_method("texture", channels=channels)
    entries = entries_for(dataset, names, fast=fast)
    seeds = () if fast else REFERENCE_SEEDS[1:]
    others = (reference_with_seed(dataset, entries[0].name, seed) for seed in seeds)
    return Plan(dataset, entries, tuple(splits), permuted, heights, tuple(filter(None, others)))


def splits_of(dataset: Dataset, *, fast: bool = False) -> tuple[str, ...]:
    """Return the splits that a data set allows: by kin always, by other keys where there are two values or more."""
    if fast:
        return ("3-fold",)
    kin = {kin_of(recording) for recording in dataset.labelled().recordings}
    surfaces = (KIN_SPLIT, EDGE_SPLIT) if len(kin) >= 5 else (KIN_SPLIT,)
    counts = {key: len({take.known(key) for take in dataset.labelled().recordings}) for key in OTHER_SPLITS}
    by_key = {key: f"leave-one-{key}-out" if n <= MOST_VALUES else f"5-fold-by-{key}" for key, n in counts.items()}
    return (*surfaces, *(by_key[key] for key, count in counts.items() if count > 1))


def origin_of(dataset: Dataset) -> str:
    """Return whether sound is simulated, in words, for a heading."""
    # The simulator writes metadata beside its files, also in the authors' layout, which has no manifest.
    simulated = any(
        take.known("source") == "simulated" or read_render_metadata(take.path) for take in dataset.recordings
    )
    return "SIMULATED sound" if simulated else "as recorded"


def run_plan(
    plan: Plan,
    cache: Cache,
    *,
    workers: int = 1,
    ray: bool = False,
    report: Callable[[int, int, str], None] = lambda done, of, name: None,
) -> DatasetResults:
    """Run a plan, with ``workers`` and ``ray`` as in `run_jobs`, and score it.

    ``report`` is called with the number of folds done, the most that there can be, and the name of the last one.
    """
    folds = {name: folds_with_edges(plan.dataset, name, cache.folder / "edges") for name in plan.splits}
    permuted = {
        name: [split(permute_labels(plan.dataset, seed=seed), name) for seed in PERMUTATION_SEEDS]
        for name in plan.splits
    }
    methods = [*(entry.method for entry in plan.entries), *([plan.heights] if plan.heights else []), *plan.seeds]
    jobs = [Job(method, fold) for of_split in folds.values() for method in methods for fold in of_split]
    jobs += [Job(plan.permuted, fold) for sets in permuted.values() for of_set in sets for fold in of_set]
    run_jobs(jobs, cache, workers=workers, ray=ray, report=lambda done, name: report(done, len(jobs), name))

    # All predictions are cached by now: what follows only reads and scores them.
    results: list[MethodResult] = []
    for name, of_split in folds.items():
        predictions = {entry.name: cross_validate(entry.method, of_split, cache=cache) for entry in plan.entries}
        results += compare_entries(plan.dataset, plan.entries, name, predictions)
    return DatasetResults(
        plan.dataset.name,
        origin_of(plan.dataset),
        tuple(results),
        {
            name: tuple(_window_scores(plan.permuted, of_set, cache)[0] for of_set in sets)
            for name, sets in permuted.items()
        },
        {
            name: compare_heights(map(in_true_contact, cross_validate(plan.heights, of_split, cache=cache)))
            for name, of_split in folds.items()
            if plan.heights
        },
        {
            name: tuple(_window_scores(method, of_split, cache) for method in (plan.entries[0].method, *plan.seeds))
            for name, of_split in folds.items()
            if plan.seeds
        },
    )


def folds_with_edges(dataset: Dataset, name: str, folder: Path) -> list[Fold]:
    """Split, and add to each held-out side the joined edges between its own surfaces."""
    folds = split(dataset, name)
    if not any(key in name for key in ("surface", "kin")) and not name.endswith("-fold"):
        return list(folds)
    return [replace(fold, test=(*fold.test, *join_edges(fold.test, folder))) for fold in folds]


def _window_scores(method: Method, folds: Sequence[Fold], cache: Cache) -> tuple[float, float]:
    """Balanced accuracy and AUC over windows in true contact."""
    predictions = map(in_true_contact, cross_validate(method, folds, cache=cache))
    metrics = measure(scores_of(predictions, "two-class"))
    return metrics["balanced_accuracy"], metrics["auc"]
