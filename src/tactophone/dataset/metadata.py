"""The one manifest format: a folder with ``metadata.csv``, as Hugging Face's ``audiofolder`` reads it.

One line a recording. ``file_name`` is the file's path from the folder; the other columns are ours, all optional but
``surface``; a column not named here is kept as a property. ``segments`` holds ``start-end=word`` pairs, in seconds,
divided by spaces, so that one line tells everything of one file.
"""

import csv
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from tactophone.dataset.values import WORDS, Dataset, Problem, Recording, Segment
from tactophone.errors import DatasetError

FILE_NAME = "metadata.csv"
PARTS = ("train", "validation", "test")
"""Sub-folders that may have a ``metadata.csv`` of their own, as ``audiofolder`` has it; kept as property ``split``."""

_OURS = ("file_name", "surface", "label", "channels", "take", "scenario", "session", "tier", "segments")


def holds_metadata(folder: Path) -> bool:
    """Tell whether a folder is a data set of this format."""
    return bool(_manifests(folder))


def read_metadata(folder: Path) -> Dataset:
    """Read a folder's ``metadata.csv``, or those of its ``train``, ``validation`` and ``test`` sub-folders."""
    recordings: list[Recording] = []
    problems: list[Problem] = []
    for manifest in _manifests(folder):
        for line, row in rows(manifest, wanted=("file_name", "surface")):
            parsed = _parse(row, manifest=manifest, line=line, problems=problems)
            if parsed:
                recordings.append(parsed)
    return Dataset(folder.resolve().name, folder, tuple(recordings), tuple(problems))


def write_metadata(folder: Path, recordings: Iterable[Recording]) -> Path:
    """Write ``metadata.csv`` for recordings that lie in the folder; a kill leaves the old file or the new, never half.

    Raises
    ------
    ValueError
        If a recording lies elsewhere.
    """
    lines = [_line(folder, recording) for recording in recordings]
    extra = sorted({name for line in lines for name in line} - set(_OURS))
    target = folder / FILE_NAME
    with tempfile.NamedTemporaryFile(
        "w", dir=folder, prefix=".metadata-", delete=False, newline="", encoding="utf-8"
    ) as file:
        writer = csv.DictWriter(file, [*_OURS, *extra], restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(lines)
        file.flush()
        os.fsync(file.fileno())
    os.chmod(file.name, 0o644)
    os.replace(file.name, target)
    return target


def rows(manifest: Path, *, wanted: Iterable[str]) -> Iterable[tuple[int, Mapping[str, str]]]:
    """Give each line of a CSV file with its number, cells stripped.

    Raises
    ------
    DatasetError
        If a wanted column is not there, or the file is not text.
    """
    try:
        with manifest.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, restval="")
            missing = set(wanted) - set(reader.fieldnames or ())
            if missing:
                raise DatasetError(
                    f"{manifest}: no column {', '.join(sorted(missing))}; its columns are "
                    f"{', '.join(reader.fieldnames or ('none',))}. Add what is missing."
                )
            for row in reader:
                yield reader.line_num, {name: (cell or "").strip() for name, cell in row.items() if name}
    except (UnicodeDecodeError, csv.Error) as error:
        raise DatasetError(f"{manifest}: not a CSV file in UTF-8 ({error}); export it again as such") from error


def word_of(text: str, *, path: Path, problems: list[Problem]) -> str:
    """Give a label's word in lower case, or note what is wrong with it and give the word for unknown."""
    word = text.lower().replace(" ", "_").replace("-", "_")
    if word in WORDS:
        return word
    problems.append(
        Problem(path, "label", f"{text!r} is no label; write one of {', '.join(filter(None, WORDS))}, or nothing")
    )
    return ""


def inside(folder: Path, name: str) -> Path | None:
    """Give the file that a manifest names, or nothing if it would lie outside the manifest's folder."""
    path = folder / name
    inner = path.resolve().is_relative_to(folder.resolve())
    return path if name and inner and not Path(name).is_absolute() else None


def _manifests(folder: Path) -> list[Path]:
    whole = folder / FILE_NAME
    if whole.is_file():
        return [whole]
    return [folder / part / FILE_NAME for part in PARTS if (folder / part / FILE_NAME).is_file()]


def _parse(row: Mapping[str, str], *, manifest: Path, line: int, problems: list[Problem]) -> Recording | None:
    name, folder = row["file_name"], manifest.parent
    path = inside(folder, name)
    if path is None:
        told = f"line {line}: file_name is {name!r}, which names no file inside {folder}; write its path from there"
        problems.append(Problem(manifest, "file_name", told))
        return None
    extra = {key: value for key, value in row.items() if key not in _OURS and value}
    if folder.name in PARTS:
        extra.setdefault("split", folder.name)
    return Recording(
        path,
        row["surface"] or path.stem,
        WORDS[word_of(row.get("label", ""), path=path, problems=problems)],
        tuple(filter(None, row.get("channels", "").split("|"))),
        **{key: row.get(key, "") for key in ("take", "scenario", "session", "tier")},
        segments=_segments(row.get("segments", ""), path=path, problems=problems),
        properties=MappingProxyType(extra),
    )


def _segments(text: str, *, path: Path, problems: list[Problem]) -> tuple[Segment, ...]:
    found = []
    for entry in text.split():
        try:
            span, word = entry.split("=")
            start, end = map(float, span.split("-"))
        except ValueError:
            told = f"{entry!r} is no segment; write start-end=word in seconds, such as 0.30-5.17=rough"
            problems.append(Problem(path, "segments", told, fatal=False))
            continue
        found.append(Segment(start, end, word_of(word, path=path, problems=problems)))
    return tuple(found)


def _line(folder: Path, recording: Recording) -> dict[str, str]:
    return {
        **recording.properties,
        "file_name": recording.path.resolve().relative_to(folder.resolve()).as_posix(),
        "channels": "|".join(recording.channels),
        "segments": " ".join(f"{one.start:.4f}-{one.end:.4f}={one.word or 'ambiguous'}" for one in recording.segments),
        **{key: recording.known(key) for key in ("surface", "label", "take", "scenario", "session", "tier")},
    }
