"""Predictions and their commands: one as JSON to look at, or many in columns of protobuf to keep.

A kept number is rounded, as its last digits are noise to everything but a comparison to the bit. For that, there are
check values of the exact numbers: a byte for each row, and eight for all of a message, in place of the 40 bytes a row
that would not compress.
"""

import hashlib
import math
import struct
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

from tactophone.bridges import protobuf
from tactophone.bridges.schemas import PREDICTION_COLUMNS
from tactophone.types import EVENT_KINDS, LIVE_SAMPLE_RATE, HapticCommand, Prediction, Touch, TouchEvent

DIGITS = {
    "window_end": 4, "window": 4, "delay": 4, "none": 3, "smooth": 3, "rough": 3, "roughness": 3, "level_dbfs": 1,
    "frequency": 1, "amplitude": 3,
}  # fmt: skip
"""Digits after the point, to look at."""

_UNITS = {name: 10**digits for name, digits in DIGITS.items()} | {
    "window_end": LIVE_SAMPLE_RATE, "window": LIVE_SAMPLE_RATE, "delay": LIVE_SAMPLE_RATE, "level_dbfs": 1,
}  # fmt: skip
"""Units of one in columns, where times are whole samples; the level varies most, so its digits would cost most."""

TOTAL_SIZE = 8
"""Bytes of the check value of all rows of a message."""

_FIELD = {field.name: number for number, field in enumerate(PREDICTION_COLUMNS.fields, 1)}
_NOTHING = -(1 << 40)  # units in place of NaN and infinity, beyond any number


@dataclass(frozen=True, slots=True)
class LoggedPrediction:
    """A prediction and its command, of one finger; the command is NaN where there was none.

    ``check`` is that of the exact numbers where these are rounded, and ``total``, in the last row of a message, that of
    all its rows (`RowChecks`).
    """

    prediction: Prediction
    command: HapticCommand
    finger: int = 0
    check: bytes = b""
    total: bytes = b""


class RowChecks:
    """Check values of the exact numbers of rows: equal numbers have equal ones.

    That of a row, a byte, is to find the row that differs; that of all rows makes it certain whether any does. The flag
    ``faulty`` is no part of them, as telemetry does not publish it.
    """

    def __init__(self) -> None:
        self._all = b""

    def add(self, prediction: Prediction, command: HapticCommand) -> bytes:
        """Return the check value of a row."""
        numbers = (
            *prediction.probabilities, float(prediction.touch), prediction.roughness, prediction.level_dbfs,
            prediction.start, prediction.end, command.time, command.amplitude, command.frequency,
        )  # fmt: skip
        # Adding 0 makes -0 to 0; NaN has many forms, of which one is taken.
        exact = struct.pack("<11d", *[math.nan if math.isnan(number) else number + 0.0 for number in numbers])
        self._all += exact
        return hashlib.blake2b(exact, digest_size=1).digest()

    def total(self) -> bytes:
        """Return the check value of all rows since the last call."""
        rows, self._all = self._all, b""
        return hashlib.blake2b(rows, digest_size=TOTAL_SIZE).digest()


def _numbers_of(prediction: Prediction, command: HapticCommand) -> dict[str, float]:
    none, smooth, rough = prediction.probabilities
    end = prediction.end
    return {
        "window_end": end, "window": end - prediction.start, "delay": command.time - end,
        "none": none, "smooth": smooth, "rough": rough, "level_dbfs": prediction.level_dbfs,
        "roughness": prediction.roughness, "frequency": command.frequency, "amplitude": command.amplitude,
    }  # fmt: skip


