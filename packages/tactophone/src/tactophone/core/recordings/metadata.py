"""The manifest format: a folder with ``metadata.csv``, as Hugging Face's
``audiofolder`` reads it.

Each line describes a recording. ``file_name`` is the file's path from the folder,
``surface`` is required, and all other columns are optional; a column not named here is
kept as a property. ``segments`` holds ``start-end=label`` entries, in seconds,
separated by spaces.
"""

import codecs
import csv
import io
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.links import (
    find_file,
    link_fault,
    name_below,
    refuse_to_read,
)
from tactophone.core.recordings.values import (
    LABEL_NAMES,
    Dataset,
    Problem,
    Recording,
    Segment,
)
from tactophone.core.small_files import read_small

FILE_NAME = "metadata.csv"
"""Name of the manifest."""

LABELS_FILE = "labels.toml"
"""Name of the file that says what numbered labels mean."""

LARGEST_LABELS = 1 << 14
"""Bytes of that file: reading TOML may take time with the square of its size."""

LARGEST_TEXT = 64 << 20
"""Bytes of a manifest, or of a file of labels; those of a whole day take a few
thousand."""

LARGEST_CARD = 1 << 20
"""Bytes of a data card that are read; its labels stand at its beginning."""

_NUMBERED = re.compile(r"['\"]?(?P<number>\d+)['\"]?: *['\"]?(?P<name>[\w -]+)")
"""A numbered label of a data card, such as ``'0': smooth``."""

PARTS = ("train", "validation", "test")
"""Sub-folders that may have a ``metadata.csv`` of their own, as ``audiofolder`` has it;
kept as property ``split``."""

_COLUMNS = (
    "file_name",
    "surface",
    "label",
    "channels",
    "take",
    "scenario",
    "session",
    "tier",
    "segments",
)


def read_metadata(
    folder: Path,
    *,
    surface_of: Callable[[Path], str] | None = None,
    labels: Mapping[str, str] | None = None,
    follow_links: bool = False,
) -> Dataset:
    """Read a folder's ``metadata.csv``, or the ones in its sub-folders ``train``,
    ``validation`` and ``test``.

    ``surface_of`` names the surface of a file, by its path from the folder, where the
    manifest has no column ``surface``, which is required without it. With
    ``follow_links``, recordings that lie elsewhere and are linked to are read too.
    Raises `DatasetError` if a required column is missing.
    """
    recordings: list[Recording] = []
    problems: list[Problem] = []
    names = labels
    if names is None:
        names = label_names(folder, follow_links=follow_links)
    for manifest in manifests_in(folder):
        refuse_to_read(manifest, folder, follow=follow_links)
        for line, cells in rows(
            manifest,
            required=("file_name",) if surface_of else ("file_name", "surface"),
        ):
            row = dict(cells)
            if surface_of and not row.get("surface"):
                row["surface"] = surface_of(Path(row["file_name"]))
            row["label"] = names.get(row.get("label", ""), row.get("label", ""))
            path = named_file(
                manifest.parent,
                row["file_name"],
                manifest=manifest,
                line=line,
                problems=problems,
                follow_links=follow_links,
            )
            if path:
                recordings.append(
                    _parse(row, path, part=manifest.parent.name, problems=problems)
                )
        problems += _encoding_problem(manifest)
    return Dataset(folder.resolve().name, folder, tuple(recordings), tuple(problems))


def label_names(folder: Path, *, follow_links: bool = False) -> Mapping[str, str]:
    """Return what numbered labels of a folder mean: by its ``labels.toml``, or its
    Hugging Face data card.

    Raises `DatasetError` if ``labels.toml`` is no table of numbers and names, or a
    link to another folder; `read_metadata` says what ``follow_links`` does.
    """
    own = folder / LABELS_FILE
    card = folder / "README.md"
    for path in (own, card):
        refuse_to_read(path, folder, follow=follow_links)
    if own.is_file():
        return _names_in_table(own)
    return _names_on_card(card) if card.is_file() else {}


