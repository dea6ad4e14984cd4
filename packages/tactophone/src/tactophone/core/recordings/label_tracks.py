"""Labels over time in the dialects of the field: Audacity's label tracks, DCASE's
tables of events, Praat's TextGrids and Raven's selection tables. The first two are
written too.

**Audacity** exports a text file beside a sound: a line ``start<TAB>end<TAB>label`` for
each label, in seconds; a line that begins with a backslash has frequencies and is left
out. **DCASE** has one table for a folder, with the columns ``filename``, ``onset``,
``offset`` and ``event_label``.
"""

import codecs
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write, is_other_file
from tactophone.core.recordings.links import link_fault, name_below
from tactophone.core.recordings.metadata import LARGEST_TEXT, parse_label, rows
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

GRID_SUFFIX = ".TextGrid"
"""Ending of a TextGrid, which has the name of its sound file."""

EVENT_TABLE = "metadata.tsv"
"""Name under which a table of events is written; for reading, any ``.tsv`` with its
columns will do."""

EVENT_COLUMNS = ("onset", "offset")
"""Columns, in seconds, by which a table of events is known."""


def read_track(
    sound: Path, folder: Path, problems: list[Problem], *, follow_links: bool = False
) -> tuple[Segment, ...]:
    """Return the segments of the Audacity label track, or of the TextGrid, beside a
    sound file in a data set's folder; empty if the file has neither."""
    track = sound.with_suffix(TRACK_SUFFIX)
    if fault := link_fault(track, folder, follow=follow_links):
        problems.append(Problem(track, "link", fault))
        return ()
    if track.is_file() and not _is_raven(track):
        return _audacity_segments(track, problems)
    grid = sound.with_suffix(GRID_SUFFIX)
    if fault := link_fault(grid, folder, follow=follow_links):
        problems.append(Problem(grid, "link", fault))
        return ()
    return _grid_segments(grid, problems) if grid.is_file() else ()


LONGEST_HEADER = 1 << 12
"""Bytes in which the first line of a table is looked for."""


def _text_of(path: Path) -> str:
    """Read a text file of another program, in UTF-8 or UTF-16; empty if it is none."""
    content = _beginning(path, LARGEST_TEXT + 1)
    if len(content) > LARGEST_TEXT:
        return ""
    try:
        return content.decode(_encoding_of(content))
    except UnicodeDecodeError:
        return ""


def _header_of(path: Path) -> str:
    """Read the first line of a table."""
    content = _beginning(path, LONGEST_HEADER)
    text = content.decode(_encoding_of(content), errors="replace")
    return text.partition("\n")[0]


def _encoding_of(content: bytes) -> str:
    utf_16 = content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    return "utf-16" if utf_16 else "utf-8-sig"


