"""What was believed and felt, line by line: the CSV and JSON that `feel` writes (docs/feel.md says what they mean)."""

import csv
import json
import math
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tactophone.errors import DatasetError
from tactophone.types import HapticCommand, PipelineStep, Prediction, Touch

COLUMNS = (
    "time", "window_end", "none", "smooth", "rough", "touch", "contact",
    "level_dbfs", "roughness", "frequency", "amplitude",
)  # fmt: skip
"""Of the CSV file, and the keys of each entry of the JSON file."""

_DIGITS = 6


def row(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Give one line: when it was felt, the window's end, what was believed, and what was felt.

    Examples
    --------
    >>> belief = Prediction((0.1, 0.2, 0.7), Touch.ROUGH, roughness=0.78, level_dbfs=-20.0, start=0.0, end=0.256)
    >>> print(*row(belief, HapticCommand(0.5, 70.0, time=0.259)).values())
    0.259 0.256 0.1 0.2 0.7 rough 1 -20.0 0.78 70.0 0.5
    """
    none, smooth, rough = prediction.probabilities
    numbers = {
        "time": command.time, "window_end": prediction.end, "none": none, "smooth": smooth, "rough": rough,
        "touch": prediction.touch.name.lower(), "contact": int(prediction.touch is not Touch.NONE),
        "level_dbfs": prediction.level_dbfs, "roughness": prediction.roughness,
        "frequency": command.frequency, "amplitude": command.amplitude,
    }  # fmt: skip
    return {name: round(value, _DIGITS) if isinstance(value, float) else value for name, value in numbers.items()}


class TimelineWriter:
    """Writes the timeline while it comes about; a context manager.

    Parameters
    ----------
    path
        The CSV file.
    json_path
        A JSON file with the same entries as a list; none if ``None``.
    """

    def __init__(self, path: Path, *, json_path: Path | None = None) -> None:
        self._path, self._json_path = path, json_path
        self._resources = ExitStack()
        self._between = "[\n"

    def __enter__(self) -> Self:
        self._csv = csv.DictWriter(self._resources.enter_context(self._path.open("w", newline="")), COLUMNS)
        self._csv.writeheader()
        self._json = self._resources.enter_context(self._json_path.open("w")) if self._json_path else None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._json:
            self._json.write("[]\n" if self._between == "[\n" else "\n]\n")
        self._resources.close()

    def write(self, tick: PipelineStep) -> None:
        """Add the lines of one step."""
        for prediction, command in zip(tick.predictions, tick.commands, strict=True):
            entries = row(prediction, command)
            self._csv.writerow(entries)
            if self._json:
                # JSON has no infinities: a level of nothing at all is null there.
                known = {name: None if value == -math.inf else value for name, value in entries.items()}
                self._json.write(self._between + json.dumps(known))
                self._between = ",\n"


def read_timeline(path: Path) -> dict[str, NDArray[Any]]:
    """Read a CSV timeline back, one array a column; ``touch`` as numbers of `Touch`.

    Raises
    ------
    DatasetError
        If a column is missing or holds no numbers.
    """
    with path.open(newline="") as file:
        lines = list(csv.DictReader(file))
    try:
        columns = {name: np.array([float(line[name]) for line in lines]) for name in COLUMNS if name != "touch"}
        return columns | {"touch": np.array([Touch[line["touch"].upper()] for line in lines], np.int8)}
    except (KeyError, ValueError, TypeError) as error:
        raise DatasetError(f"{path}: no timeline of ours ({error}); make one with `tactophone feel`") from error
