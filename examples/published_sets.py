"""Published data sets as data sets of ours: downloads the authors' recordings, converts
BioTac and Cluster sets.

    python examples/published_sets.py authors OUT
    python examples/published_sets.py biotac DIR OUT
    python examples/published_sets.py cluster DIR OUT

**authors** shows the licence and unpacks nothing outside OUT; an interrupted download
goes on.

**biotac**: CSV files with pac1 to pac22, 22 values in each line of 10 ms, become one
contact channel at 2.2 kHz; the folder of a file is its surface.

**cluster**: the Cluster Haptic Texture Dataset, slides over 118 surfaces (Eguchi et
al., doi:10.6084/m9.figshare.29438288).
``sensor_data/raw_audio/ID_DIRECTION_VELOCITY_FORCE_REPEAT.flac`` (or ``.wav``) is 44.1
kHz, channel 0 the main microphone. Channel 1 hears the machine alone, and no microphone
touches: a recording has the air channel only. ``audio/`` holds channel 0 after noise
cancelling, and is read where ``raw_audio/`` is missing. ``texture_list.xlsx`` has the
number and name of each surface.

Neither states roughness: a file ``labels.csv`` with the columns ``surface`` and
``label`` in DIR adds labels.
"""

import argparse
import hashlib
import re
import sys
import urllib.error
import urllib.request
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from xml.etree import ElementTree

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone import DatasetError, TactophoneError, Touch
from tactophone.core.processes import atomic_write, make_room
from tactophone.core.recordings.metadata import (
    parse_label,
    refuse_link,
    rows,
    write_metadata,
)
from tactophone.core.recordings.values import LABEL_NAMES, Problem, Recording

ARCHIVE = "https://cloud.vi.cs.uni-bonn.de/index.php/s/KmKSncpDzQ7i3je/download"
"""The authors' recordings, by the README of
https://github.com/AIS-Bonn/Roughness_Sensing."""

LICENCE = (
    "BSD 3-Clause, as the authors' repository states; read what the share itself says"
)
CHUNK = 1 << 20


def fetch(out: Path, *, archive: str = ARCHIVE, sha256: str = "") -> tuple[Path, str]:
    """Download and unpack the authors' recordings; return the folder with the sound,
    and the archive's SHA-256.

    Raises `DatasetError` if the network fails, the checksum differs, or the archive is
    none or reaches outside ``out``.
    """
    out.mkdir(parents=True, exist_ok=True)
    target = out / "authors.zip"
    if not target.exists():
        _download(archive, target.with_suffix(".part"))
        target.with_suffix(".part").rename(target)
    with target.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if sha256 and found != sha256:
        raise DatasetError(
            f"{target}: its SHA-256 is {found}, not {sha256}; delete it and fetch again"
        )
    _unpack(target, out)
    inner = [
        path.parent.parent
        for path in sorted(out.rglob("stereo"))
        if path.parent.name == "opus"
    ]
    return (inner[0] if inner else out), found


def _download(address: str, target: Path) -> None:
    done = target.stat().st_size if target.exists() else 0
    request = urllib.request.Request(
        address, headers={"Range": f"bytes={done}-"} if done else {}
    )
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            resumed = answer.status == 206
            done = done if resumed else 0
            total = done + int(answer.headers.get("Content-Length", 0))
            with target.open("ab" if resumed else "wb") as file:
                while chunk := answer.read(CHUNK):
                    file.write(chunk)
                    done += len(chunk)
    except (OSError, ValueError, urllib.error.URLError) as error:
        raise DatasetError(
            f"{address}: cannot be downloaded ({error}); try again: it goes on where it ended"
        ) from None
    if total and done < total:
        raise DatasetError(
            f"{address}: ended after {done} of {total} bytes; try again: it goes on there"
        )


def _unpack(archive: Path, out: Path) -> None:
    try:
        with zipfile.ZipFile(archive) as files:
            for entry in files.infolist():
                path = PurePosixPath(entry.filename)
                if path.is_absolute() or ".." in path.parts or "\\" in entry.filename:
                    raise DatasetError(
                        f"{archive}: holds {entry.filename!r}, outside its folder; do not use it"
                    )
            files.extractall(out)
    except zipfile.BadZipFile as error:
        raise DatasetError(
            f"{archive}: is no zip archive ({error}); delete it and fetch again"
        ) from None


BIOTAC_RATE = 2200
"""Hz of the BioTac's dynamic pressure, PAC: 22 values in each line of 10 ms (SynTouch's
product manual)."""

