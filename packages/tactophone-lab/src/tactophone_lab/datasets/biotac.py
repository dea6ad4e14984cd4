"""BioTac vibration as published: CSV files with the columns pac1 to pac22 become sound
of one contact channel at 2.2 kHz."""

from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.processes import make_room
from tactophone.core.recordings.links import refuse_link
from tactophone.core.recordings.metadata import refuse_data_set, write_metadata
from tactophone.core.recordings.values import Problem, Recording
from tactophone_lab.datasets.published_labels import (
    LABELS,
    ImportedSet,
    read_labels,
)

BIOTAC_RATE = 2200
"""Hz of the BioTac's dynamic pressure, PAC: 22 values in each line of 10 ms (SynTouch's
product manual)."""

BIOTAC_FULL_SCALE = 2048
"""Half of the range of its 12-bit converter."""

PAC = tuple(f"pac{number}" for number in range(1, 23))
"""Columns of the 22 values that follow each other in time."""


def import_biotac(folder: Path, out: Path) -> ImportedSet:
    """Convert CSV files with the columns pac1 to pac22 into sound of 2.2 kHz, contact
    alone.

    ``folder`` is searched to any depth; the folder of a file names its surface. Raises
    `DatasetError` if there is nothing to convert, or ``out`` holds a data set already.
    """
    refuse_data_set(out)
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
            f"{folder}: nothing to import: "
            f"{problems[0] if problems else 'it holds no such files'}"
        )
    write_metadata(out, recordings)
    return ImportedSet(tuple(recordings), tuple(problems))


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