def entries_of(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return a prediction and its command by name; ``None`` for NaN and infinity, which JSON does not have."""
    entries: dict[str, Any] = {
        name: round(number, DIGITS[name]) if math.isfinite(number) else None
        for name, number in _numbers_of(prediction, command).items()
    }
    entries |= {"touch": prediction.touch.name.lower(), "contact": int(prediction.touch is not Touch.NONE)}
    for event in prediction.events:
        entries |= {"event": event.kind, "event_time": event.time}
    return entries


def write_columns(rows: Sequence[tuple[Prediction, HapticCommand]]) -> bytes:
    """Return predictions as a message of columns.

    A column holds whole units, each as the difference from the row before, first from 0, and ends with the last that is
    not 0. In place of a window's end stands the time since the one before.
    """
    numbers, message, checks = [_numbers_of(*row) for row in rows], b"", RowChecks()
    for name, unit in _UNITS.items():
        values = [each[name] for each in numbers]
        message += _column(name, [round(value * unit) if math.isfinite(value) else _NOTHING for value in values])
    message += _column("touch", [int(prediction.touch) for prediction, _ in rows])
    message += protobuf.octets(_FIELD["check"], b"".join(checks.add(*row) for row in rows) + checks.total())
    for row, (prediction, _) in enumerate(rows):
        for event in prediction.events:
            message += protobuf.integer(_FIELD["event_rows"], row)
            message += protobuf.octets(_FIELD["event_kinds"], event.kind.encode())
            message += protobuf.double(_FIELD["event_times"], event.time)
    return message


def read_columns(data: bytes, finger: int = 0) -> Iterator[LoggedPrediction]:
    """Yield the predictions of a message again.

    Raises `ValueError`, `TypeError` or `struct.error` if it is not such a message.
    """
    found = defaultdict[int, list[Any]](list)
    for number, value in protobuf.fields(data):
        found[number].append(value)
    check = b"".join(found[_FIELD["check"]])
    checks, total = check[:-TOTAL_SIZE], check[-TOTAL_SIZE:]
    rows = len(checks)
    columns = {name: _sums(b"".join(found[_FIELD[name]]), rows) for name in (*_UNITS, "touch")}
    columns["window_end"] = accumulate(columns["window_end"])
    event_fields = (found[_FIELD[name]] for name in ("event_rows", "event_kinds", "event_times"))
    events = [
        (row, TouchEvent(EVENT_KINDS[EVENT_KINDS.index(str(kind, "utf-8"))], *struct.unpack("<d", time)))
        for row, kind, time in zip(*event_fields, strict=True)
    ]
    for row, (*counts, touch) in enumerate(zip(*columns.values(), strict=True)):
        entry = {
            name: math.nan if count == _NOTHING else count / unit
            for (name, unit), count in zip(_UNITS.items(), counts, strict=True)
        }
        end, level = entry["window_end"], entry["level_dbfs"]
        prediction = Prediction(
            (entry["none"], entry["smooth"], entry["rough"]), Touch(touch), entry["roughness"],
            -math.inf if math.isnan(level) else level, start=end - entry["window"], end=end,
            events=tuple(event for number, event in events if number == row),
        )  # fmt: skip
        command = HapticCommand(entry["amplitude"], entry["frequency"], end + entry["delay"])
        yield LoggedPrediction(prediction, command, finger, checks[row : row + 1], total if row == rows - 1 else b"")


def _column(name: str, units: Sequence[int]) -> bytes:
    differences = _differences(_differences(units) if name == "window_end" else units)
    while differences and not differences[-1]:
        differences.pop()
    return protobuf.signed(_FIELD[name], differences) if differences else b""


def _differences(units: Sequence[int]) -> list[int]:
    """Return the differences of neighbours, the first from 0."""
    return [unit - before for before, unit in pairwise([0, *units])]


def _sums(packed: bytes, rows: int) -> Iterator[int]:
    """Yield the numbers whose differences these are; the last one holds for all rows that follow."""
    differences = list(protobuf.signed_numbers(packed))
    if len(differences) > rows:
        raise ValueError(f"a column of {len(differences)} rows, but the message has {rows}")
    return accumulate(differences + [0] * (rows - len(differences)))
