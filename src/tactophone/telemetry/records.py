"""What is kept of a run: the session log, as records of bytes, and the timeline of its predictions.

The *session log* is all that one end of the link received, and what steered it. The end itself writes it
(`Telemetry.log`), and another process reads it (`Watcher.log`) and keeps it. From its records `tactophone replay`
computes the run again, equal to the bit. Their order is the order of events.

A *timeline* has each prediction and its command, as CSV and JSON (docs/guide/feel.md explains the columns).
"""

import csv
import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Self, TypeAlias, TypedDict

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.errors import DatasetError
from tactophone.types import (
    FINGER_PATTERN,
    MOST_FINGERS,
    PREDICTION_FIELDS,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)

_HEAD = struct.Struct("<IB")  # size of what follows, kind

ARRIVAL_DIGITS = 5
"""Digits of an arrival's time after the point, in s: 10 microseconds, a five-hundredth of a packet's duration.

An end takes the time of an arrival from the clock with these, so that a log holds the same number in a byte or two.
"""

_EVENT_OVERHEAD = 5  # bytes at most in MessagePack

ARRIVAL_SIZE = 1 << 15
"""Bytes of events in one record; an arrival with more is split, the last part counting as its end."""


# A log may come from anybody: these types hold what a run can have been, and nothing else.
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Seconds = Annotated[float, msgspec.Meta(ge=0, le=1e10)]
FingerIndex = Annotated[int, msgspec.Meta(ge=0, lt=MOST_FINGERS)]


class FingerStart(TypedDict):
    """A finger at the beginning of a process."""

    name: Annotated[str, msgspec.Meta(pattern=f"^({FINGER_PATTERN})?$")]
    """Empty for the only one."""
    settings: dict[str, Any]
    """Of its own, by dotted name."""
    calibration: Annotated[str, msgspec.Meta(max_length=1 << 20)]
    """Text of the calibration file; empty if there is none."""


@dataclass(frozen=True, slots=True)
class RunStart:
    """The beginning of a process."""

    role: str
    """``operator`` or ``robot``."""
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Every setting, by section and name; ``None`` stands for NaN, which JSON does not have."""
    models: dict[str, str] = field(default_factory=dict)
    """SHA-256 of each model file that the settings may lead to, by its name."""
    versions: dict[str, str] = field(default_factory=dict)
    """Of Tactophone and of what its numbers depend on."""
    epoch: Seconds = 0.0
    """Seconds since 1970 at 0 of the monotonic clock, on which all other times are."""
    fingers: Annotated[list[FingerStart], msgspec.Meta(max_length=MOST_FINGERS)] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class EventBatch:
    """Events that the end processed together, encoded as the link encodes them."""

    time: Seconds
    """Of the monotonic clock."""
    events: tuple[bytes, ...] = ()
    polled: bool = False
    """Whether they came with the passing of time, not from the network; there may then be none."""
    more: bool = False
    """Whether the next record continues this one."""


@dataclass(frozen=True, slots=True)
class Controls:
    """What a person or the machine may change while the end runs; logged at each change."""

    armed: bool
    ceiling: Share
    output_level: Share
    """`armed`, `ceiling` and `output_level`: of the output gate."""
    profile: str
    threshold_dbfs: Annotated[float, msgspec.Meta(ge=-1000, le=0)] | None
    """Contact threshold that was given or calibrated; ``None`` while it follows the noise floor by itself."""
    step: int = 0
    """0 when the change came before the next arrival; otherwise it came while this step of the last arrival, counted
    from 1, was computed."""
    finger: FingerIndex = 0
    """Of a hand: whose controls these are."""


Record: TypeAlias = RunStart | EventBatch | Controls

_KINDS: tuple[type[Record], ...] = (RunStart, EventBatch, Controls)


def write_record(record: Record) -> list[bytes]:
    """Encode a record, in as many parts as its size requires.

    >>> arrival = EventBatch(2.5, (b"first", b"second"))
    >>> list(read_records(b"".join(write_record(arrival)))) == [arrival]
    True
    """
    parts = _parts(record) if isinstance(record, EventBatch) else (record,)
    kind = _KINDS.index(type(record))
    return [_HEAD.pack(len(body), kind) + body for body in map(msgspec.msgpack.encode, parts)]


def read_records(log: bytes) -> Iterator[Record]:
    """Decode records; raises `DatasetError` when the bytes are not whole records."""
    position = 0
    try:
        while position < len(log):
            size, kind = _HEAD.unpack_from(log, position)
            position += _HEAD.size
            body = log[position : position + size]
            if len(body) < size:
                raise ValueError(f"{size} bytes announced, {len(body)} left")
            if kind >= len(_KINDS):
                raise ValueError(f"a record of kind {kind}, which this version does not know")
            yield msgspec.msgpack.decode(body, type=_KINDS[kind])
            position += size
    except (struct.error, ValueError, msgspec.MsgspecError) as error:
        raise DatasetError(f"a session log with a broken record at byte {position}: {error}") from error


def _parts(arrival: EventBatch) -> Iterator[EventBatch]:
    if len(arrival.events) <= 1:
        yield arrival
        return
    part: list[bytes] = []
    size = 0
    for event in arrival.events:
        if part and size + len(event) > ARRIVAL_SIZE:
            yield EventBatch(arrival.time, tuple(part), arrival.polled, more=True)
            part, size = [], 0
        part.append(event)
        size += len(event) + _EVENT_OVERHEAD
    yield EventBatch(arrival.time, tuple(part), arrival.polled)


COLUMNS = tuple(field.name for field in PREDICTION_FIELDS if field.name != "window_start")
"""Of the CSV file, and the keys of each entry of the JSON file; without a touch event the last two are empty."""

_WORDS = ("touch", "event", "event_time")

FINGER = "finger"
"""Column before the others in the log of a hand: the finger's name."""

_DIGITS = 6


def row(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return the entries of one line, by `COLUMNS`; times in s, rounded to microseconds.

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
        self._path.touch(0o600)  # of this user alone, as a log
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
        for prediction, command in zip(step.predictions, step.commands, strict=True):
            self.write_row(prediction, command, finger=step.finger)

    def write_row(self, prediction: Prediction, command: HapticCommand, *, finger: int = 0) -> None:
        entries = ({FINGER: self.fingers[finger]} if self.fingers else {}) | row(prediction, command)
        self._csv.writerow(entries)
        if self._json:
            self._json.write(self._separator + msgspec.json.encode(entries).decode())
            self._separator = ",\n"

    def flush(self) -> None:
        """Hand the lines written so far to the system, so that they outlive this process."""
        self._file.flush()


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
