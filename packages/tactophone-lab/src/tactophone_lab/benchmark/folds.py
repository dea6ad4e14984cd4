"""Cross-validation: every recording is predicted by a model that was trained without
its side of the split.

A fold is a pure function of its method and its recordings, so it may run in this
process, on the machine's cores, or on a Ray cluster; its predictions are cached by
content. A worker that dies loses the fold it was at: that fold runs again, the others
do not.
"""

import functools
import hashlib
import importlib.util
import os
import zipfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np

from tactophone.core.errors import ConfigError
from tactophone.core.processes import atomic_write, open_pool
from tactophone.core.recordings.values import Dataset, Recording, fingerprint
from tactophone.core.types import Touch, ignore
from tactophone_lab.datasets.splits import Fold
from tactophone_lab.evaluation.predict import Predictor, TakePredictions

TRAINING_CODE = (
    "tactophone/signal/perception",
    "tactophone_lab/training",
    "tactophone/signal/haptics/passthrough.py",
    "tactophone/net/link/codec.py",
    "tactophone/core/types.py",
    "tactophone/core/microphones.py",
    "tactophone/core/recordings/values.py",
    "tactophone_lab/benchmark/methods.py",
)
"""Folders and files of both packages that train detectors or run them."""

MOST_DEATHS = 3
"""Times that workers may die before the run gives up, because a fold kills them."""


class Method(Protocol):
    """Anything that trains on recordings and then predicts others;
    :mod:`tactophone_lab.benchmark.methods` has them."""

    @property
    def name(self) -> str:
        """For tables."""

    @property
    def identity(self) -> str:
        """Text that changes whenever the predictions may, for equal recordings: key of
        cached folds."""

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Train on labelled recordings; return a predictor of other recordings."""


MethodFold: TypeAlias = tuple[Method, Fold]
"""What runs somewhere: one fold of one method."""


@dataclass(frozen=True, slots=True)
class Cache:
    """Predictions on disk, keyed by everything that they follow from, so that a second
    run takes seconds.

    A changed method, label, sound or line of the code that trains has another key;
    entries never need to be deleted by hand.
    """

    folder: Path

    def get(self, key: str, fold: Fold) -> list[TakePredictions] | None:
        """Return a fold's predictions; ``None`` if they are absent or broken."""
        try:
            with np.load(self.folder / f"{key}.npz", allow_pickle=False) as file:
                return [
                    TakePredictions(
                        recording,
                        file[f"time{n}"],
                        file[f"probabilities{n}"],
                        file[f"contact{n}"],
                        file.get(f"touch{n}"),
                        file.get(f"unknown{n}"),
                    )
                    for n, recording in enumerate(fold.test)
                ]
        except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
            return None

    def holds(self, key: str) -> bool:
        """Return whether a fold's predictions are there, without reading them."""
        return zipfile.is_zipfile(self.folder / f"{key}.npz")

    def put(self, key: str, predictions: Sequence[TakePredictions]) -> None:
        """Write a fold's predictions, whole or not at all."""
        arrays = {
            f"{name}{n}": array
            for n, take in enumerate(predictions)
            for name, array in (
                ("time", take.time),
                ("probabilities", take.probabilities),
                ("contact", take.contact),
                ("touch", take.touch),
                ("unknown", take.unknown),
            )
            if array is not None
        }
        with (
            atomic_write(self.folder / f"{key}.npz") as unfinished,
            unfinished.open("wb") as file,
        ):
            np.savez_compressed(file, allow_pickle=False, **arrays)


def default_cache() -> Cache:
    """Return the user's cache: ``$XDG_CACHE_HOME/tactophone/folds``, by default below
    ``~/.cache``."""
    home = os.environ.get("XDG_CACHE_HOME")
    return Cache(
        (Path(home) if home else Path.home() / ".cache") / "tactophone" / "folds"
    )


def cross_validate(
    method: Method,
    folds: Sequence[Fold],
    *,
    cache: Cache | None = None,
    report: Callable[[int, str], None] = ignore,
) -> list[TakePredictions]:
    """Predict every fold's test recordings by a model trained on the fold's training
    recordings.

    A killed run loses the fold that it was at. ``report`` is called with the number of
    folds done and the fold's name.
    """
    predictions: list[TakePredictions] = []
    for done, fold in enumerate(folds):
        report(done, fold.name)
        key = fold_key(method, fold)
        of_fold = cache.get(key, fold) if cache else None
        if of_fold is None:
            of_fold = predict_fold(method, fold)
            if cache:
                cache.put(key, of_fold)
        predictions += of_fold
    return predictions


def run_folds(
    folds: Sequence[MethodFold],
    cache: Cache,
    *,
    workers: int = 1,
    ray: bool = False,
    report: Callable[[int, str], None] = ignore,
) -> int:
    """Run the folds whose predictions are not cached, each with its method, and cache
    them; return how many ran.

    One worker is this process itself. With ``ray`` they run on the Ray cluster at
    ``RAY_ADDRESS``, or on a local one of as many processes. ``report`` is called with
    the number of folds done, and the name of the last one. Raises `ConfigError` if Ray
    is chosen and not installed.
    """
    todo = {fold_key(*fold): fold for fold in folds}
    todo = {key: fold for key, fold in todo.items() if not cache.holds(key)}
    results: Iterator[tuple[str, list[TakePredictions]]]
    if ray:
        results = _on_ray(todo, workers)
    elif workers > 1:
        results = _in_processes(todo, workers)
    else:
        results = ((key, predict_fold(*fold)) for key, fold in todo.items())
    for done, (key, predictions) in enumerate(results, 1):
        cache.put(key, predictions)
        method, fold = todo[key]
        report(done, f"{method.name}, {fold.name}")
    return len(todo)


