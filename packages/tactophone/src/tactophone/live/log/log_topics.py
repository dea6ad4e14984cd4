"""The topics of a log (MCAP) and of a live view (Foxglove), each with its schema; the
topics of ROS 2 are in `ros_topics`.

Messages are JSON, which every viewer plots and every language reads; bytes in them are
base64. Sound is protobuf in Foxglove's own schemas, as its Audio panel plays nothing
else.
"""

import functools
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec

from tactophone.core.prediction_fields import PREDICTION_FIELDS
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.records import Controls, EventBatch, RunStart


@dataclass(frozen=True, slots=True)
class Schema:
    """A schema as MCAP and the Foxglove protocol name it; ``encoding`` is the encoding
    of the schema."""

    name: str
    encoding: str
    data: bytes

    @property
    def message_encoding(self) -> str:
        return "json" if self.encoding == "jsonschema" else self.encoding


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with its schema, the line that explains it, and the number of its
    finger."""

    name: str
    schema: Schema
    words: str
    finger: int = 0

    @property
    def kind(self) -> str:
        """The end of its name, which is the same for every finger of a hand."""
        return self.name.rpartition("/")[2]


@dataclass(frozen=True, slots=True)
class Message:
    """A message of a topic; ``time`` in s since 1970."""

    topic: Topic
    time: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Packets:
    """Content of a message of `PACKETS`."""

    arrivals: list[EventBatch]


@dataclass(frozen=True, slots=True)
class Totals:
    """Content of a message of `HEALTH`."""

    counters: dict[str, int]
    gauges: dict[str, float]


@dataclass(frozen=True, slots=True)
class Stamp:
    """A time since 1970, as Foxglove has it."""

    sec: int
    nsec: int


@dataclass(frozen=True, slots=True)
class Event:
    """Content of a message of `EVENTS`, Foxglove's ``Log``; level 2 is information, 3 a
    warning."""

    timestamp: Stamp
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


def _json_schema(name: str, content: Any) -> Schema:
    """Return the schema of a type, as simple as Foxglove and Lichtblick need it.

    They refuse references, alternatives such as a number or null, objects without
    properties, and lists of bytes.
    """
    (described,), parts = msgspec.json.schema_components([content])

    def simple(part: dict[str, Any]) -> dict[str, Any]:
        if "$ref" in part:
            return simple(parts[part["$ref"].rpartition("/")[2]])
        if "anyOf" in part:
            return simple(part["anyOf"][0])
        kind = part.get("type", "object")
        if kind == "array":
            return {"type": kind, "items": simple(part["items"])}
        if kind == "object":
            return {
                "type": kind,
                "properties": {
                    key: simple(each)
                    for key, each in part.get("properties", {}).items()
                },
            }
        return {"type": kind}

    return Schema(
        name, "jsonschema", msgspec.json.encode({"title": name, **simple(described)})
    )


def octets(number: int, value: bytes) -> bytes:
    """Encode a protobuf field of bytes, a text as UTF-8, or an encoded message."""
    return _varint(number << 3 | 2) + _varint(len(value)) + value


def integer(number: int, value: int) -> bytes:
    """Encode a protobuf field of a whole number from 0."""
    return _varint(number << 3) + _varint(value)


def fixed32(number: int, value: int) -> bytes:
    """Encode a protobuf field of a whole number in four bytes."""
    return _varint(number << 3 | 5) + struct.pack("<I", value)


def _varint(value: int) -> bytes:
    """Encode a whole number, seven bits a byte
    (protobuf.dev/programming-guides/encoding).

    >>> _varint(300).hex()
    'ac02'
    """
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])


_FIELD_TYPES = {"int64": 3, "int32": 5, "fixed32": 7, "string": 9, "bytes": 12}
"""By their numbers in ``FieldDescriptorProto.Type``; every other name belongs to a
message, number 11."""


def _describe(
    package: str, message: str, fields: Mapping[str, str], imports: Sequence[str] = ()
) -> bytes:
    """Return a file of one message as an entry of a ``FileDescriptorSet``, which is
    several of them joined."""
    described = octets(1, message.encode())
    for number, (name, kind) in enumerate(fields.items(), 1):
        field = (
            octets(1, name.encode())
            + integer(3, number)
            + integer(4, 1)
            + integer(5, _FIELD_TYPES.get(kind, 11))
        )
        described += octets(
            2, field if kind in _FIELD_TYPES else field + octets(6, f".{kind}".encode())
        )
    file = octets(1, f"{package}.{message}.proto".encode()) + octets(
        2, package.encode()
    )
    file += b"".join(octets(3, f"{other}.proto".encode()) for other in imports)
    return octets(1, file + octets(4, described) + octets(12, b"proto3"))


def _audio(name: str, **further: str) -> Schema:
    time = "google.protobuf.Timestamp"
    fields = {"timestamp": time, "data": "bytes", "format": "string", **further}
    described = _describe(
        "google.protobuf", "Timestamp", {"seconds": "int64", "nanos": "int32"}
    )
    return Schema(
        f"foxglove.{name}",
        "protobuf",
        described + _describe("foxglove", name, fields, [time]),
    )


COMPRESSED_AUDIO = _audio("CompressedAudio")
RAW_AUDIO = _audio("RawAudio", sample_rate="fixed32", number_of_channels="fixed32")

_PREDICTION = {
    field.name: str if field.name in ("touch", "event") else float | None
    for field in PREDICTION_FIELDS
}

RUN = Topic(
    "/tactophone/run",
    _json_schema("tactophone.Run", RunStart),
    "how the process was started: settings, hash of the model, versions",
)
PACKETS = Topic(
    "/tactophone/packets",
    _json_schema("tactophone.Packets", Packets),
    "decrypted packets as they came, in base64, with their arrival times, in s",
)
CONTROLS = Topic(
    "/tactophone/controls",
    _json_schema("tactophone.Controls", Controls),
    "what a person changed, in its order among the packets",
)
PREDICTION_TOPIC = Topic(
    "/tactophone/prediction",
    _json_schema(
        "tactophone.Prediction",
        msgspec.defstruct("Prediction", list(_PREDICTION.items())),
    ),
    "a prediction, and its command as limited; a number that has no value is left out",
)


@dataclass(frozen=True, slots=True)
class LoggedState(RunState):
    """A run's state as it is logged: with what follows from its fields, for viewers
    that plot by the schema."""

    armed: bool = False
    muted_because: str = ""


STATE_TOPIC = Topic(
    "/tactophone/state",
    _json_schema("tactophone.State", LoggedState),
    "the state at each change",
)
HEALTH = Topic(
    "/tactophone/health",
    _json_schema("tactophone.Health", Totals),
    "counters and gauges, every 5 s",
)
EVENTS = Topic(
    "/tactophone/events",
    _json_schema("foxglove.Log", Event),
    "arming, muting, connections and faults",
)
CONTACT_SOUND = Topic(
    "/tactophone/sound/contact", COMPRESSED_AUDIO, "contact microphone, Opus as it came"
)
AIR_SOUND = Topic(
    "/tactophone/sound/air", COMPRESSED_AUDIO, "air microphone, Opus as it came"
)
PCM_SOUND = Topic("/tactophone/sound", RAW_AUDIO, "both microphones, 16 bit")

TOPICS = (
    RUN,
    PACKETS,
    CONTROLS,
    STATE_TOPIC,
    HEALTH,
    EVENTS,
    PREDICTION_TOPIC,
    CONTACT_SOUND,
    AIR_SOUND,
    PCM_SOUND,
)

SOUND = (CONTACT_SOUND, AIR_SOUND, PCM_SOUND)
"""Topics that a log does not hold, as they follow from its packets
(`tactophone.live.log.sound`)."""


@functools.cache
def of_finger(topic: Topic, finger: int, name: str) -> Topic:
    """Return the topic of a finger of a hand; without a name, the topic itself.

    >>> of_finger(PREDICTION_TOPIC, 1, "index").name
    '/tactophone/index/prediction'
    """
    place = topic.name.replace("/tactophone/", f"/tactophone/{name}/")
    return (
        replace(topic, name=place, words=f"{name}: {topic.words}", finger=finger)
        if name
        else topic
    )


def topics_of(names: Sequence[str], *, sound: bool) -> tuple[Topic, ...]:
    """Return the topics of a run with fingers of these names; one empty name where
    there is no hand."""
    each = (PREDICTION_TOPIC, *SOUND) if sound else (PREDICTION_TOPIC,)
    common = [topic for topic in TOPICS if topic not in (PREDICTION_TOPIC, *SOUND)]
    return (
        *common,
        *(
            of_finger(topic, place, name)
            for place, name in enumerate(names)
            for topic in each
        ),
    )
