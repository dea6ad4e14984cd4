"""The timeline of a recording or a run: each prediction and its command, as CSV and
JSON (docs/guide/feel.md)."""

import csv
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.prediction_fields import PREDICTION_FIELDS, entries_of
from tactophone.core.processes import flush_open_file, hold
from tactophone.core.types import HapticCommand, PipelineStep, Prediction, Touch

TIMELINE_COLUMNS = tuple(
    field.name for field in PREDICTION_FIELDS if field.name != "window_start"
)
"""Columns of the CSV file, and keys of each entry of the JSON file; without a touch
event the last two are empty."""

_SPECIAL = ("touch", "unknown", "event", "event_time")
"""Columns that hold words, or that older files lack."""

FINGER = "finger"
"""Column before the others in the log of a hand: the finger's name."""


def row(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return the entries of one line, by `TIMELINE_COLUMNS`; times in s, rounded to
    microseconds.

    >>> from msgspec.structs import replace
    >>> from tactophone.core.types import TouchEvent
    >>> tap = TouchEvent("tap", 0.23)
    >>> probabilities = (0.1, 0.2, 0.7)
    >>> found = Prediction(probabilities, Touch.ROUGH, 0.78, -20.0, 0.0, 0.256)
    >>> found = replace(found, events=(tap,))
    >>> print(*row(found, HapticCommand(0.5, 70.0, time=0.259)).values())
    0.259 0.256 0.1 0.2 0.7 rough 1 -20.0 0.78 70.0 0.5 0 tap 0.23
    """
    entries = entries_of(prediction, command)
    if not prediction.events:
        entries["event_time"] = ""
    return {key: _rounded(entries[key]) for key in TIMELINE_COLUMNS}


def _rounded(value: Any) -> Any:
    return round(value, 6) if isinstance(value, float) else value


class TimelineWriter:
    """Writes predictions as they are made; a context manager. A file at ``path`` is
    overwritten, and keeps its mode.

    A JSON file gets the same entries as a list. With names of ``fingers`` the first
    column is ``finger``.
    """

    def __init__(
        self, path: Path, *, json_path: Path | None = None, fingers: Sequence[str] = ()
    ) -> None:
        self._path = path
        self._json_path = json_path
        self.fingers = fingers
        self._resources = ExitStack()
        self._separator = "[\n"

    def __enter__(self) -> Self:
        enter = self._resources.enter_context
        self._file = enter(self._path.open("w", encoding="utf-8", newline=""))
        hold(self._file.fileno())
        columns = TIMELINE_COLUMNS
        if self.fingers:
            columns = (FINGER, *columns)
        self._csv = csv.DictWriter(self._file, columns)
        self._csv.writeheader()
        self._json = None
        if self._json_path:
            self._json = enter(self._json_path.open("w", encoding="utf-8"))
        return self

    def __exit__(self, *error: Any) -> None:
        if self._json:
            self._json.write("[]\n" if self._separator == "[\n" else "\n]\n")
        self._resources.close()

    def write(self, step: PipelineStep) -> None:
        for prediction, command in zip(step.predictions, step.commands, strict=True):
            self.write_row(prediction, command, finger=step.finger)

    def write_row(
        self, prediction: Prediction, command: HapticCommand, *, finger: int = 0
    ) -> None:
        entries = row(prediction, command)
        if self.fingers:
            entries = {FINGER: self.fingers[finger], **entries}
        self._csv.writerow(entries)
        if self._json:
            self._json.write(self._separator + msgspec.json.encode(entries).decode())
            self._separator = ",\n"

    def flush(self) -> None:
        """Hand the lines written so far to the system, so that they outlive this
        process."""
        self._file.flush()

    def write_to_disk(self) -> None:
        """Bring the lines written so far to the disk, so that they outlive a power
        failure."""
        self._file.flush()
        flush_open_file(self._file.fileno())


def read_timeline(path: Path, *, finger: str = "") -> dict[str, NDArray[Any]]:
    """Read a CSV timeline (for a hand, one finger's) as one array for each column;
    ``touch`` as numbers of `Touch`.

    ``event`` is text; without an event it is empty, and ``event_time`` is NaN. Older
    timelines lack these two columns and ``unknown``, which is then NaN. Raises
    `DatasetError` if a column is missing or contains no numbers.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = [
                line
                for line in csv.DictReader(file)
                if not finger or line[FINGER] == finger
            ]
        columns = {
            name: np.array([float(line[name]) for line in lines])
            for name in TIMELINE_COLUMNS
            if name not in _SPECIAL
        }
        return columns | {
            "touch": np.array(
                [Touch[line["touch"].upper()] for line in lines], np.int8
            ),
            "unknown": np.array(
                [float(line.get("unknown") or "nan") for line in lines]
            ),
            "event": np.array([line.get("event") or "" for line in lines], str),
            "event_time": np.array(
                [float(line.get("event_time") or "nan") for line in lines]
            ),
        }
    except (KeyError, ValueError, TypeError, csv.Error) as error:
        raise DatasetError(
            f"{path}: not a timeline ({error}); make one with `tactophone feel`"
        ) from error
