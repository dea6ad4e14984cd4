"""A benchmark of one data set: every method on the same splits, with a control;
simulated and real sound never mix."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from tactophone.core.recordings.values import Dataset
from tactophone.core.types import ignore
from tactophone_lab.benchmark.folds import (
    Cache,
    Method,
    MethodFold,
    cross_validate,
    permute_labels,
    run_folds,
)
from tactophone_lab.benchmark.methods import channels_of, methods_for, recipe_method
from tactophone_lab.benchmark.results import (
    DatasetResults,
    MethodResult,
    compare_methods,
)
from tactophone_lab.datasets.splits import KIN_SPLIT, Fold, kin_of, split
from tactophone_lab.evaluation.bumps_and_delays import join_edges
from tactophone_lab.evaluation.metrics import measure
from tactophone_lab.evaluation.predict import in_true_contact, scores_of
from tactophone_lab.simulation.render import read_render_metadata

EDGE_SPLIT = "5-fold"
"""Edges need smooth and rough surfaces on the held-out side, which one kin at a time
may not have."""

OTHER_SPLITS = ("speed", "stroke", "pressure", "scenario", "session")
"""Keys left out one value at a time, where the data has them; the paper's strokes stand
for speeds."""

MOST_VALUES = 8
"""A key with more values is split into five folds: one value at a time would take
hours, and say no more."""

PERMUTATION_SEEDS = (0, 1, 2)
"""Of the control with permuted labels."""


def splits_of(dataset: Dataset, *, fast: bool = False) -> tuple[str, ...]:
    """Return the splits that a data set allows: by kin always, by other keys where
    there are two values or more."""
    if fast:
        return ("3-fold",)
    kin = {kin_of(recording) for recording in dataset.labelled().recordings}
    surfaces = (KIN_SPLIT, EDGE_SPLIT) if len(kin) >= 5 else (KIN_SPLIT,)
    counts = {
        key: len({take.known(key) for take in dataset.labelled().recordings})
        for key in OTHER_SPLITS
    }
    by_key = {
        key: f"leave-one-{key}-out" if n <= MOST_VALUES else f"5-fold-by-{key}"
        for key, n in counts.items()
    }
    return (*surfaces, *(by_key[key] for key, count in counts.items() if count > 1))


def origin_of(dataset: Dataset) -> str:
    """Return whether sound is simulated, in words, for a heading."""
    # The simulator writes metadata beside its files, also in the authors' layout, which
    # has no manifest.
    simulated = any(
        take.known("source") == "simulated" or read_render_metadata(take.path)
        for take in dataset.recordings
    )
    return "SIMULATED sound" if simulated else "as recorded"


def run_benchmark(
    dataset: Dataset,
    names: Sequence[str],
    splits: Sequence[str],
    cache: Cache,
    *,
    fast: bool = False,
    workers: int = 1,
    ray: bool = False,
    report: Callable[[int, int, str], None] = ignore,
) -> DatasetResults:
    """Score the named methods, all if there are no names, and the control on splits of
    labelled, usable recordings.

    The first method is the reference that the others are compared with. With ``fast``,
    the paper's network is trained for fewer steps. ``workers`` and ``ray`` are as in
    `run_folds`; ``report`` is called with the number of folds done, the most that there
    can be, and the name of the last one. Raises `ConfigError` if a name is unknown.
    """
    methods = methods_for(dataset, names, fast=fast)
    control = recipe_method("texture", channels=channels_of(dataset))
    folds = {
        name: folds_with_edges(dataset, name, cache.folder / "edges") for name in splits
    }
    permuted = {
        name: [
            split(permute_labels(dataset, seed=seed), name)
            for seed in PERMUTATION_SEEDS
        ]
        for name in splits
    }
    todo: list[MethodFold] = [
        (method, fold)
        for of_split in folds.values()
        for method in methods
        for fold in of_split
    ]
    todo += [
        (control, fold)
        for sets in permuted.values()
        for of_set in sets
        for fold in of_set
    ]
    run_folds(
        todo,
        cache,
        workers=workers,
        ray=ray,
        report=lambda done, name: report(done, len(todo), name),
    )

    # All predictions are cached by now: what follows only reads and scores them.
    results: list[MethodResult] = []
    for name, of_split in folds.items():
        predictions = {
            method.name: cross_validate(method, of_split, cache=cache)
            for method in methods
        }
        results += compare_methods(dataset, methods, name, predictions)
    return DatasetResults(
        dataset.name,
        origin_of(dataset),
        tuple(results),
        {
            name: tuple(_accuracy(control, of_set, cache) for of_set in sets)
            for name, sets in permuted.items()
        },
    )


def folds_with_edges(dataset: Dataset, name: str, folder: Path) -> list[Fold]:
    """Split, and add to each held-out side the joined edges between its own
    surfaces."""
    folds = split(dataset, name)
    if not any(key in name for key in ("surface", "kin")) and not name.endswith(
        "-fold"
    ):
        return list(folds)
    return [
        replace(fold, test=(*fold.test, *join_edges(fold.test, folder)))
        for fold in folds
    ]


def _accuracy(method: Method, folds: Sequence[Fold], cache: Cache) -> float:
    """Balanced accuracy over windows in true contact."""
    predictions = map(in_true_contact, cross_validate(method, folds, cache=cache))
    return measure(scores_of(predictions, "two-class"))["balanced_accuracy"]
