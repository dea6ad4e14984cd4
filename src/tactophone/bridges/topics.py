"""The topics of a log and of a live view, each with its schema.

Messages are JSON, which every viewer plots and every language reads; bytes in them are base64. Sound is protobuf in
Foxglove's own schemas, as its Audio panel plays nothing else.
"""

import functools
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgspec

from tactophone.telemetry import EventBatch
from tactophone.types import PREDICTION_FIELDS


@dataclass(frozen=True, slots=True)
class Schema:
    """A schema as MCAP and the Foxglove protocol name it; ``encoding`` is that of the schema."""

    name: str
    encoding: str
    data: bytes

    @property
    def message_encoding(self) -> str:
        """Encoding of the messages."""
        return "json" if self.encoding == "jsonschema" else self.encoding


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with its schema, the line that explains it, and the number of its finger."""

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


def _json_schema(name: str, properties: dict[str, str]) -> Schema:
    """Make a schema of numbers, texts and switches; a time is ``{sec, nsec}``."""
    kinds: dict[str, dict[str, Any]] = {
        "time": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        "number or null": {"type": ["number", "null"]},
        "arrivals": msgspec.json.schema(Packets)["$defs"]["Packets"]["properties"]["arrivals"],
    }
    described = {key: kinds.get(kind, {"type": kind}) for key, kind in properties.items()}
    schema = {"title": name, "type": "object", "properties": described}
    return Schema(name, "jsonschema", json.dumps(schema).encode())


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
    """Encode a whole number, seven bits a byte (protobuf.dev/programming-guides/encoding).

    >>> _varint(300).hex()
    'ac02'
    """
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])


_FIELD_TYPES = {"int64": 3, "int32": 5, "fixed32": 7, "string": 9, "bytes": 12}
"""By their numbers in ``FieldDescriptorProto.Type``; every other name is that of a message, number 11."""


def _describe(package: str, message: str, fields: Mapping[str, str], imports: Sequence[str] = ()) -> bytes:
    """Return a file of one message as an entry of a ``FileDescriptorSet``, which is several of them joined."""
    described = octets(1, message.encode())
    for number, (name, kind) in enumerate(fields.items(), 1):
        field = octets(1, name.encode()) + integer(3, number) + integer(4, 1) + integer(5, _FIELD_TYPES.get(kind, 11))
        described += octets(2, field if kind in _FIELD_TYPES else field + octets(6, f".{kind}".encode()))
    file = octets(1, f"{package}.{message}.proto".encode()) + octets(2, package.encode())
    file += b"".join(octets(3, f"{other}.proto".encode()) for other in imports)
    return octets(1, file + octets(4, described) + octets(12, b"proto3"))


def _audio(name: str, **further: str) -> Schema:
    time = "google.protobuf.Timestamp"
    fields = {"timestamp": time, "data": "bytes", "format": "string", **further}
    described = _describe("google.protobuf", "Timestamp", {"seconds": "int64", "nanos": "int32"})
    return Schema(f"foxglove.{name}", "protobuf", described + _describe("foxglove", name, fields, [time]))


COMPRESSED_AUDIO = _audio("CompressedAudio")
RAW_AUDIO = _audio("RawAudio", sample_rate="fixed32", number_of_channels="fixed32")

_TEXTS = {"touch": "string", "event": "string"}

RUN = Topic(
    "/tactophone/run",
    _json_schema(
        "tactophone.Run",
        {"role": "string", "settings": "object", "models": "object", "versions": "object",
         "epoch": "number", "fingers": "array"},
    ),
    "how the process was started: settings, hash of the model, versions",
)  # fmt: skip
PACKETS = Topic(
    "/tactophone/packets",
    _json_schema("tactophone.Packets", {"arrivals": "arrivals"}),
    "decrypted packets as they came, in base64, with their arrival times, in s",
)
CONTROLS = Topic(
    "/tactophone/controls",
    _json_schema(
        "tactophone.Controls",
        {"armed": "boolean", "ceiling": "number", "output_level": "number", "limit": "number", "profile": "string",
         "threshold_dbfs": "number or null", "step": "integer"},
    ),
    "what a person changed, in its order among the packets",
)  # fmt: skip
PREDICTION = Topic(
    "/tactophone/prediction",
    _json_schema(
        "tactophone.Prediction",
        {field.name: _TEXTS.get(field.name, "number or null") for field in PREDICTION_FIELDS},
    ),
    "a prediction, and its command as limited; null where there was none",
)
STATE = Topic("/tactophone/state", _json_schema("tactophone.State", {"role": "string"}), "the state at each change")
HEALTH = Topic(
    "/tactophone/health",
    _json_schema("tactophone.Health", {"counters": "object", "gauges": "object"}),
    "counters and gauges, every five seconds",
)
EVENTS = Topic(
    "/tactophone/events",
    _json_schema(
        "foxglove.Log",
        {"timestamp": "time", "level": "integer", "message": "string", "name": "string", "file": "string",
         "line": "integer"},
    ),
    "arming, muting, connections and faults",
)  # fmt: skip
CONTACT_SOUND = Topic("/tactophone/sound/contact", COMPRESSED_AUDIO, "contact microphone, Opus as it came")
AIR_SOUND = Topic("/tactophone/sound/air", COMPRESSED_AUDIO, "air microphone, Opus as it came")
PCM_SOUND = Topic("/tactophone/sound", RAW_AUDIO, "both microphones, 16 bit")

TOPICS = (RUN, PACKETS, CONTROLS, STATE, HEALTH, EVENTS, PREDICTION, CONTACT_SOUND, AIR_SOUND, PCM_SOUND)

SOUND = (CONTACT_SOUND, AIR_SOUND, PCM_SOUND)
"""Topics that a log does not hold, as they follow from its packets (`tactophone.bridges.sound`)."""


@functools.cache
def of_finger(topic: Topic, finger: int, name: str) -> Topic:
    """Return the topic of a finger of a hand; without a name, the topic itself.

    >>> of_finger(PREDICTION, 1, "index").name
    '/tactophone/index/prediction'
    """
    place = topic.name.replace("/tactophone/", f"/tactophone/{name}/")
    return replace(topic, name=place, words=f"{name}: {topic.words}", finger=finger) if name else topic


def topics_of(names: Sequence[str], *, sound: bool) -> tuple[Topic, ...]:
    """Return the topics of a run with fingers of these names; one empty name where there is no hand."""
    each = (PREDICTION, *SOUND) if sound else (PREDICTION,)
    common = [topic for topic in TOPICS if topic not in (PREDICTION, *SOUND)]
    return (*common, *(of_finger(topic, place, name) for place, name in enumerate(names) for topic in each))
