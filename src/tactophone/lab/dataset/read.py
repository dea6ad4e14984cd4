"""Which layout a folder has, and which data set a file belongs to."""

import functools
from collections.abc import Callable, Mapping
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.lab.dataset.layouts import (
    FINALS,
    MANIFEST,
    STEREO,
    LabFolder,
    read_authors,
    read_lab_folder,
    read_manifest,
    surface_and_take,
)
from tactophone.lab.dataset.metadata import (
    FILE_NAME,
    PARTS,
    manifests_in,
    read_metadata,
)
from tactophone.lab.dataset.values import LABEL_NAMES, Dataset, Recording, Segment

_SEARCH_DEPTH = 3
"""Folders above a file that are searched for its manifest: the authors'
``opus/stereo/`` lies two deep."""


def open_dataset(
    path: Path | str, *, labels: Mapping[str, str] | None = None
) -> Dataset:
    """Read a data set in any layout, by its folder or the CSV file in it.

    A folder with ``rough/`` and ``smooth/`` in it needs no manifest. ``labels`` names
    what numbers in the column ``label`` mean; by default ``labels.toml`` or the class
    names in a Hugging Face data card do.

    Raises `DatasetError` if the folder has none of the layouts. Bad lines do not raise:
    they are in ``Dataset.problems``.
    """
    path = Path(path)
    folder = path.parent if path.is_file() and path.suffix == ".csv" else path
    if not folder.is_dir():
        raise DatasetError(
            f"{path}: no such folder; name one with rough/ and smooth/, or with {FILE_NAME}"
        )
    if manifests_in(folder):
        return read_metadata(folder, surface_of=_surface_of, labels=labels)
    if read := _reader(folder):
        return read(folder)
    if inner := _inner(folder):
        raise DatasetError(
            f"{folder}: holds several data sets; name one: {', '.join(inner)}"
        )
    found = read_lab_folder(folder)
    if found.air_of:
        raise DatasetError(
            f"{folder}: each microphone is in a file of its own; "
            f"join them first: `tactophone dataset import {folder} NEW`"
        )
    if found.dataset.recordings:
        return found.dataset
    raise DatasetError(
        f"{folder}: not a data set: neither {FILE_NAME} nor manifest.csv nor opus/stereo/ is in it; "
        f"write a {FILE_NAME} with the columns file_name, surface and label (docs/reference/data-set.md), or let "
        "`tactophone dataset import` make it of folders named rough/ and smooth/"
    )


def find_importable(path: Path | str) -> LabFolder:
    """Return what `dataset import` converts: a known layout, or a folder with labels in
    its names.

    Surfaces that nothing states are taken from file names; ``guessed`` is then true.
    Raises `DatasetError` if neither a manifest nor any name holds a label.
    """
    folder = Path(path).parent if Path(path).suffix == ".csv" else Path(path)
    if manifests_in(folder):
        guessed: list[Path] = []

        def surface_of(name: Path) -> str:
            guessed.append(name)
            return _surface_of(name)

        return LabFolder(
            read_metadata(folder, surface_of=surface_of), guessed=bool(guessed)
        )
    if folder.is_dir() and not _reader(folder) and not _inner(folder):
        found = read_lab_folder(folder)
        if found.dataset.recordings:
            return found
        if problems := found.dataset.problems:
            raise DatasetError(
                f"{folder}: none of its {len(problems)} sound files can be used; {problems[0]}"
            )
    return LabFolder(open_dataset(path))


def _surface_of(name: Path) -> str:
    """Return the folder of a file below ``train``, ``rough`` and the like, or the
    file's name without the take."""
    outer = (*PARTS, *LABEL_NAMES, "audio", "data", "wav")
    folders = [part for part in name.parts[:-1] if part.lower() not in outer]
    return "/".join(folders) or surface_and_take(name.stem)[0]


def find_recording(path: Path | str) -> Recording | None:
    """Return a file's entry in the data set around it; ``None`` if it is in no data
    set."""
    file = Path(path).resolve()
    for folder in list(file.parents)[:_SEARCH_DEPTH]:
        if _reader(folder):
            return _by_path(folder).get(file)
    return None


def ground_truth(path: Path | str, *, duration: float) -> tuple[Segment, ...]:
    """Return the labelled segments of a file of ``duration`` s; empty if it has no
    label."""
    recording = find_recording(path)
    if recording is None:
        return ()
    label = recording.known("label")
    return recording.segments or ((Segment(0.0, duration, label),) if label else ())


@functools.lru_cache(maxsize=4)
def _by_path(folder: Path) -> dict[Path, Recording]:
    try:
        return {
            recording.path.resolve(): recording
            for recording in open_dataset(folder).recordings
        }
    except DatasetError:
        return {}  # a metadata.csv of some other program: the file simply has no label


def _inner(folder: Path) -> list[str]:
    return sorted(
        entry.name for entry in folder.iterdir() if entry.is_dir() and _reader(entry)
    )


def _reader(folder: Path) -> Callable[[Path], Dataset] | None:
    """Return what reads a folder of one of the known layouts; ``None`` for any
    other."""
    if manifests_in(folder):
        return read_metadata
    if (folder / MANIFEST).is_file():
        return read_manifest
    return (
        read_authors
        if (folder / STEREO).is_dir() or (folder / FINALS).is_dir()
        else None
    )
