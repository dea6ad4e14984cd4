"""Which surfaces are kin: versions of one object, or objects of one kind, that must stay on one side of a split.

A detector that was trained on one mesh knows the next one. So folds are made by kin: the column ``kin`` of the data
set, or of a separate file; without either, a surface is kin to its other versions, by name.
"""

import re
from dataclasses import replace
from pathlib import Path

from tactophone.dataset.metadata import rows
from tactophone.dataset.values import Dataset, Recording
from tactophone.errors import DatasetError

_VERSION = re.compile(r"[\s_-]*(version[\s_-]*|v)\d+$", re.IGNORECASE)


def kin_of(recording: Recording) -> str:
    """Return the kin of a recording's surface: its property ``kin``, or the surface's name without its version.

    >>> kin_of(Recording(Path("a.wav"), "StoneTileVersion2")), kin_of(Recording(Path("b.wav"), "stone 3"))
    ('StoneTile', 'stone 3')
    """
    return recording.properties.get("kin") or _VERSION.sub("", recording.surface) or recording.surface


def with_kin(dataset: Dataset, file: Path) -> Dataset:
    """Return a data set whose recordings have the kin that a CSV file of ``surface,kin`` gives.

    Raises `DatasetError` if the file cannot be read, or names none of the surfaces.
    """
    try:
        kin = {row["surface"]: row["kin"] for _, row in rows(file, required=("surface", "kin"))}
    except OSError as error:
        raise DatasetError(f"{file}: cannot be read ({error.strerror}); give a CSV file of surface,kin") from None
    if not kin.keys() & set(dataset.surfaces):
        raise DatasetError(f"{file}: names none of the surfaces of {dataset.root}, such as {dataset.surfaces[0]}")
    recordings = (
        recording.with_properties(kin=found) if (found := kin.get(recording.surface)) else recording
        for recording in dataset.recordings
    )
    return replace(dataset, recordings=tuple(recordings))
