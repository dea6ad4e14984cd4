"""Readers of sets that others publish: BioTac vibration as CSV, and the Cluster Haptic Texture Database.

Neither has labels rough and smooth as people give them. A file ``labels.csv`` with the columns ``surface`` and
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

LABELS = "labels.csv"

Imported = tuple[Dataset, tuple[Problem, ...]]


def import_biotac(folder: Path, out: Path, *, progress: Callable[[int], None] = lambda done: None) -> Imported:
    """Convert CSV files with the columns pac1 to pac22 into sound of 2.2 kHz, contact alone.

    Parameters
    ----------
    folder
        Searched to any depth. The folder of a file names its surface.
    out
        New folder to write to.
    progress
        Called with the number of files done.
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
    """Convert files named ``surface_direction_speed_force_repetition.wav`` or ``.flac``; see :func:`import_biotac`."""
    problems: list[Problem] = []
    labels = _labels(folder, problems)
    recordings = []
    for done, path in enumerate(_files(folder, {".wav", ".flac"}), 1):
        progress(done)
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


FORMATS: Mapping[str, Callable[..., Imported]] = MappingProxyType({"biotac": import_biotac, "cluster": import_cluster})
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
