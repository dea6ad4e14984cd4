"""Finds out which layout a folder has, and which data set a file belongs to."""

import functools
from collections.abc import Callable
from pathlib import Path

from tactophone.dataset.layouts import holds_authors, holds_manifest, read_authors, read_manifest
from tactophone.dataset.metadata import FILE_NAME, holds_metadata, read_metadata
from tactophone.dataset.values import Dataset, Recording, Segment
from tactophone.errors import DatasetError

_LAYOUTS: tuple[tuple[Callable[[Path], bool], Callable[[Path], Dataset]], ...] = (
    (holds_metadata, read_metadata),
    (holds_manifest, read_manifest),
    (holds_authors, read_authors),
)

_DEEPEST = 3
"""Folders above a file in which its manifest is looked for: the authors' ``opus/stereo/`` lies two deep."""


def open_dataset(path: Path | str) -> Dataset:
    """Read what a data set says of its recordings, in any of the three layouts; no sound is opened.

    Parameters
    ----------
    path
        The folder, or the ``metadata.csv`` or ``manifest.csv`` in it.

    Raises
    ------
    DatasetError
        If it is none of these. Single bad lines do not raise: they are in ``Dataset.problems``.
    """
    given = Path(path)
    folder = given.parent if given.is_file() and given.suffix == ".csv" else given
    if not folder.is_dir():
        raise DatasetError(f"{given}: no such folder; give the folder that holds {FILE_NAME}")
    for holds, read in _LAYOUTS:
        if holds(folder):
            return read(folder)
    raise DatasetError(_unknown(folder))


def find_recording(path: Path | str) -> Recording | None:
    """Give what a file's own data set says of it, or ``None`` if it lies in none: for truth beside a prediction."""
    file = Path(path).resolve()
    for folder in list(file.parents)[:_DEEPEST]:
        if any(holds(folder) for holds, _ in _LAYOUTS):
            return _by_path(folder).get(file)
    return None


def truth_of(path: Path | str, *, duration: float) -> tuple[Segment, ...]:
    """Give what a person says of each stretch of a file of so many seconds; nothing where nobody says anything."""
    recording = find_recording(path)
    if recording is None:
        return ()
    whole = recording.known("label")
    return recording.segments or ((Segment(0.0, duration, whole),) if whole else ())


@functools.lru_cache(maxsize=4)
def _by_path(folder: Path) -> dict[Path, Recording]:
    try:
        return {recording.path.resolve(): recording for recording in open_dataset(folder).recordings}
    except DatasetError:
        # Someone else's metadata.csv: it tells nothing about this file, and that is all that was asked.
        return {}


def _unknown(folder: Path) -> str:
    inner = sorted(entry.name for entry in folder.iterdir() if entry.is_dir() and _is_dataset(entry))
    if inner:
        return f"{folder}: holds several data sets; name one: {', '.join(inner)}"
    return (
        f"{folder}: no data set: neither {FILE_NAME} nor manifest.csv nor opus/stereo/ is in it; "
        f"write a {FILE_NAME} with the columns file_name, surface and label (docs/datasets.md)"
    )


def _is_dataset(folder: Path) -> bool:
    return any(holds(folder) for holds, _ in _LAYOUTS)