def _names_in_table(table: Path) -> dict[str, str]:
    """Return the names of numbered labels in a ``labels.toml``."""
    advice = 'write a line such as 0 = "smooth" for each label'
    try:
        names = tomllib.loads(read_small(table, LARGEST_LABELS).decode())
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{table}: {error}; {advice}") from error
    for number, name in names.items():
        if not isinstance(name, str):
            raise DatasetError(
                f"{table}: {number} is a {type(name).__name__}, no name; {advice}"
            )
    return names


def _names_on_card(card: Path) -> dict[str, str]:
    """Return the names of numbered labels, which stand on a data card under
    ``class_label:`` and ``names:``, one a line."""
    with card.open("rb") as file:
        text = file.read(LARGEST_CARD).decode("utf-8", errors="replace")
    lines = iter(filter(None, map(str.strip, text.splitlines())))
    names: dict[str, str] = {}
    for line in lines:
        if not line.endswith("class_label:") or next(lines, "") != "names:":
            continue
        for named in lines:
            match = _NUMBERED.match(named)
            if match is None:
                return names
            names[match["number"]] = match["name"]
    return names


def write_metadata(folder: Path, recordings: Iterable[Recording]) -> Path:
    """Write ``metadata.csv`` for recordings in the folder; a kill leaves the old file
    or the new file, never half.

    Raises `ValueError` if a recording is not in the folder.
    """
    lines = [_line(folder, recording) for recording in recordings]
    extra = sorted({name for line in lines for name in line} - set(_COLUMNS))
    target = folder / FILE_NAME
    with (
        atomic_write(target) as unfinished,
        unfinished.open(
            "w", newline="", encoding="utf-8", errors="surrogateescape"
        ) as file,
    ):
        columns = [*_COLUMNS, *extra]
        for cells in ({name: name for name in columns}, *lines):
            file.write(_row(cells, columns))
    return target


def _row(cells: Mapping[str, str], columns: Sequence[str]) -> str:
    """Return a line of a CSV file.

    The module `csv` quotes the characters of its own line end alone, and reads any of
    the two as one: with its own, no cell ends a line.
    """
    text = io.StringIO()
    csv.DictWriter(text, columns, restval="").writerow(cells)
    return text.getvalue().removesuffix("\r\n") + "\n"


def add_to_metadata(folder: Path, recordings: Sequence[Recording]) -> Path:
    """Write recordings into ``metadata.csv``, in the place of the lines of the same
    files; all other lines stay.

    Raises `DatasetError` as `read_to_rewrite` does.
    """
    own = {recording.path.resolve() for recording in recordings}
    others = (
        other for other in read_to_rewrite(folder) if other.path.resolve() not in own
    )
    return write_metadata(folder, (*others, *recordings))


def refuse_data_set(folder: Path) -> None:
    """Raise `DatasetError` for a folder whose manifest would be replaced by a new
    one."""
    if manifests_in(folder):
        raise DatasetError(f"{folder}: holds a data set already; name a new folder")


def read_to_rewrite(folder: Path) -> tuple[Recording, ...]:
    """Return what the manifests of a folder say, where there are any, so that it can be
    written again.

    Raises `DatasetError` if something in them is not understood: it would be lost.
    """
    dataset = read_metadata(folder)
    refuse_to_lose(dataset)
    return dataset.recordings


def refuse_to_lose(dataset: Dataset) -> None:
    """Raise `DatasetError` if something that a person wrote into a manifest is not in
    the recordings that were read from it, and would be lost if it was written again."""
    lost = [str(each) for each in dataset.problems if each.kind != "encoding"]
    for manifest in manifests_in(dataset.root):
        lost += _cells_without_column(manifest)
    if not lost:
        return
    more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
    raise DatasetError(
        f"{lost[0]}{more}. {FILE_NAME} is to be written again, which would lose this: "
        "correct it first"
    )


def _cells_without_column(manifest: Path) -> Iterator[str]:
    """Yield where words stand in cells whose column has no name, or another's."""
    text, skipped, delimiter = _table_of(_text_of(manifest))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    header = [name.strip() for name in next(reader, [])]
    names = {place: name for place, name in enumerate(header) if name}
    for name in {name for name in header if header.count(name) > 1 and name}:
        yield f"{manifest}: columns: {name!r} is there twice; rename one"
    for row in reader:
        for place, cell in enumerate(row):
            if cell.strip() and place not in names:
                yield (
                    f"{manifest}: columns: line {skipped + reader.line_num}: {cell!r} "
                    "stands in a column without a name; name it"
                )