BIOTAC_FULL_SCALE = 2048
"""Half of the range of its 12-bit converter."""

PAC = tuple(f"pac{number}" for number in range(1, 23))

LABELS = "labels.csv"

Imported = tuple[list[Recording], list[Problem]]


def import_biotac(folder: Path, out: Path) -> Imported:
    """Convert CSV files with the columns pac1 to pac22 into sound of 2.2 kHz, contact
    alone.

    ``folder`` is searched to any depth; the folder of a file names its surface.
    """
    if not folder.is_dir():
        raise DatasetError(
            f"{folder}: no such folder; name the one that holds the published files"
        )
    problems: list[Problem] = []
    labels = read_labels(folder / LABELS, problems)
    recordings = []
    files = sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() == ".csv" and path.name != LABELS
    )
    for path in files:
        try:
            sound = _read_pac(path)
        except (
            ValueError,
            AssertionError,
            IndexError,
        ) as error:  # of text that is no UTF-8, too
            problems.append(
                Problem(
                    path,
                    "columns",
                    f"no table of numbers ({str(error)[:80]}); left out",
                )
            )
            continue
        if sound is None:
            problems.append(
                Problem(path, "columns", "lacks the columns pac1 to pac22; left out")
            )
            continue
        target = (out / path.relative_to(folder)).with_suffix(".flac")
        refuse_link(target.parent, out)
        target.parent.mkdir(parents=True, exist_ok=True)
        make_room(target)
        soundfile.write(target, sound, BIOTAC_RATE, "PCM_24")
        surface = path.parent.name
        recordings.append(
            Recording(
                target, surface, labels.get(surface), ("contact",), take=path.stem
            )
        )
    if not recordings:
        raise DatasetError(
            f"{folder}: nothing to import: {problems[0] if problems else 'it holds no such files'}"
        )
    write_metadata(out, recordings)
    return recordings, problems


def read_labels(path: Path, problems: list[Problem]) -> dict[str, Touch | None]:
    """Return the label of each surface of a ``labels.csv``, none if there is no such
    file."""
    if not path.is_file():
        return {}
    return {
        row["surface"]: LABEL_NAMES[
            parse_label(row["label"], path=path, problems=problems)
        ]
        for _, row in rows(path, required=("surface", "label"))
    }


def _read_pac(path: Path) -> NDArray[np.float64] | None:
    """Return the dynamic pressure of a file, each line's 22 values in turn, less its
    mean, in [-1, 1]."""
    with path.open(encoding="utf-8-sig") as file:
        names = [
            name.strip().lower()
            for name in file.readline().replace(";", ",").split(",")
        ]
        if not set(PAC) <= set(names):
            return None
        columns = [names.index(name) for name in PAC]
        values = np.loadtxt(
            (line.replace(";", ",") for line in file),
            delimiter=",",
            usecols=columns,
            ndmin=2,
        )
    if not values.size or not np.isfinite(values).all():
        raise ValueError("no values, or some that are no numbers")
    pac = values.reshape(-1) / BIOTAC_FULL_SCALE
    return np.asarray(np.clip(pac - pac.mean(), -1, 1))


TEXTURES = "texture_list.xlsx"
_NAME = re.compile(
    r"(?P<id>\d+)_(?P<direction>\d+)_(?P<velocity>\d+)_(?P<force>\d+)_(?P<repeat>\d+)"
)
_SHEET = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_LARGEST = 1 << 24
"""Bytes of a table's part; a longer one is no list of 118 names."""


