"""Trains on each fold's one side and judges its other: every recording is judged by a model that never met it."""

import hashlib
import os
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

import numpy as np

from tactophone.dataset import Dataset, Fold, Recording, fingerprint
from tactophone.evaluation.predictions import Judge, TakePredictions
from tactophone.types import Touch


class Method(Protocol):
    """A way to tell rough from smooth that learns from recordings."""

    @property
    def name(self) -> str:
        """For tables."""
        ...

    @property
    def identity(self) -> str:
        """All that decides its answers but the recordings: recipe, seed, version. Results are cached by it."""
        ...

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Learn from labelled recordings; give the judge of others."""
        ...


@dataclass(frozen=True, slots=True)
class Cache:
    """Judgements kept on disk by what they follow from, so that a second run costs seconds.

    A changed method, label or sound has another key; nothing here ever needs to be thrown away by hand.
    """

    folder: Path

    def get(self, key: str, fold: Fold) -> list[TakePredictions] | None:
        """Give a fold's judgements, or ``None`` if they are not there, whole."""
        try:
            with np.load(self.folder / f"{key}.npz", allow_pickle=False) as file:
                return [
                    TakePredictions(one, file[f"time{n}"], file[f"probabilities{n}"], file[f"contact{n}"])
                    for n, one in enumerate(fold.test)
                ]
        except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
            return None

    def holds(self, key: str) -> bool:
        """Tell whether a fold's judgements are there, without reading them."""
        return zipfile.is_zipfile(self.folder / f"{key}.npz")

    def put(self, key: str, judgements: Sequence[TakePredictions]) -> None:
        """Keep a fold's judgements."""
        self.folder.mkdir(parents=True, exist_ok=True)
        partial = self.folder / f"{key}.{os.getpid()}.part"
        arrays = {
            f"{name}{n}": array
            for n, one in enumerate(judgements)
            for name, array in (("time", one.time), ("probabilities", one.probabilities), ("contact", one.contact))
        }
        with partial.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays)
        os.replace(partial, self.folder / f"{key}.npz")


def default_cache() -> Cache:
    """Give the user's cache, ``~/.cache/tactophone/folds`` or below ``$XDG_CACHE_HOME``."""
    home = os.environ.get("XDG_CACHE_HOME")
    return Cache((Path(home) if home else Path.home() / ".cache") / "tactophone" / "folds")


def cross_validate(
    method: Method,
    folds: Sequence[Fold],
    *,
    cache: Cache | None = None,
    report: Callable[[int, str], None] = lambda done, name: None,
) -> list[TakePredictions]:
    """Judge every fold's test recordings by a model trained on its others.

    Parameters
    ----------
    method
        Is fitted anew for each fold.
    folds
        As :func:`tactophone.dataset.split` gives them.
    cache
        Where judgements are kept; a killed run loses one fold.
    report
        Called before each fold with the number of folds done and the fold's name.
    """
    judged: list[TakePredictions] = []
    for done, fold in enumerate(folds):
        report(done, fold.name)
        key = fold_key(method, fold)
        found = cache.get(key, fold) if cache else None
        if found is None:
            found = predict_fold(method, fold)
            if cache:
                cache.put(key, found)
        judged += found
    return judged


def predict_fold(method: Method, fold: Fold) -> list[TakePredictions]:
    """Train on a fold's one side and judge its other."""
    judge = method.fit(fold.train)
    return [judge(recording) for recording in fold.test]


def shuffle_labels(dataset: Dataset, *, seed: int) -> Dataset:
    """Deal the surfaces' labels out anew: what a method scores then, it scores without learning roughness."""
    kept = dataset.labelled()
    labels = {one.surface: one.label for one in kept.recordings}
    dealt = np.random.default_rng(seed).permutation([int(labels[name] or 0) for name in kept.surfaces])
    new = {name: Touch(int(label)) for name, label in zip(kept.surfaces, dealt, strict=True)}
    return replace(kept, recordings=tuple(replace(one, label=new[one.surface]) for one in kept.recordings))


def fold_key(method: Method, fold: Fold) -> str:
    """Name a fold's result by all that it follows from."""
    sides = f"{method.identity}\n{fingerprint(fold.train)}\n"
    # The test side in its own order, as judgements are stored by it.
    tested = "".join(fingerprint([one]) for one in fold.test)
    return hashlib.sha256((sides + tested).encode()).hexdigest()[:32]
