"""Which layout a folder has, and which data set a file belongs to."""

import functools
import os
from functools import partial
from pathlib import Path
from typing import Protocol

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.layouts import (
    FINALS,
    MANIFEST,
    STEREO,
    read_authors,
    read_manifest,
    surface_and_take,
)
from tactophone.core.recordings.metadata import (
    PARTS,
    manifests_in,
    read_metadata,
)
from tactophone.core.recordings.values import LABEL_NAMES, Dataset, Recording, Segment

_SEARCH_DEPTH = 3
"""Folders above a file that are searched for its manifest: the authors'
``opus/stereo/`` lies two deep."""


def surface_of(name: Path) -> str:
    """Return the folder of a file below ``train``, ``rough`` and the like, or the
    file's name without the take."""
    outer = (*PARTS, *LABEL_NAMES, "audio", "data", "wav")
    folders = [part for part in name.parts[:-1] if part.lower() not in outer]
    return "/".join(folders) or surface_and_take(name.stem)[0]


def find_recording(path: Path | str) -> Recording | None:
    """Return a file's entry in the data set around it; ``None`` if it is in no data
    set."""
    # By the names that lead there first: the file itself may be a blob of a cache, far
    # from its manifest.
    for file in dict.fromkeys((Path(os.path.abspath(path)), Path(path).resolve())):
        for folder in list(file.parents)[:_SEARCH_DEPTH]:
            if layout_of(folder):
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
        read = layout_of(folder)
        # Only the manifest is read here; the sound was named by whoever asks.
        recordings = read(folder, follow_links=True).recordings if read else ()
        by_target = {recording.path.resolve(): recording for recording in recordings}
        return by_target | {
            Path(os.path.abspath(recording.path)): recording for recording in recordings
        }
    except DatasetError:
        return {}  # a metadata.csv of some other program: the file simply has no label


class ReadLayout(Protocol):
    """Reads a folder of one layout."""

    def __call__(self, folder: Path, /, *, follow_links: bool = False) -> Dataset: ...


def layout_of(folder: Path) -> ReadLayout | None:
    """Return what reads a folder of one of the known layouts; ``None`` for any
    other."""
    if manifests_in(folder):
        return partial(read_metadata, surface_of=surface_of)
    if (folder / MANIFEST).is_file():
        return read_manifest
    return (
        read_authors
        if (folder / STEREO).is_dir() or (folder / FINALS).is_dir()
        else None
    )