def import_cluster(folder: Path, out: Path) -> Imported:
    """Convert the main microphone of every slide to FLAC with a ``metadata.csv``;
    surfaces are named as in the list.

    Raises `DatasetError` if the folder holds no such recordings or its list cannot be
    read.
    """
    places = [folder / "sensor_data" / kind for kind in ("raw_audio", "audio")]
    files = next((found for place in places if (found := _sounds(place))), [])
    if not files:
        raise DatasetError(
            f"{folder}: no sound in sensor_data/raw_audio or sensor_data/audio; name the unpacked folder"
        )
    names, problems = dict(_names(folder / TEXTURES)), list[Problem]()
    labels = read_labels(folder / LABELS, problems)
    recordings = []
    for path in files:
        match = _NAME.fullmatch(path.stem)
        if not match:
            problems.append(
                Problem(
                    path, "name", "is not ID_DIRECTION_VELOCITY_FORCE_REPEAT; left out"
                )
            )
            continue
        surface = names.get(int(match["id"]), f"texture {match['id']}")
        target = out / match["id"] / f"{path.stem}.flac"
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            sound, rate = soundfile.read(path, always_2d=True)
        except soundfile.LibsndfileError as error:
            problems.append(
                Problem(path, "sound", f"cannot be read ({error}); left out")
            )
            continue
        with atomic_write(target) as unfinished:
            soundfile.write(unfinished, sound[:, 0], rate, "PCM_24", format="FLAC")
        moved = {
            "texture": match["id"],
            "direction_deg": match["direction"],
            "speed_mm_s": match["velocity"],
        }
        properties = {
            **moved,
            "force_mn": match["force"],
            "kin": surface,
            "tip": "rubber",
            "source": "cluster",
        }
        label = labels.get(surface, labels.get(match["id"]))
        recordings.append(
            Recording(
                target, surface, label, ("air",), take=path.stem, properties=properties
            )
        )
    if not recordings:
        raise DatasetError(f"{folder}: nothing to import: {problems[0]}")
    write_metadata(out, recordings)
    return recordings, problems


def _sounds(place: Path) -> list[Path]:
    """Return the sound files below a folder, at any depth."""
    return sorted(
        path for path in place.rglob("*") if path.suffix.lower() in (".flac", ".wav")
    )


def _names(path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and English name from the first two columns of the first sheet."""
    try:
        with zipfile.ZipFile(path) as book:
            shared = [
                _text(item)
                for item in _part(book, "xl/sharedStrings.xml").iter(f"{_SHEET}si")
            ]
            rows = list(_part(book, "xl/worksheets/sheet1.xml").iter(f"{_SHEET}row"))
        for row in rows:
            cells = {
                re.sub(r"\d", "", cell.get("r", "")): cell
                for cell in row.iter(f"{_SHEET}c")
            }
            values = [
                shared[int(_text(cell))] if cell.get("t") == "s" else _text(cell)
                for cell in (cells.get("A"), cells.get("B"))
                if cell is not None
            ]
            if len(values) == 2 and re.fullmatch(r"\d+(\.0)?", values[0]):
                yield int(float(values[0])), values[1].strip()
    except (
        OSError,
        KeyError,
        ValueError,
        IndexError,
        zipfile.BadZipFile,
        ElementTree.ParseError,
    ) as error:
        raise DatasetError(
            f"{path}: cannot be read ({error}); download it beside sensor_data/"
        ) from None


def _part(book: zipfile.ZipFile, name: str) -> ElementTree.Element:
    if name not in book.namelist():
        return ElementTree.Element("none")  # a book without texts has no table of them
    if book.getinfo(name).file_size > _LARGEST:
        raise ValueError(f"{name} is too large")
    content = book.read(name)
    if b"<!DOCTYPE" in content:
        raise ValueError(f"{name} declares entities")
    return ElementTree.fromstring(content)


def _text(element: ElementTree.Element) -> str:
    """Return all text within, of a cell or of a shared text in several runs."""
    return "".join(
        part.text or ""
        for part in element.iter()
        if part.tag in (f"{_SHEET}t", f"{_SHEET}v")
    )


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    sets = parser.add_subparsers(dest="set", required=True)
    authors = sets.add_parser("authors")
    authors.add_argument("out", type=Path)
    authors.add_argument(
        "--archive", default=ARCHIVE, help="where the archive is, if it has moved"
    )
    authors.add_argument(
        "--sha256", default="", help="checksum that it must have; none was published"
    )
    for name in ("biotac", "cluster"):
        convert = sets.add_parser(name)
        convert.add_argument("folder", type=Path)
        convert.add_argument("out", type=Path)
    args = parser.parse_args()
    try:
        if args.set == "authors":
            print(f"licence: {LICENCE}", file=sys.stderr)
            folder, found = fetch(args.out, archive=args.archive, sha256=args.sha256)
            print(f"SHA-256 {found}; cite the authors", file=sys.stderr)
            print(folder)
            return 0
        made, problems = (import_biotac if args.set == "biotac" else import_cluster)(
            args.folder, args.out
        )
    except TactophoneError as error:
        print(error, file=sys.stderr)
        return 1
    for problem in problems:
        print(f"left out: {problem}", file=sys.stderr)
    print(f"{len(made)} recordings in {args.out}")
    if not any(recording.label is not None for recording in made):
        print(
            "warning: no labels; add labels.csv with the columns surface and label to the folder",
            file=sys.stderr,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