def rows(
    manifest: Path, *, required: Iterable[str]
) -> Iterable[tuple[int, Mapping[str, str]]]:
    """Yield each line of a CSV file with its number, cells stripped; commas,
    semicolons, tabs or bars part the cells.

    Columns that are known to this package are found in capitals too, and by the other
    names of `COLUMN_NAMES`. Raises `DatasetError` if a required column is missing, or
    the file is not text.
    """
    required = tuple(required)
    try:
        text, skipped, delimiter = _table_of(_text_of(manifest))
        reader = csv.DictReader(
            io.StringIO(text, newline=""), restval="", delimiter=delimiter
        )
        found = tuple(reader.fieldnames or ())
        reader.fieldnames = _known_columns(found, required)
        missing = set(required) - set(reader.fieldnames)
        if missing:
            raise DatasetError(_missing_columns(manifest, missing, found))
        for row in reader:
            if not any(row.values()):
                continue  # left by a spreadsheet below its table
            yield (
                skipped + reader.line_num,
                {name: (cell or "").strip() for name, cell in row.items() if name},
            )
    except (UnicodeError, csv.Error) as error:
        raise DatasetError(
            f"{manifest}: not a CSV file in UTF-8 ({error}); export it again as such"
        ) from error


COLUMN_NAMES: Mapping[str, tuple[str, ...]] = {
    "file_name": ("filename", "file", "path"),
    "file": ("filename", "file_name"),
    "label": ("class", "event_label"),
}
"""Columns, and what other programs call them; used where the column itself is not
there."""


def _known_columns(found: Sequence[str], required: Sequence[str]) -> list[str]:
    """Return a table's columns by the names that this package has for them."""
    names = [name.strip() for name in found]
    for wanted in (*required, *_COLUMNS):
        if wanted in names:
            continue
        for other in (wanted, *COLUMN_NAMES.get(wanted, ())):
            same = [name for name in names if name.lower() == other]
            if len(same) == 1 and same[0] not in required:
                names[names.index(same[0])] = wanted
                break
    return names


def _missing_columns(manifest: Path, missing: set[str], found: Sequence[str]) -> str:
    advice = ""
    if missing == {"surface"}:
        advice = "; `tactophone dataset import` takes surfaces from file names"
    return (
        f"{manifest}: no column {', '.join(sorted(missing))}; its columns are "
        f"{', '.join(found) or 'none'}. Add what is missing{advice}"
    )


