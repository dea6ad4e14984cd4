"""The session log, as records of bytes: all that one end of the link received, and what
steered it.

The end itself writes it (`Telemetry.log`), and another process reads it (`Watcher.log`)
and keeps it. From its records `tactophone replay` computes the run again, equal to the
bit. Their order is the order of events.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any, TypeAlias, TypedDict

import msgspec

from tactophone.core.errors import DatasetError
from tactophone.core.types import FINGER_PATTERN, MOST_FINGERS

_HEAD = struct.Struct("<IB")
"""What precedes each record: the size of what follows, and its kind."""

ARRIVAL_DIGITS = 5
"""Digits of an arrival's time after the point, in s: 10 microseconds, a five-hundredth
of a packet's duration.

An end rounds the time of an arrival to them, so that a log holds the same number in a
byte or two.
"""

_EVENT_OVERHEAD = 5
"""Bytes that MessagePack adds to an event at most."""

ARRIVAL_SIZE = 1 << 15
"""Bytes of events in one record; an arrival with more is split, the last part counting
as its end."""


# A log may come from anybody: these types hold what a run can have been, and nothing
# else.
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Seconds = Annotated[float, msgspec.Meta(ge=0, le=1e10)]
FingerIndex = Annotated[int, msgspec.Meta(ge=0, lt=MOST_FINGERS)]


class FingerStart(TypedDict):
    """A finger at the beginning of a process."""

    name: Annotated[str, msgspec.Meta(pattern=rf"^({FINGER_PATTERN})?\Z")]
    """Empty for the only finger of a run without ``--fingers``."""
    settings: dict[str, Any]
    """The finger's own settings, by dotted name."""
    calibration: Annotated[str, msgspec.Meta(max_length=1 << 20)]
    """Text of the calibration file; empty without one."""


@dataclass(frozen=True, slots=True)
class RunStart:
    """The beginning of a process."""

    role: str
    """``operator`` or ``robot``."""
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    """Every setting, by section and name; ``None`` stands for NaN, which JSON does not
    have."""
    models: dict[str, str] = field(default_factory=dict)
    """SHA-256 of each model file that the settings may lead to, by its name."""
    versions: dict[str, str] = field(default_factory=dict)
    """Versions of Tactophone and of what its numbers depend on."""
    epoch: Seconds = 0.0
    """Seconds since 1970 at 0 of the monotonic clock, on which all other times are."""
    fingers: Annotated[list[FingerStart], msgspec.Meta(max_length=MOST_FINGERS)] = (
        field(default_factory=list)
    )


class EventBatch(msgspec.Struct, frozen=True):
    """Events that the end processed together, encoded as the link encodes them."""

    time: Seconds
    """Seconds on the monotonic clock."""
    events: tuple[bytes, ...] = ()
    polled: bool = False
    """Whether they came with the passing of time, not from the network; there may then
    be none."""
    more: bool = False
    """Whether the next record continues this one."""


@dataclass(frozen=True, slots=True)
class Controls:
    """What a person or the machine may change while the end runs; logged at each
    change."""

    armed: bool
    """Whether the output gate lets anything vibrate."""
    ceiling: Share
    """The output gate's greatest amplitude, 0 to 1 of full drive."""
    output_level: Share
    """The output gate's volume below the ceiling."""
    profile: str
    """Name of the rendering profile."""
    threshold_dbfs: Annotated[float, msgspec.Meta(ge=-1000, le=0)] | None = None
    """Contact threshold that was given or calibrated; ``None`` while it follows the
    noise floor by itself."""
    step: int = 0
    """Step of the last arrival, counted from 1, during which the change came; 0 when it
    came before the next arrival."""
    finger: FingerIndex = 0
    """Index of the finger whose controls these are."""


Record: TypeAlias = RunStart | EventBatch | Controls

_KINDS: tuple[type[Record], ...] = (RunStart, EventBatch, Controls)
"""Type of each kind of record, by the number in its head."""


def write_record(record: Record) -> list[bytes]:
    """Encode a record, in as many parts as its size requires.

    >>> arrival = EventBatch(2.5, (b"first", b"second"))
    >>> list(read_records(b"".join(write_record(arrival)))) == [arrival]
    True
    """
    parts = _parts(record) if isinstance(record, EventBatch) else (record,)
    kind = _KINDS.index(type(record))
    return [
        _HEAD.pack(len(body), kind) + body
        for body in map(msgspec.msgpack.encode, parts)
    ]


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
                raise ValueError(
                    f"a record of kind {kind}, which this version does not know"
                )
            yield msgspec.msgpack.decode(body, type=_KINDS[kind])
            position += size
    except (struct.error, ValueError, msgspec.MsgspecError) as error:
        raise DatasetError(
            f"a session log with a broken record at byte {position}: {error}"
        ) from error


def _parts(arrival: EventBatch) -> Iterator[EventBatch]:
    if len(arrival.events) <= 1:
        yield arrival
        return
    part: list[bytes] = []
    size = 0
    for event in arrival.events:
        if part and size + len(event) > ARRIVAL_SIZE:
            yield EventBatch(arrival.time, tuple(part), arrival.polled, more=True)
            part = []
            size = 0
        part.append(event)
        size += len(event) + _EVENT_OVERHEAD
    yield EventBatch(arrival.time, tuple(part), arrival.polled)
