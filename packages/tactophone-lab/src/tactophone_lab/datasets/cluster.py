"""The Cluster Haptic Texture Dataset as published: slides over 118 surfaces (Eguchi et
al., doi:10.6084/m9.figshare.29438288), heard by one air microphone.

``sensor_data/raw_audio/ID_DIRECTION_VELOCITY_FORCE_REPEAT.flac`` (or ``.wav``) is 44.1
kHz, channel 0 the main microphone. Channel 1 hears the machine alone, and no microphone
touches: a recording has the air channel only. ``audio/`` holds channel 0 after noise
cancelling, and is read where ``raw_audio/`` is missing. ``texture_list.xlsx`` has the
number and name of each surface.
"""

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.metadata import refuse_data_set, write_metadata
from tactophone.core.recordings.values import Problem, Recording
from tactophone_lab.datasets.published_labels import (
    LABELS,
    ImportedSet,
    read_labels,
)

TEXTURES = "texture_list.xlsx"
"""Table of the surfaces' numbers and names."""

_NAME = re.compile(
    r"(?P<id>\d+)_(?P<direction>\d+)_(?P<velocity>\d+)_(?P<force>\d+)_(?P<repeat>\d+)"
)
_SHEET = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_LARGEST = 1 << 24
"""Bytes of a table's part; a longer one is no list of 118 names."""


def import_cluster(folder: Path, out: Path) -> ImportedSet:
    """Convert the main microphone of every slide to FLAC with a ``metadata.csv``;
    surfaces are named as in the list.

    Raises `DatasetError` if the folder holds no such recordings, its list cannot be
    read, or ``out`` holds a data set already.
    """
    refuse_data_set(out)
    places = [folder / "sensor_data" / kind for kind in ("raw_audio", "audio")]
    # The first folder with any sound: the raw sound if there is some.
    files = _sounds(places[0]) or _sounds(places[1])
    if not files:
        raise DatasetError(
            f"{folder}: no sound in sensor_data/raw_audio or sensor_data/audio; name "
            "the unpacked folder"
        )
    names = dict(_names(folder / TEXTURES))
    problems: list[Problem] = []
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
        properties = {
            "texture": match["id"],
            "direction_deg": match["direction"],
            "speed_mm_s": match["velocity"],
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
    return ImportedSet(tuple(recordings), tuple(problems))


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
