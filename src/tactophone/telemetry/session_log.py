"""The session log: all that one end of the link received, and what steered it, as records of bytes.

The end itself writes them (`Telemetry.log`), and another process reads them (`Watcher.log`) and keeps them. From these
records `tactophone replay` computes the run again, equal to the bit. Their order is the order of events.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import msgspec

from tactophone.errors import DatasetError

_HEAD = struct.Struct("<IB")  # size of what follows, kind
_ARRIVAL = struct.Struct("<d?H")
_SIZE = struct.Struct("<H")

_RUN, _ARRIVED, _CONTROLS = range(3)

ARRIVAL_DIGITS = 5
"""Digits of an arrival's time after the point, in s: 10 microseconds, a five-hundredth of a packet's duration.

An end takes the time of an arrival from the clock with these, so that a log holds the same number in a byte or two.
"""

ARRIVAL_SIZE = 1 << 15
"""Bytes of events in one record; an arrival with more is split, the last part counting as its end."""


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
    epoch: float = 0.0
    """Seconds since 1970 at 0 of the monotonic clock, on which all other times are."""
    fingers: list[dict[str, Any]] = field(default_factory=list)
    """Name, settings of its own by dotted name, and text of the calibration file (empty if there is none) of each."""


@dataclass(frozen=True, slots=True)
class EventBatch:
    """Events that the end processed together, encoded as the link encodes them."""

    time: float
    """Of the monotonic clock, in s."""
    events: tuple[bytes, ...] = ()
    polled: bool = False
    """Whether they came with the passing of time, not from the network; there may then be none."""
    more: bool = False
    """Whether the next record continues this one."""


@dataclass(frozen=True, slots=True)
class Controls:
    """What a person or the machine may change while the end runs; logged at each change."""

    armed: bool
    ceiling: float
    output_level: float
    """`armed`, `ceiling` and `output_level`: of the output gate."""
    profile: str
    threshold_dbfs: float | None
    """Contact threshold that was given or calibrated; ``None`` while it follows the noise floor by itself."""
    step: int = 0
    """0 when the change came before the next arrival; otherwise it came while this step of the last arrival, counted
    from 1, was computed."""
    finger: int = 0
    """Of a hand: whose controls these are."""


Record: TypeAlias = RunStart | EventBatch | Controls


def write_record(record: Record) -> list[bytes]:
    """Encode a record, in as many parts as its size requires.

    Examples
    --------
    >>> arrival = EventBatch(2.5, (b"first", b"second"))
    >>> list(read_records(b"".join(write_record(arrival)))) == [arrival]
    True
    """
    if isinstance(record, EventBatch):
        return [_framed(_ARRIVED, _write_arrival(part)) for part in _parts(record)]
    kind = _RUN if isinstance(record, RunStart) else _CONTROLS
    return [_framed(kind, msgspec.json.encode(record))]


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
            if kind == _ARRIVED:
                yield _read_arrival(body)
            elif kind == _RUN:
                yield msgspec.json.decode(body, type=RunStart)
            elif kind == _CONTROLS:
                yield msgspec.json.decode(body, type=Controls)
            else:
                raise ValueError(f"a record of kind {kind}, which this version does not know")
            position += size
    except (struct.error, ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"a session log with a broken record at byte {position}: {error}") from error


def _framed(kind: int, body: bytes) -> bytes:
    return _HEAD.pack(len(body), kind) + body


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
        size += len(event) + _SIZE.size
    yield EventBatch(arrival.time, tuple(part), arrival.polled)


def _write_arrival(arrival: EventBatch) -> bytes:
    # The flag `more` is the highest bit of the count: a record holds far fewer than 2**15 events.
    head = _ARRIVAL.pack(arrival.time, arrival.polled, len(arrival.events) | arrival.more << 15)
    return head + b"".join([_SIZE.pack(len(event)) + event for event in arrival.events])


def _read_arrival(body: bytes) -> EventBatch:
    time, polled, count = _ARRIVAL.unpack_from(body)
    events, position = [], _ARRIVAL.size
    for _ in range(count & 0x7FFF):
        (size,) = _SIZE.unpack_from(body, position)
        position += _SIZE.size
        events.append(body[position : position + size])
        position += size
    return EventBatch(time, tuple(events), polled, more=bool(count >> 15))
