"""Splits by what must not leak: kin, surface, scenario or day; never by window, as
windows overlap.

Kin are versions of one object, or objects of one kind: a detector that was trained on
one mesh knows the next one. So folds are made by kin: the column ``kin`` of the data
set, or of a separate file; without either, a surface is kin to its other versions, by
name.
"""

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tactophone.core.errors import DatasetError, did_you_mean
from tactophone.core.recordings.metadata import rows
from tactophone.core.recordings.values import Dataset, Recording

KIN_SPLIT = "leave-one-kin-out"
"""The default: all surfaces of one kin are held out together."""

SPLITS = (
    KIN_SPLIT,
    "leave-one-surface-out",
    "leave-one-KEY-out",
    "K-fold",
    "K-fold-by-KEY",
    "predefined",
)
"""What ``--split`` takes: KEY is any field or property (``scenario``, ``pressure``), K
a number from 2 up.

``K-fold`` assigns surfaces to folds, kin together; ``K-fold-by-KEY`` assigns the values
of that key, for keys with too many values to leave each out. ``leave-one-surface-out``
has kin on both sides, which flatters: 0.93 for 0.71 balanced accuracy on ten real
surfaces. ``predefined`` is the data set's own split: the authors' train and test
objects, or the folders ``train`` and ``test``.
"""

_VERSION = re.compile(r"(?<![\s_-])[\s_-]*+(version[\s_-]*+|v)\d++$", re.IGNORECASE)
_LEAVE_ONE = re.compile(r"leave-one-(?P<key>\w+)-out")
_FOLDS = re.compile(r"(?P<count>\d+)-fold(-by-(?P<key>\w+))?")


@dataclass(frozen=True, slots=True)
class Fold:
    """A training set and the test set that is held out from it."""

    name: str
    train: tuple[Recording, ...]
    test: tuple[Recording, ...]


def split(dataset: Dataset, name: str) -> tuple[Fold, ...]:
    """Split recordings labelled smooth or rough by one of `SPLITS`; the same data give
    the same folds on any machine.

    Raises `DatasetError` if the name is unknown, or the data cannot be split that way.
    """
    labelled = dataset.labelled()
    if name == "predefined":
        return _predefined(labelled)
    if match := _LEAVE_ONE.fullmatch(name):
        return _leave_one_out(labelled, match["key"])
    if match := _FOLDS.fullmatch(name):
        return _k_fold(labelled, int(match["count"]), match["key"] or "kin")
    raise DatasetError(
        f"{name!r} is not a split; take one of "
        f"{', '.join(SPLITS)}{did_you_mean(name, SPLITS)}"
    )


def _predefined(dataset: Dataset) -> tuple[Fold, ...]:
    sides: dict[str, tuple[Recording, ...]] = {}
    for recording in dataset.recordings:
        side = recording.known("split")
        sides[side] = (*sides.get(side, ()), recording)
    train, names = sides.get("train", ()), sorted(sides.keys() - {"train", ""})
    if not train or not names:
        raise DatasetError(
            f"{dataset.root}: has no split of its own; take {KIN_SPLIT}, or fill in "
            "the column split"
        )
    train_surfaces = {recording.surface for recording in train}
    for name in names:
        if leaked := train_surfaces & {recording.surface for recording in sides[name]}:
            raise DatasetError(
                f"{dataset.root}: {', '.join(sorted(leaked))} in both train and "
                f"{name}; divide by surface"
            )
    return tuple(Fold(name, train, sides[name]) for name in names)


def _leave_one_out(dataset: Dataset, key: str) -> tuple[Fold, ...]:
    values = sorted({_value(recording, key) for recording in dataset.recordings})
    if len(values) < 2:
        raise DatasetError(
            f"{dataset.root}: every recording has {key} {values[0]!r}; leaving one "
            "out needs two or more. "
            f"Choose another key, or fill in the column {key}"
        )
    return _make_folds(
        dataset,
        {f"{key} {value}": value for value in values},
        lambda recording: _value(recording, key),
    )


def _k_fold(dataset: Dataset, count: int, key: str) -> tuple[Fold, ...]:
    def rank(recording: Recording) -> tuple[int, str]:
        # Rough values first, so that labels are spread evenly. Within a label, values
        # are ordered by their hashes: the order looks shuffled, needs no seed, and one
        # surface more or less hardly moves the others.
        return -int(recording.label or 0), hashlib.sha256(
            _value(recording, key).encode()
        ).hexdigest()

    values = list(
        dict.fromkeys(
            _value(recording, key) for recording in sorted(dataset.recordings, key=rank)
        )
    )
    if not 2 <= count <= len(values):
        noun = "surfaces, kin counted once" if key == "kin" else f"{key}s"
        raise DatasetError(
            f"{dataset.root}: {count} folds of {len(values)} {noun}; take from 2 to "
            f"{len(values)}"
        )
    fold_of = {value: place % count for place, value in enumerate(values)}
    names = {f"fold {number + 1}": number for number in range(count)}
    return _make_folds(
        dataset, names, lambda recording: fold_of[_value(recording, key)]
    )


def _value(recording: Recording, key: str) -> str:
    return kin_of(recording) if key == "kin" else recording.known(key)


def _make_folds(
    dataset: Dataset,
    folds: Mapping[str, str | int],
    fold_of: Callable[[Recording], str | int],
) -> tuple[Fold, ...]:
    """Make a fold of each name: test the recordings that belong to it, train on all
    others."""
    return tuple(
        Fold(
            name,
            tuple(
                recording
                for recording in dataset.recordings
                if fold_of(recording) != held_out
            ),
            tuple(
                recording
                for recording in dataset.recordings
                if fold_of(recording) == held_out
            ),
        )
        for name, held_out in folds.items()
    )


def kin_of(recording: Recording) -> str:
    """Return the kin of a recording's surface: its property ``kin``, or the surface's
    name without its version.

    >>> kin_of(Recording(Path("a.wav"), "StoneTileVersion2"))
    'StoneTile'
    >>> kin_of(Recording(Path("b.wav"), "stone 3"))
    'stone 3'
    """
    return (
        recording.properties.get("kin")
        or _VERSION.sub("", recording.surface)
        or recording.surface
    )


def with_kin(dataset: Dataset, file: Path) -> Dataset:
    """Return a data set whose recordings have the kin that a CSV file of
    ``surface,kin`` gives.

    Raises `DatasetError` if the file cannot be read, or names none of the surfaces.
    """
    try:
        kin = {
            row["surface"]: row["kin"]
            for _, row in rows(file, required=("surface", "kin"))
        }
    except OSError as error:
        raise DatasetError(
            f"{file}: cannot be read ({error.strerror}); give a CSV file of surface,kin"
        ) from None
    if not kin.keys() & set(dataset.surfaces):
        raise DatasetError(
            f"{file}: names none of the surfaces of {dataset.root}, such as "
            f"{dataset.surfaces[0]}"
        )
    recordings = (
        recording.with_properties(kin=found)
        if (found := kin.get(recording.surface))
        else recording
        for recording in dataset.recordings
    )
    return replace(dataset, recordings=tuple(recordings))
