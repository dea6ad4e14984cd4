"""Predictions and their commands as JSON: one to look at, or many in columns to keep.

A kept number is rounded, as its last digits are noise to everything but a comparison to the bit. For that, each row has
a check value of its exact numbers: 16 bits in place of the 40 bytes that would not compress.
"""

import hashlib
import json
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

from tactophone.types import EVENT_KINDS, HapticCommand, Prediction, Touch, TouchEvent

DIGITS = {
    "window_end": 9, "window": 9, "delay": 9, "none": 3, "smooth": 3, "rough": 3, "roughness": 3, "level_dbfs": 1,
    "frequency": 1, "amplitude": 3,
}  # fmt: skip
"""Digits after the point."""

_CHECK_DIGITS = 4


@dataclass(frozen=True, slots=True)
class LoggedPrediction:
    """A prediction and its command, of one finger; the command is NaN where there was none.

    ``check`` is the `check_of` the exact numbers where these are rounded.
    """

    prediction: Prediction
    command: HapticCommand
    finger: int = 0
    check: str = ""


def check_of(prediction: Prediction, command: HapticCommand) -> str:
    """Return the check value of a prediction and its command: equal numbers have equal ones, and hardly any others.

    The flag ``faulty`` is no part of it, as telemetry does not publish it.
    """
    numbers = (
        *prediction.probabilities, float(prediction.touch), prediction.roughness, prediction.level_dbfs,
        prediction.start, prediction.end, command.time, command.amplitude, command.frequency,
    )  # fmt: skip
    # Adding 0 makes -0 to 0; NaN has many forms, of which one is taken.
    exact = struct.pack("<11d", *[math.nan if math.isnan(number) else number + 0.0 for number in numbers])
    return hashlib.blake2b(exact, digest_size=_CHECK_DIGITS // 2).hexdigest()


def entries_of(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return a prediction and its command by name; ``None`` for NaN and infinity, which JSON does not have."""
    none, smooth, rough = prediction.probabilities
    end = prediction.end
    numbers = {
        "window_end": end, "window": end - prediction.start, "delay": command.time - end,
        "none": none, "smooth": smooth, "rough": rough, "level_dbfs": prediction.level_dbfs,
        "roughness": prediction.roughness, "frequency": command.frequency, "amplitude": command.amplitude,
    }  # fmt: skip
    entries: dict[str, Any] = {
        name: round(number, DIGITS[name]) if math.isfinite(number) else None for name, number in numbers.items()
    }
    entries |= {"touch": prediction.touch.name.lower(), "contact": int(prediction.touch is not Touch.NONE)}
    for event in prediction.events:
        entries |= {"event": event.kind, "event_time": event.time}
    return entries


def write_columns(rows: Sequence[tuple[Prediction, HapticCommand]]) -> bytes:
    """Return predictions as a message of columns, one value where all are equal.

    The window's end is the time since that of the row before, the first since 0.
    """
    entries = [entries_of(*row) for row in rows]
    columns: dict[str, Any] = {name: [entry[name] for entry in entries] for name in (*DIGITS, "touch")}
    # The level varies most, so its digits would cost most.
    columns["level_dbfs"] = [None if level is None else round(level) for level in columns["level_dbfs"]]
    columns["window_end"] = [round(end - before, 9) for before, end in pairwise([0.0, *columns["window_end"]])]
    columns = {name: column[:1] if column.count(column[0]) == len(rows) else column for name, column in columns.items()}
    columns["check"] = "".join(check_of(*row) for row in rows)
    columns["events"] = [
        [number, event.kind, event.time] for number, (prediction, _) in enumerate(rows) for event in prediction.events
    ]
    return json.dumps(columns, separators=(",", ":")).encode()


def read_columns(data: bytes, finger: int = 0) -> Iterator[LoggedPrediction]:
    """Yield the predictions of a message again.

    Raises
    ------
    ValueError, KeyError, TypeError
        If it is not such a message.
    """
    columns = json.loads(data)
    events = [(number, TouchEvent(EVENT_KINDS[EVENT_KINDS.index(kind)], float(time)))
              for number, kind, time in columns["events"]]  # fmt: skip
    rows = len(columns["check"]) // _CHECK_DIGITS
    columns |= {name: columns[name] * rows if len(columns[name]) == 1 else columns[name] for name in (*DIGITS, "touch")}
    names = [*DIGITS][1:]
    for number, (end, touch, *values) in enumerate(
        zip(accumulate(columns["window_end"]), columns["touch"], *(columns[name] for name in names), strict=True)
    ):
        value = {name: math.nan if each is None else float(each) for name, each in zip(names, values, strict=True)}
        level = -math.inf if math.isnan(value["level_dbfs"]) else value["level_dbfs"]
        prediction = Prediction(
            (value["none"], value["smooth"], value["rough"]), Touch[touch.upper()], value["roughness"], level,
            start=round(end - value["window"], 9), end=round(end, 9),
            events=tuple(event for row, event in events if row == number),
        )  # fmt: skip
        command = HapticCommand(value["amplitude"], value["frequency"], round(end + value["delay"], 9))
        check = columns["check"][_CHECK_DIGITS * number : _CHECK_DIGITS * (number + 1)]
        yield LoggedPrediction(prediction, command, finger, check)
