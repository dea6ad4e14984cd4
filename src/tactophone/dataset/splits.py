"""Splits by what must not leak: a surface, a scenario, a day; never by window, as windows overlap."""

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from tactophone.dataset.values import Dataset, Recording
from tactophone.errors import DatasetError

NAMES = ("leave-one-surface-out", "leave-one-KEY-out", "K-fold", "K-fold-by-KEY", "given")
"""What ``--split`` takes: KEY is any field or property (``scenario``, ``pressure``), K a number from 2 up.

``K-fold`` deals surfaces to folds; by a key it deals that key's values, where there are too many to leave out singly.

``given`` is the data set's own: the authors' train and test objects, or the folders ``train`` and ``test``.
"""

_LEAVE_ONE = re.compile(r"leave-one-(?P<key>\w+)-out")
_FOLDS = re.compile(r"(?P<count>\d+)-fold(-by-(?P<key>\w+))?")


@dataclass(frozen=True, slots=True)
class Fold:
    """One training set with the test set that it must not have seen."""

    name: str
    train: tuple[Recording, ...]
    test: tuple[Recording, ...]


def split(dataset: Dataset, name: str) -> tuple[Fold, ...]:
    """Split labelled recordings in a named, reproducible way: the same name and data give the same folds anywhere.

    Parameters
    ----------
    dataset
        Recordings without a label smooth or rough are left out.
    name
        One of :data:`NAMES`.

    Raises
    ------
    DatasetError
        If the name is unknown, or the data cannot be split so.
    """
    kept = dataset.labelled()
    if name == "given":
        return _given(kept)
    if match := _LEAVE_ONE.fullmatch(name):
        return _leave_one_out(kept, match["key"])
    if match := _FOLDS.fullmatch(name):
        return _folds(kept, int(match["count"]), match["key"] or "surface")
    raise DatasetError(f"{name!r} is no split; take one of {', '.join(NAMES)}")


def _given(dataset: Dataset) -> tuple[Fold, ...]:
    train = tuple(one for one in dataset.recordings if one.known("split") == "train")
    names = sorted({one.known("split") for one in dataset.recordings} - {"train", ""})
    if not train or not names:
        raise DatasetError(f"{dataset.root}: gives no split of its own; take leave-one-surface-out, or fill in `split`")
    seen = {one.surface for one in train}
    tests = {name: tuple(one for one in dataset.recordings if one.known("split") == name) for name in names}
    for name, test in tests.items():
        if leaked := seen & {one.surface for one in test}:
            raise DatasetError(
                f"{dataset.root}: {', '.join(sorted(leaked))} in both train and {name}; divide by surface"
            )
    return tuple(Fold(name, train, test) for name, test in tests.items())


def _leave_one_out(dataset: Dataset, key: str) -> tuple[Fold, ...]:
    values = sorted({one.known(key) for one in dataset.recordings})
    if len(values) < 2:
        raise DatasetError(
            f"{dataset.root}: every recording has {key} {values[0]!r}; leaving one out needs two or more. "
            f"Choose another key, or fill in the column {key}"
        )
    return _sort(dataset, {f"{key} {value}": value for value in values}, lambda one: one.known(key))


def _folds(dataset: Dataset, count: int, key: str) -> tuple[Fold, ...]:
    values = {one.known(key) for one in dataset.recordings}
    if not 2 <= count <= len(values):
        raise DatasetError(
            f"{dataset.root}: {count} folds of {len(values)} {key}s; take from 2 to as many as there are"
        )
    side = _deal(dataset.recordings, count, key)
    return _sort(dataset, {f"fold {number + 1}": number for number in range(count)}, lambda one: side[one.known(key)])


def _deal(recordings: Iterable[Recording], count: int, key: str) -> dict[str, int]:
    """Deal a key's values to folds, rough ones first, so that labels are spread evenly.

    The order within a label is the hash of the value: it looks shuffled, needs no seed, and a surface more or less
    hardly moves the others.
    """
    values = {
        (-int(one.label or 0), hashlib.sha256(one.known(key).encode()).hexdigest(), one.known(key))
        for one in recordings
    }
    dealt: dict[str, int] = {}
    for place, (_, _, value) in enumerate(sorted(values)):
        dealt.setdefault(value, place % count)
    return dealt


def _sort(dataset: Dataset, folds: Mapping[str, str | int], side: Callable[[Recording], str | int]) -> tuple[Fold, ...]:
    """Make one fold of each name, testing the recordings that are on its side and training on the others."""
    return tuple(
        Fold(
            name,
            tuple(one for one in dataset.recordings if side(one) != out),
            tuple(one for one in dataset.recordings if side(one) == out),
        )
        for name, out in folds.items()
    )