def _beginning(path: Path, size: int) -> bytes:
    """Read up to ``size`` bytes of a file; nothing of a pipe, which might never end,
    nor of a device."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(size)
    except OSError:
        return b""


def _audacity_segments(track: Path, problems: list[Problem]) -> tuple[Segment, ...]:
    segments = []
    for line in _text_of(track).splitlines():
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


_GRID_TOKEN = re.compile(r'"[^"]*(?:""[^"]*)*"|(?<![\w\[.])-?\d+(?:\.\d+)?(?![\w\].])')
"""A text or a number of a TextGrid. The numbers in brackets of the long format count
what follows, and the short format leaves them out."""


def _grid_segments(grid: Path, problems: list[Problem]) -> tuple[Segment, ...]:
    """Return the intervals of the tier that has most labels of touch; intervals without
    a text have no label."""
    tiers = list(_grid_tiers(_GRID_TOKEN.findall(_text_of(grid))))
    if not tiers:
        return ()

    def known(tier: list[tuple[float, float, str]]) -> int:
        return sum(text.lower() in LABEL_NAMES for _, _, text in tier)

    return tuple(
        Segment(start, end, parse_label(text, path=grid, problems=problems))
        for start, end, text in max(tiers, key=known)
    )


def _grid_tiers(tokens: list[str]) -> Iterator[list[tuple[float, float, str]]]:
    """Yield start, end and text of the intervals of each tier.

    A tier has its kind, name, start, end and number of intervals before them (Praat's
    manual, "TextGrid file formats").
    """
    places = [place for place, token in enumerate(tokens) if token == '"IntervalTier"']
    for place, following in pairwise([*places, len(tokens)]):
        tier = []
        for at in range(place + 5, following - 2, 3):
            start, end, text = tokens[at : at + 3]
            if start.startswith('"') or end.startswith('"') or text[:1] != '"':
                break  # a tier of another kind
            if label := text[1:-1].strip():
                tier.append((float(start), float(end), label))
        yield tier


RAVEN_TIMES = ("Begin Time (s)", "End Time (s)")
"""Columns by which a selection table of Raven is known."""

RAVEN_LABELS = ("Annotation", "Label", "Class", "Species", "Event")
"""Columns that may hold its labels; the first that is there counts."""


def _is_raven(path: Path) -> bool:
    header = _header_of(path)
    return all(name in header for name in RAVEN_TIMES)


def read_selections(
    folder: Path,
    sounds: Iterable[Path],
    problems: list[Problem],
    *,
    follow_links: bool = False,
) -> Mapping[Path, tuple[Segment, ...]]:
    """Return the segments of each sound file by Raven's selection tables.

    A table belongs to the sound whose name it begins with. A table of many sounds names
    each in ``Begin File``, and ``File Offset (s)`` is then the time within it, while
    ``Begin Time (s)`` counts on over all of them.
    """
    known = list(sounds)
    segments: dict[Path, dict[Segment, None]] = defaultdict(dict)
    for table in sorted(folder.rglob("*.txt")):
        if is_hidden(table, folder) or not _is_raven(table):
            continue
        if fault := link_fault(table, folder, follow=follow_links):
            problems.append(Problem(table, "link", fault))
            continue
        for line, row in rows(table, required=RAVEN_TIMES):
            sound = _selected_sound(table, row, known)
            label = next((row[name] for name in RAVEN_LABELS if row.get(name)), "")
            try:
                begin, end = (float(row[name]) for name in RAVEN_TIMES)
                offset = row.get("File Offset (s)", "")
                start = float(offset) if offset else begin
            except ValueError:
                sound = None
            if sound is None or not label:
                message = f"line {line}: names no sound here, no time or no label"
                problems.append(Problem(table, "segments", message, fatal=False))
                continue
            name = parse_label(label, path=table, problems=problems)
            # A selection has a line for each view; the set keeps one of them.
            segments[sound][Segment(start, start + end - begin, name)] = None
    return {path: tuple(own) for path, own in segments.items()}


def _selected_sound(
    table: Path, row: Mapping[str, str], sounds: Iterable[Path]
) -> Path | None:
    if name := row.get("Begin File", ""):
        found = [path for path in sounds if path.name.lower() == name.lower()]
    else:
        found = [
            path
            for path in sounds
            if path.parent == table.parent and table.name.startswith(f"{path.stem}.")
        ]
    return found[0] if len(found) == 1 else None


def find_event_tables(folder: Path) -> list[Path]:
    """Return the tables of events that lie in a folder itself."""
    found = []
    for path in sorted(folder.glob("*.tsv")):
        if is_hidden(path, folder):
            continue
        names = _header_of(path).lower().strip().split("\t")
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
    recording lies below ``root``.

    Raises `DatasetError` if another text is at one of the names; nothing is written
    then.
    """
    texts = {}
    for path, own in segments.items():
        target = folder / name_below(path, root).with_suffix(TRACK_SUFFIX)
        texts[target] = _text_from(
            f"{each.start:.6f}\t{each.end:.6f}\t{each.label_name or 'ambiguous'}"
            for each in own
        )
    _write_texts(texts)
    return list(texts)


def write_events(
    folder: Path, segments: Mapping[Path, tuple[Segment, ...]], *, root: Path
) -> Path:
    """Write one DCASE table of the events of all recordings.

    Raises `DatasetError` if two recordings have one name, which the table could not
    tell apart, or if another table has its name.
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
    _write_texts({target: _text_from(lines)})
    return target


def _text_from(lines: Iterable[str]) -> str:
    return "\n".join(lines) + "\n"


def _write_texts(texts: Mapping[Path, str]) -> None:
    """Write files, where none of them replaces the labels of a person."""
    for path, text in texts.items():
        if is_other_file(path, text.encode()):
            raise DatasetError(
                f"{path}: is there already, and may hold labels of yours; name a new "
                "folder"
            )
    for path, text in texts.items():
        with atomic_write(path) as unfinished:
            unfinished.write_bytes(text.encode())
