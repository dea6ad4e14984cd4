"""Opens a folder of recordings in whichever layout it has, as a data set."""

import shlex
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.links import name_below
from tactophone.core.recordings.metadata import FILE_NAME, manifests_in, read_metadata
from tactophone.core.recordings.read import layout_of, surface_of
from tactophone.core.recordings.sound_file import (
    FFMPEG_SUFFIXES,
    ICLOUD_SUFFIX,
    is_hidden,
)
from tactophone.core.recordings.values import Dataset
from tactophone_lab.datasets.lab_folders import LabFolder, read_lab_folder


def open_dataset(
    path: Path | str,
    *,
    labels: Mapping[str, str] | None = None,
    follow_links: bool = False,
) -> Dataset:
    """Read a data set in any layout, by its folder or the CSV file in it.

    A folder with ``rough/`` and ``smooth/`` in it needs no manifest. ``labels`` names
    what numbers in the column ``label``, or a folder's own names, mean; by default
    ``labels.toml`` or the class names in a Hugging Face data card do. With
    ``follow_links``, sound outside of the folder is read too, where a link in the
    folder leads to it.

    Raises `DatasetError` if the folder has none of the layouts. Bad lines do not raise:
    they are in ``Dataset.problems``.
    """
    path = Path(path)
    folder = path.parent if path.is_file() and path.suffix == ".csv" else path
    if not folder.is_dir():
        raise DatasetError(
            f"{path}: no such folder; name one with rough/ and smooth/, or with "
            f"{FILE_NAME}"
        )
    if manifests_in(folder):
        return read_metadata(
            folder, surface_of=surface_of, labels=labels, follow_links=follow_links
        )
    if read := layout_of(folder):
        return read(folder, follow_links=follow_links)
    if inner := _inner(folder):
        raise DatasetError(
            f"{folder}: holds several data sets; name one: {', '.join(inner)}"
        )
    found = read_lab_folder(folder, follow_links=follow_links, words=labels)
    if found.air_of:
        raise DatasetError(
            f"{folder}: each microphone is in a file of its own; "
            f"join them first: `tactophone dataset import {folder} NEW`"
        )
    if found.dataset.recordings:
        return found.dataset
    if unreadable := phone_sounds(folder):
        raise DatasetError(f"{folder}: {unreadable}")
    if unread := _unread_labels(folder):
        raise DatasetError(f"{folder}: {unread}")
    raise DatasetError(
        f"{folder}: not a data set: neither {FILE_NAME} nor manifest.csv nor "
        f"opus/stereo/ is in it{_passed_over(folder)}; "
        f"write a {FILE_NAME} with the columns file_name, surface and label "
        "(docs/reference/data-set.md), or let "
        "`tactophone dataset import` make it of folders named rough/ and smooth/; "
        "where folders have names of yours, say what they mean: "
        "--labels rau=rough,glatt=smooth"
    )


def refuse_to_hide(folder: Path) -> None:
    """Raise `DatasetError` for a folder whose recordings are found without a
    ``metadata.csv``, as a new one would hide them from all that reads the folder."""
    if manifests_in(folder):
        return
    read = layout_of(folder)
    dataset = read(folder) if read else read_lab_folder(folder).dataset
    if dataset.recordings:
        first = dataset.recordings[0].path
        raise DatasetError(
            f"{folder}: holds recordings without a {FILE_NAME}, such as "
            f"{name_below(first, folder)}, and a new {FILE_NAME} would hide them: "
            "choose another --out, or make one of them first with `tactophone "
            "dataset import`"
        )


TABLE_SUFFIXES = (".csv", ".tsv", ".json", ".jsonl", ".xlsx", ".parquet")
"""Endings of files that a person keeps labels in."""


def _passed_over(folder: Path) -> str:
    """Name the tables of a folder that nothing here reads, as they may hold labels."""
    names = sorted(
        path.name
        for path in folder.iterdir()
        if path.suffix.lower() in TABLE_SUFFIXES and not is_hidden(path, folder)
    )
    return f", and {', '.join(names)} was passed over" if names else ""


def find_importable(path: Path | str) -> LabFolder:
    """Return what `dataset import` converts: a known layout, or a folder with labels in
    its names.

    Surfaces that nothing states are taken from file names; ``guessed`` is then true.
    Raises `DatasetError` if neither a manifest nor any name holds a label.
    """
    folder = Path(path).parent if Path(path).suffix == ".csv" else Path(path)
    if manifests_in(folder):
        guessed: list[Path] = []

        def guess(name: Path) -> str:
            guessed.append(name)
            return surface_of(name)

        return LabFolder(read_metadata(folder, surface_of=guess), guessed=bool(guessed))
    if folder.is_dir() and not layout_of(folder) and not _inner(folder):
        found = read_lab_folder(folder)
        if found.dataset.recordings:
            return found
        if problems := found.dataset.problems:
            raise DatasetError(
                f"{folder}: none of its {len(problems)} sound files can be used; "
                f"{problems[0]}"
            )
    return LabFolder(open_dataset(path))


def phone_sounds(folder: Path) -> str:
    """Say how many files of a folder only ffmpeg reads, and how to convert them, or
    that files were not downloaded; empty if there are none."""
    found = Counter(
        path.suffix.lower()
        for path in folder.rglob("*")
        if path.suffix.lower() in FFMPEG_SUFFIXES and not is_hidden(path, folder)
    )
    absent = sum(1 for _ in folder.rglob(f".*{ICLOUD_SUFFIX}"))
    if absent:
        files = "file is" if absent == 1 else "files are"
        return f"{absent} {files} in iCloud alone: download the folder in the Finder"
    if not found:
        return ""
    kinds = " and ".join(f"{count} {suffix}" for suffix, count in sorted(found.items()))
    files = "file" if found.total() == 1 else "files"
    suffix = found.most_common(1)[0][0]
    return (
        f"{kinds} {files}, which need ffmpeg: convert each beside itself with "
        f"`find {shlex.quote(str(folder))} -name '*{suffix}' -exec ffmpeg -i {{}} "
        f"{{}}.wav ';'`"
    )


UNREAD_LABELS: Mapping[str, str] = {
    ".aup": "Audacity's project: File > Export > Export Labels",
    ".aup3": "Audacity's project: File > Export > Export Labels",
    ".eaf": "ELAN's annotations: File > Export As > Praat TextGrid",
    ".srt": "subtitles: import them into Audacity, and export its labels",
    ".vtt": "subtitles: import them into Audacity, and export its labels",
}
"""Endings of files with labels over time that are not read, and the way to ones that
are."""


def _unread_labels(folder: Path) -> str:
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() in UNREAD_LABELS and not is_hidden(path, folder):
            return f"{path.name} is {UNREAD_LABELS[path.suffix.lower()]}"
    return ""


def _inner(folder: Path) -> list[str]:
    inside = [entry for entry in folder.iterdir() if entry.is_dir()]
    shown = [entry for entry in inside if not is_hidden(entry, folder)]
    return sorted(entry.name for entry in shown if layout_of(entry))