def _in_processes(
    todo: dict[str, MethodFold], workers: int
) -> Iterator[tuple[str, list[TakePredictions]]]:
    left = dict(todo)
    deaths = 0
    while left:
        try:
            with open_pool(workers, prepare=_use_single_thread) as pool:
                futures = {
                    pool.submit(predict_fold, *fold): key for key, fold in left.items()
                }
                try:
                    for future in as_completed(futures):
                        predictions = future.result()
                        del left[futures[future]]
                        yield futures[future], predictions
                finally:
                    pool.shutdown(cancel_futures=True)
        except BrokenProcessPool:
            # A pool whose worker has died takes no more work: what is left runs in
            # another one.
            deaths += 1
            if deaths >= MOST_DEATHS:
                raise


def _use_single_thread() -> None:
    """One thread per worker, because there are as many workers as cores."""
    if importlib.util.find_spec("torch"):
        import torch

        torch.set_num_threads(1)


def _on_ray(
    todo: dict[str, MethodFold], workers: int
) -> Iterator[tuple[str, list[TakePredictions]]]:
    ray = load_ray(workers)
    # Workers that joined elsewhere have another working directory.
    todo = {key: (method, _absolute(fold)) for key, (method, fold) in todo.items()}
    _check_seen(
        ray,
        sorted(
            {
                take.path
                for _, fold in todo.values()
                for take in (*fold.train, *fold.test)
            }
        ),
    )
    # Ray runs a task again if its worker or its machine dies.
    remote = ray.remote(num_cpus=1, max_retries=MOST_DEATHS)(predict_fold)
    running = {remote.remote(*fold): key for key, fold in todo.items()}
    while running:
        (ready,), _ = ray.wait(list(running), num_returns=1)
        yield running.pop(ready), ray.get(ready)


def _absolute(fold: Fold) -> Fold:
    train, test = (
        tuple(replace(take, path=take.path.absolute()) for take in side)
        for side in (fold.train, fold.test)
    )
    return replace(fold, train=train, test=test)


def _check_seen(ray: Any, paths: list[Path]) -> None:
    """Raise `ConfigError` if a machine of the cluster lacks one of the recordings."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    for node in ray.nodes():
        if not node["Alive"]:
            continue
        there = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
        absent = ray.get(
            ray.remote(num_cpus=0, scheduling_strategy=there)(_absent).remote(paths)
        )
        if absent:
            raise ConfigError(
                f"--ray: {node['NodeManagerHostname']} does not see {absent[0]} "
                f"({len(absent)} of {len(paths)} "
                "recordings): put the data set at the same path on every machine, as "
                "on a shared disk"
            )


def _absent(paths: list[Path]) -> list[Path]:
    return [path for path in paths if not path.is_file()]


def load_ray(workers: int) -> Any:
    """Import Ray and join the cluster at ``RAY_ADDRESS``, or start one on this machine.

    Raises `ConfigError` if Ray is not installed.
    """
    if importlib.util.find_spec("ray") is None:
        raise ConfigError(
            "Ray is not installed: pip install 'tactophone-lab[ray]', or leave --ray "
            "away"
        )
    import ray

    if not ray.is_initialized():
        local = (
            {}
            if os.environ.get("RAY_ADDRESS")
            else {"num_cpus": workers, "include_dashboard": False}
        )
        ray.init(log_to_driver=False, logging_level="warning", **local)
    return ray


def predict_fold(method: Method, fold: Fold) -> list[TakePredictions]:
    """Train on a fold's training recordings and predict its test recordings."""
    predict = method.fit(fold.train)
    return [predict(recording) for recording in fold.test]


def permute_labels(dataset: Dataset, *, seed: int) -> Dataset:
    """Permute the labels over the surfaces: what a method scores then, it scores
    without learning roughness."""
    kept = dataset.labelled()
    labels = {recording.surface: recording.label for recording in kept.recordings}
    permuted = np.random.default_rng(seed).permutation(
        [int(labels[name] or 0) for name in kept.surfaces]
    )
    new = {
        name: Touch(int(label))
        for name, label in zip(kept.surfaces, permuted, strict=True)
    }
    return replace(
        kept,
        recordings=tuple(
            replace(take, label=new[take.surface]) for take in kept.recordings
        ),
    )


def fold_key(method: Method, fold: Fold) -> str:
    """Return the cache key of a fold's predictions: a hash of everything that they
    follow from."""
    sides = f"{method.identity} {code_version()}\n{fingerprint(fold.train)}\n"
    # The test side in its own order, because predictions are stored by number.
    tested = "".join(fingerprint([recording]) for recording in fold.test)
    return hashlib.sha256((sides + tested).encode()).hexdigest()[:32]


@functools.cache
def code_version() -> str:
    """Return a hash of `TRAINING_CODE`, so that nobody has to raise a version; comments
    and docstrings count too."""
    total = hashlib.sha256()
    for part in TRAINING_CODE:
        package, _, inner = part.partition("/")
        place = Path(str(files(package))) / inner
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            name = path.relative_to(place.parent).as_posix()
            total.update(f"{part}\0{name}\0".encode() + path.read_bytes())
    return total.hexdigest()[:16]
