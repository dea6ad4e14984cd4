"""Readers of sets that others publish: BioTac vibration as CSV, the Cluster Haptic Texture Database, and SENS3.

None has labels rough and smooth as people give them. A file ``labels.csv`` with the columns ``surface`` and
``label`` in the folder adds them; without it recordings are imported without a label.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset.converters import copy_as_flac
from tactophone.dataset.metadata import parse_label, rows, write_metadata
from tactophone.dataset.values import LABEL_NAMES, Dataset, Problem, Recording
from tactophone.errors import DatasetError
from tactophone.types import Touch

BIOTAC_RATE = 2200
"""Hz of the BioTac's dynamic pressure, PAC: 22 values in each line of 10 ms (SynTouch's product manual)."""

BIOTAC_FULL_SCALE = 2048
"""Half of the range of its 12-bit converter."""

PAC = tuple(f"pac{number}" for number in range(1, 23))

CLUSTER_NAME = re.compile(r"(?P<surface>[^_]+)_(?P<direction>[^_]+)_(?P<speed>[^_]+)_(?P<force>[^_]+)_(?P<take>[^_.]+)")
"""Surface, direction, speed, force and repetition, as the database's own description has it."""

RAW_AUDIO = "raw_audio"
"""Folder of the Cluster database with the sound before its noise was cancelled."""

SLIDING = re.compile("slid|strok", re.IGNORECASE)
"""In the name of what SENS3 recorded while a finger slid; it has taps, presses and static contact besides."""

LABELS = "labels.csv"

Imported = tuple[Dataset, tuple[Problem, ...]]


def import_biotac(folder: Path, out: Path, *, progress: Callable[[int], None] = lambda done: None) -> Imported:
    """Convert CSV files with the columns pac1 to pac22 into sound of 2.2 kHz, contact alone.

    ``folder`` is searched to any depth; the folder of a file names its surface.
    """
    problems: list[Problem] = []
    labels = _labels(folder, problems)
    recordings = []
    for done, path in enumerate(_files(folder, {".csv"}), 1):
        progress(done)
        pac = _read_pac(path)
        if pac is None:
            problems.append(Problem(path, "columns", "lacks the columns pac1 to pac22; left out"))
            continue
        target = (out / path.relative_to(folder)).with_suffix(".flac")
        target.parent.mkdir(parents=True, exist_ok=True)
        soundfile.write(target, pac, BIOTAC_RATE, "PCM_24")
        surface = path.parent.name
        recordings.append(Recording(target, surface, labels.get(surface), ("contact",), take=path.stem))
    return _finished(folder, out, recordings, problems)


def import_cluster(folder: Path, out: Path, *, progress: Callable[[int], None] = lambda done: None) -> Imported:
    """Convert files named ``surface_direction_speed_force_repetition.wav`` or ``.flac``; see :func:`import_biotac`.

    Of a sound that is there before and after its noise was cancelled, the latter is taken.
    """
    problems: list[Problem] = []
    labels = _labels(folder, problems)
    recordings = []
    files = list(_files(folder, {".wav", ".flac"}))
    cleaned = {path.stem for path in files if RAW_AUDIO not in path.parts}
    for done, path in enumerate(files, 1):
        progress(done)
        if RAW_AUDIO in path.parts and path.stem in cleaned:
            continue
        match = CLUSTER_NAME.fullmatch(path.stem)
        if not match:
            problems.append(Problem(path, "name", "is not surface_direction_speed_force_repetition; left out"))
            continue
        target = (out / path.relative_to(folder)).with_suffix(".flac")
        target.parent.mkdir(parents=True, exist_ok=True)
        copy_as_flac(path, target)
        # Its second microphone records the noise of the machine; neither lies on the finger.
        channels = ("air",) * int(soundfile.info(target).channels)
        properties = {key: match[key] for key in ("direction", "speed", "force")}
        recordings.append(
            Recording(
                target, match["surface"], labels.get(match["surface"]), channels, take=path.stem,
                properties=MappingProxyType(properties),
            )
        )  # fmt: skip
    return _finished(folder, out, recordings, problems)


def import_sens3(folder: Path, out: Path, *, progress: Callable[[int], None] = lambda done: None) -> Imported:
    """Convert the sound of sliding fingers: a folder a surface, with "sliding" in the path; see :func:`import_biotac`.

    The microphone was in the air beside the surface (Balasubramanian et al., SENS3, EuroHaptics 2024). The paper names
    no files, so a path is read for what it must say: the surface and the kind of touch.
    """
    problems: list[Problem] = []
    labels = _labels(folder, problems)
    recordings = []
    for done, path in enumerate(_files(folder, {".wav", ".flac"}), 1):
        progress(done)
        place = path.relative_to(folder)
        if len(place.parts) < 2 or not SLIDING.search(str(place)):
            reason = "is not surface/...sliding...: taps and presses have no texture; left out"
            problems.append(Problem(path, "name", reason))
            continue
        target = (out / place).with_suffix(".flac")
        target.parent.mkdir(parents=True, exist_ok=True)
        copy_as_flac(path, target)
        channels = ("air",) * int(soundfile.info(target).channels)
        recordings.append(Recording(target, place.parts[0], labels.get(place.parts[0]), channels, take=path.stem))
    return _finished(folder, out, recordings, problems)


FORMATS: Mapping[str, Callable[..., Imported]] = MappingProxyType(
    {"biotac": import_biotac, "cluster": import_cluster, "sens3": import_sens3}
)
"""Importers by the name that `dataset import --format` takes."""


def _files(folder: Path, suffixes: set[str]) -> Iterator[Path]:
    if not folder.is_dir():
        raise DatasetError(f"{folder}: no such folder; name the one that holds the published files")
    yield from sorted(path for path in folder.rglob("*") if path.suffix.lower() in suffixes and path.name != LABELS)


def _labels(folder: Path, problems: list[Problem]) -> dict[str, Touch | None]:
    path = folder / LABELS
    if not path.is_file():
        return {}
    lines = rows(path, required=("surface", "label"))
    return {row["surface"]: LABEL_NAMES[parse_label(row["label"], path=path, problems=problems)] for _, row in lines}


def _read_pac(path: Path) -> NDArray[np.float64] | None:
    """Return the dynamic pressure of a file, each line's 22 values in turn, less its mean, in [-1, 1]."""
    with path.open(encoding="utf-8-sig") as file:
        names = [name.strip().lower() for name in file.readline().replace(";", ",").split(",")]
        if not set(PAC) <= set(names):
            return None
        columns = [names.index(name) for name in PAC]
        values = np.loadtxt((line.replace(";", ",") for line in file), delimiter=",", usecols=columns, ndmin=2)
    pac = values.reshape(-1) / BIOTAC_FULL_SCALE
    return np.asarray(np.clip(pac - pac.mean(), -1, 1))


def _finished(folder: Path, out: Path, recordings: list[Recording], problems: list[Problem]) -> Imported:
    if not recordings:
        reason = problems[0] if problems else "it holds no such files"
        raise DatasetError(f"{folder}: nothing to import: {reason}")
    write_metadata(out, recordings)
    return Dataset(out.name, out, tuple(recordings)), tuple(problems)