def _text_of(manifest: Path) -> str:
    """Read a table as spreadsheets write them: UTF-8, UTF-16, or a code page of an old
    system, whose letters beyond ASCII stay bytes.

    Raises `DatasetError` for a spreadsheet's own format or a file over `LARGEST_TEXT`,
    and `UnicodeDecodeError` for
    half a character.
    """
    with manifest.open("rb") as file:
        content = file.read(LARGEST_TEXT + 1)
    if len(content) > LARGEST_TEXT:
        raise DatasetError(
            f"{manifest}: over {LARGEST_TEXT >> 20} MB, which no table of recordings "
            "has; split the data set"
        )
    if content[:4] in SPREADSHEETS:
        raise DatasetError(
            f"{manifest}: a spreadsheet, not text; save it from there as CSV in UTF-8"
        )
    if content[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        return content.decode("utf-16")
    if content[1:2] == b"\0":
        return content.decode("utf-16-le")
    if content[:1] == b"\0":
        return content.decode("utf-16-be")
    # The names of files are then the bytes that the same old system gave them.
    return content.decode("utf-8-sig", "surrogateescape")


SPREADSHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
"""First bytes of the formats of Excel, LibreOffice and Numbers, and of an old Excel."""


def _table_of(text: str) -> tuple[str, int, str]:
    """Return a table from its header on, the lines left out before it, and what parts
    its cells."""
    delimiter = ""
    skipped = 0
    lines = text.splitlines(keepends=True)
    for line in lines:
        stripped = line.strip()
        # Excel's own first line, by which it knows what parts the cells.
        if stripped.lower().startswith("sep=") and len(stripped) == len("sep=,"):
            delimiter = stripped[-1]
        elif stripped:
            break
        skipped += 1
    rest = "".join(lines[skipped:])
    header = rest.partition("\n")[0]
    # Where the comma is the decimal sign, spreadsheets part cells with semicolons.
    return rest, skipped, delimiter or max(",;\t|", key=header.count)


def _encoding_problem(manifest: Path) -> Iterable[Problem]:
    if any("\udc80" <= char <= "\udcff" for char in _text_of(manifest)):
        message = (
            "not UTF-8, so letters beyond ASCII are shown as bytes; convert it with "
            f"`iconv -f WINDOWS-1252 -t UTF-8 {manifest.name}`, or from the code page "
            "of the system that wrote it, such as CP949"
        )
        yield Problem(manifest, "encoding", message, fatal=False)


def parse_label(text: str, *, path: Path, problems: list[Problem]) -> str:
    """Return a label's name in lower case; for an unknown one, add a problem and return
    the empty name."""
    name = text.lower().replace(" ", "_").replace("-", "_")
    if name in LABEL_NAMES:
        return name
    names = ", ".join(filter(None, LABEL_NAMES))
    problems.append(
        Problem(
            path, "label", f"{text!r} is not a label; write one of {names}, or nothing"
        )
    )
    return ""


def manifests_in(folder: Path) -> list[Path]:
    """Return the ``metadata.csv`` of a whole data set, or the one of each of its
    parts."""
    whole = folder / FILE_NAME
    if whole.is_file():
        return [whole]
    return [
        folder / part / FILE_NAME
        for part in PARTS
        if (folder / part / FILE_NAME).is_file()
    ]


def _parse(
    row: Mapping[str, str], path: Path, *, part: str, problems: list[Problem]
) -> Recording:
    """Return the recording that a line describes; ``part`` is the manifest's folder."""
    extra = {key: value for key, value in row.items() if key not in _COLUMNS and value}
    if part in PARTS:
        extra.setdefault("split", part)
    return Recording(
        path,
        row["surface"] or path.stem,
        LABEL_NAMES[parse_label(row.get("label", ""), path=path, problems=problems)],
        tuple(filter(None, row.get("channels", "").split("|"))),
        **{key: row.get(key, "") for key in ("take", "scenario", "session", "tier")},
        segments=_segments(row.get("segments", ""), path=path, problems=problems),
        properties=extra,
    )


def named_file(
    folder: Path,
    name: str,
    *,
    manifest: Path,
    line: int,
    problems: list[Problem],
    follow_links: bool = False,
) -> Path | None:
    """Return the file that a line of a manifest names; where it may not be read, add a
    problem and return nothing."""
    path = find_file(folder, name)
    if path is None:
        message = (
            f"line {line}: names {name!r}, which is not a file in {folder}; "
            "write its path from there"
        )
        problems.append(Problem(manifest, "file_name", message))
    elif fault := link_fault(path, folder, follow=follow_links):
        problems.append(Problem(manifest, "link", f"line {line}: {name!r} is {fault}"))
        return None
    return path


def _segments(text: str, *, path: Path, problems: list[Problem]) -> tuple[Segment, ...]:
    segments = []
    for entry in text.split():
        try:
            span, label = entry.split("=")
            # Where the comma is the decimal sign, people write it.
            start, end = map(float, span.replace(",", ".").split("-"))
        except ValueError:
            message = (
                f"{entry!r} is not a segment; write start-end=label in seconds, "
                "such as 0.30-5.17=rough"
            )
            problems.append(Problem(path, "segments", message, fatal=False))
            continue
        segments.append(
            Segment(start, end, parse_label(label, path=path, problems=problems))
        )
    return tuple(segments)


def _line(folder: Path, recording: Recording) -> dict[str, str]:
    return {
        **recording.properties,
        "file_name": name_below(recording.path, folder).as_posix(),
        "channels": "|".join(recording.channels),
        "segments": " ".join(
            f"{segment.start:.4f}-{segment.end:.4f}={segment.label_name or 'ambiguous'}"
            for segment in recording.segments
        ),
        **{
            key: recording.known(key)
            for key in ("surface", "label", "take", "scenario", "session", "tier")
        },
    }
