"""The prediction log: each prediction and its command, as CSV and JSON (docs/guide/feel.md explains the columns).

`TimelineWriter` writes the steps of an offline run; `PredictionLog` follows a live run through its telemetry.
"""

import csv
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.errors import ConfigError, DatasetError
from tactophone.telemetry.follower import RunFollower
from tactophone.types import (
    PREDICTION_FIELDS,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
    prediction_of,
)

COLUMNS = tuple(field.name for field in PREDICTION_FIELDS if field.name != "window_start")
"""Of the CSV file, and the keys of each entry of the JSON file; without a touch event the last two are empty."""

_WORDS = ("touch", "event", "event_time")

FINGER = "finger"
"""Column before the others in the log of a hand: the finger's name."""

_DIGITS = 6


def row(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return the entries of one line, by `COLUMNS`; times in s, rounded to microseconds.

    Examples
    --------
    >>> from tactophone.types import TouchEvent
    >>> tap = TouchEvent("tap", 0.23)
    >>> prediction = Prediction((0.1, 0.2, 0.7), Touch.ROUGH, 0.78, -20.0, start=0.0, end=0.256, events=(tap,))
    >>> print(*row(prediction, HapticCommand(0.5, 70.0, time=0.259)).values())
    0.259 0.256 0.1 0.2 0.7 rough 1 -20.0 0.78 70.0 0.5 tap 0.23
    """
    entries: dict[str, Any] = {field.name: field.of(prediction, command) for field in PREDICTION_FIELDS}
    entries |= {"touch": prediction.touch.name.lower(), "contact": int(entries["contact"])}
    event = prediction.events[-1] if prediction.events else None
    entries |= {"event": event.kind if event else "", "event_time": event.time if event else ""}
    return {key: round(value, _DIGITS) if isinstance(value := entries[key], float) else value for key in COLUMNS}


class TimelineWriter:
    """Writes predictions as they are made; a context manager.

    A JSON file gets the same entries as a list. With names of ``fingers`` the first column is ``finger``.
    """

    def __init__(self, path: Path, *, json_path: Path | None = None, fingers: Sequence[str] = ()) -> None:
        self._path, self._json_path, self.fingers = path, json_path, fingers
        self._resources = ExitStack()
        self._separator = "[\n"

    def __enter__(self) -> Self:
        self._file = self._resources.enter_context(self._path.open("w", newline=""))
        self._csv = csv.DictWriter(self._file, (FINGER, *COLUMNS) if self.fingers else COLUMNS)
        self._csv.writeheader()
        self._json = self._resources.enter_context(self._json_path.open("w")) if self._json_path else None
        return self

    def __exit__(self, *error: Any) -> None:
        if self._json:
            self._json.write("[]\n" if self._separator == "[\n" else "\n]\n")
        self._resources.close()

    def write(self, step: PipelineStep) -> None:
        """Add the predictions of one step."""
        for prediction, command in zip(step.predictions, step.commands, strict=True):
            self.write_row(prediction, command, finger=step.finger)

    def write_row(self, prediction: Prediction, command: HapticCommand, *, finger: int = 0) -> None:
        """Add one prediction and its command."""
        entries = ({FINGER: self.fingers[finger]} if self.fingers else {}) | row(prediction, command)
        self._csv.writerow(entries)
        if self._json:
            self._json.write(self._separator + msgspec.json.encode(entries).decode())
            self._separator = ",\n"

    def flush(self) -> None:
        """Hand the lines written so far to the system, so that they outlive this process."""
        self._file.flush()


class PredictionLog(RunFollower):
    """Writes each prediction of a live run to a CSV file, from outside the run's process; a context manager.

    Lines are flushed at each read (`follower.READ_INTERVAL`), so a kill of either process loses less than 1 s. A
    process that the watchdog has replaced is followed on; its times begin at 0 again, those of a new session go on.
    Where there was no command (a prediction that came too late, or one made on the robot), ``frequency`` and
    ``amplitude`` are ``nan``.

    Parameters
    ----------
    name
        Of a run that exists already.
    path
        The CSV file, with the columns of `TimelineWriter`.
    report
        Called with a message when predictions were overwritten before they were read, and when the file can no longer
        be written: the log ends then, the run goes on.

    Attributes
    ----------
    missed
        Predictions that were overwritten before they were read.

    Raises
    ------
    ConfigError
        When the file cannot be written.
    """

    def __init__(self, name: str, path: Path, *, report: Callable[[str], None] = lambda message: None) -> None:
        super().__init__(name)
        self.missed = 0
        self._full = False
        self._path, self._report = path, report
        self._writer = TimelineWriter(path, fingers=list(filter(None, self.watcher.finger_names())))
        self._counts = [0] * self.watcher.fingers

    def __enter__(self) -> Self:
        try:
            self._writer.__enter__()
        except OSError as error:
            raise ConfigError(f"cannot write {self._path} ({error.strerror}): choose another --log") from error
        return super().__enter__()

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        with suppress(OSError):  # reported by `read`
            self._writer.__exit__(*error)

    def read(self) -> None:
        """Write the predictions made since the last read."""
        try:
            if not self._full:
                self._write_new()
        except OSError as error:
            self._full = True
            self._report(f"{self._path}: the log ends here ({error.strerror}); the run goes on")

    def _write_new(self) -> None:
        successor = self.watcher.successor()
        for finger in range(self.watcher.fingers):
            rows, count = self.watcher.predictions(self._counts[finger], finger=finger)
            self._report_gap(count - self._counts[finger] - len(rows), rows)
            for entry in rows:
                self._writer.write_row(*prediction_of(entry), finger=finger)
            self._counts[finger] = count
        self._writer.flush()
        if successor is not None:
            self.watcher, self._counts = successor, [0] * successor.fingers

    def _report_gap(self, missed: int, rows: NDArray[np.void]) -> None:
        if missed > 0:
            self.missed += missed
            until = f" before {rows[0]['window_end']:.3f} s" if len(rows) else ""
            self._report(f"{self._path}: {missed} predictions{until} are missing, as they were not read in time")


def read_timeline(path: Path, *, finger: str = "") -> dict[str, NDArray[Any]]:
    """Read a CSV timeline (of a hand: one finger's) as one array for each column; ``touch`` as numbers of `Touch`.

    ``event`` is text, empty where there is none, and then ``event_time`` is NaN; older timelines have neither column.
    Raises `DatasetError` if a column is missing or contains no numbers.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = [line for line in csv.DictReader(file) if not finger or line[FINGER] == finger]
        columns = {name: np.array([float(line[name]) for line in lines]) for name in COLUMNS if name not in _WORDS}
        return columns | {
            "touch": np.array([Touch[line["touch"].upper()] for line in lines], np.int8),
            "event": np.array([line.get("event") or "" for line in lines], str),
            "event_time": np.array([float(line.get("event_time") or "nan") for line in lines]),
        }
    except (KeyError, ValueError, TypeError, csv.Error) as error:
        raise DatasetError(f"{path}: not a timeline ({error}); make one with `tactophone feel`") from error
