"""Labels over time in two dialects of the field: Audacity's label tracks and DCASE's
tables of events.

**Audacity** exports a text file beside a sound: a line ``start<TAB>end<TAB>label`` for
each label, in seconds; a line that begins with a backslash has frequencies and is left
out. **DCASE** has one table for a folder, with the columns ``filename``, ``onset``,
``offset`` and ``event_label``.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.links import link_fault, name_below
from tactophone.core.recordings.metadata import parse_label, rows
from tactophone.core.recordings.sound_file import is_hidden
from tactophone.core.recordings.values import (
    LABEL_NAMES,
    Problem,
    Recording,
    Segment,
)
from tactophone.core.types import SURFACE_LABELS

TRACK_SUFFIX = ".txt"
"""Ending of an Audacity label track, which has the name of its sound file."""

EVENT_TABLE = "metadata.tsv"
"""Name under which a table of events is written; for reading, any ``.tsv`` with its
columns will do."""

EVENT_COLUMNS = ("onset", "offset")
"""Columns, in seconds, by which a table of events is known."""


def read_track(
    sound: Path, folder: Path, problems: list[Problem], *, follow_links: bool = False
) -> tuple[Segment, ...]:
    """Return the segments of the Audacity label track beside a sound file in a data
    set's folder; empty if the file has no track."""
    track = sound.with_suffix(TRACK_SUFFIX)
    if fault := link_fault(track, folder, follow=follow_links):
        problems.append(Problem(track, "link", fault))
        return ()
    try:
        lines = track.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError):
        return ()
    segments = []
    for line in lines:
        cells = line.split("\t")
        if len(cells) != 3 or line.startswith("\\"):
            continue
        try:
            # Where the comma is the decimal sign, older versions wrote it.
            start, end = (float(cell.replace(",", ".")) for cell in cells[:2])
        except ValueError:
            continue
        label = parse_label(cells[2].strip(), path=track, problems=problems)
        segments.append(Segment(start, end, label))
    return tuple(segments)


def find_event_tables(folder: Path) -> list[Path]:
    """Return the tables of events that lie in a folder itself."""
    found = []
    for path in sorted(folder.glob("*.tsv")):
        if is_hidden(path, folder):
            continue
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            names = file.readline().lower().strip().split("\t")
        if set(EVENT_COLUMNS) <= set(names):
            found.append(path)
    return found


def read_events(
    folder: Path,
    sounds: Iterable[Path],
    problems: list[Problem],
    *,
    follow_links: bool = False,
) -> Mapping[Path, tuple[Segment, ...]]:
    """Return the segments of each sound file by the folder's tables of events, which
    name files without the folders that they lie in."""
    by_name: dict[str, list[Path]] = defaultdict(list)
    for path in sounds:
        by_name[path.name].append(path)
    segments: dict[Path, list[Segment]] = defaultdict(list)
    for table in find_event_tables(folder):
        if fault := link_fault(table, folder, follow=follow_links):
            problems.append(Problem(table, "link", fault))
            continue
        for line, row in rows(table, required=("file_name", "label", *EVENT_COLUMNS)):
            name = row["file_name"].replace("\\", "/").rpartition("/")[2]
            found = by_name.get(name, [])
            if len(found) != 1:
                count = "no" if not found else f"{len(found)}"
                message = f"line {line}: {count} files are called {name!r}"
                problems.append(Problem(table, "missing", message))
                continue
            segment = _event(row, table, line, problems)
            segments[found[0]] += [segment] if segment else []
    return {path: tuple(own) for path, own in segments.items()}


def _event(
    row: Mapping[str, str], table: Path, line: int, problems: list[Problem]
) -> Segment | None:
    if not any(row[name] for name in EVENT_COLUMNS):
        return None  # a file without events has a line without times
    try:
        start = float(row["onset"])
        end = float(row["offset"])
    except ValueError:
        message = (
            f"line {line}: onset and offset are {row['onset']!r} and "
            f"{row['offset']!r}; write seconds"
        )
        problems.append(Problem(table, "segments", message, fatal=False))
        return None
    return Segment(start, end, parse_label(row["label"], path=table, problems=problems))


def label_of(segments: Iterable[Segment]) -> str:
    """Return the label of a whole recording by its segments: the one surface that they
    name, or else ``mixed``.

    >>> label_of([Segment(0, 1, "none"), Segment(1, 2, "rough")])
    'rough'
    >>> label_of([Segment(0, 1, "smooth"), Segment(1, 2, "rough")])
    'mixed'
    """
    found = {
        segment.label_name for segment in segments if segment.label in SURFACE_LABELS
    }
    return found.pop() if len(found) == 1 else "mixed"


def segments_of(recording: Recording, *, duration: float) -> tuple[Segment, ...]:
    """Return a recording's segments; one for the whole where only that is labelled."""
    label = recording.known("label")
    whole = (Segment(0.0, duration, label),) if label in LABEL_NAMES and label else ()
    return recording.segments or whole


def write_tracks(
    folder: Path, segments: Mapping[Path, tuple[Segment, ...]], *, root: Path
) -> list[Path]:
    """Write an Audacity label track for each recording, below ``folder`` as the
    recording lies below ``root``."""
    written = []
    for path, own in segments.items():
        target = folder / name_below(path, root).with_suffix(TRACK_SUFFIX)
        lines = [
            f"{each.start:.6f}\t{each.end:.6f}\t{each.label_name or 'ambiguous'}"
            for each in own
        ]
        _write_lines(target, lines)
        written.append(target)
    return written


def write_events(
    folder: Path, segments: Mapping[Path, tuple[Segment, ...]], *, root: Path
) -> Path:
    """Write one DCASE table of the events of all recordings.

    Raises `DatasetError` if two recordings have one name, which the table could not
    tell apart.
    """
    names = [path.name for path in segments]
    if twice := {name for name in names if names.count(name) > 1}:
        raise DatasetError(
            f"{root}: several recordings are called {min(twice)}, and a DCASE table "
            "tells files apart by name alone; rename them, or write Audacity's tracks"
        )
    lines = ["filename\tonset\toffset\tevent_label"]
    for path, own in segments.items():
        for each in own:
            label = each.label_name or "ambiguous"
            lines.append(f"{path.name}\t{each.start:.3f}\t{each.end:.3f}\t{label}")
    target = folder / EVENT_TABLE
    _write_lines(target, lines)
    return target


def _write_lines(target: Path, lines: Iterable[str]) -> None:
    with atomic_write(target) as unfinished:
        unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")
