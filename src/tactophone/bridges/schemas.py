"""The topics that a log and a live view show, each with its schema.

Numbers and events are JSON, which every viewer plots; sound is protobuf in Foxglove's own schemas, which its Audio
panel plays; the received packets are protobuf of our own.
"""

import functools
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tactophone.bridges.protobuf import FieldType, MessageType, describe_file

_TIMESTAMP = "google.protobuf.Timestamp"

_TIME_FILE = describe_file(
    "google.protobuf", [MessageType("Timestamp", (FieldType("seconds", "int64"), FieldType("nanos", "int32")))]
)


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
    """A topic with its schema, the line that explains it, and whose it is of a hand."""

    name: str
    schema: Schema
    words: str
    finger: int = 0

    @property
    def kind(self) -> str:
        """The end of its name, which is the same for every finger of a hand."""
        return self.name.rpartition("/")[2]


def _json_schema(name: str, properties: dict[str, str]) -> Schema:
    """Make a schema of numbers, texts and switches; a time is ``{sec, nsec}``."""
    kinds: dict[str, dict[str, Any]] = {
        "time": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        "number or null": {"type": ["number", "null"]},
    }
    described = {key: kinds.get(kind, {"type": kind}) for key, kind in properties.items()}
    schema = {"title": name, "type": "object", "properties": described}
    return Schema(name, "jsonschema", json.dumps(schema).encode())


def _audio(name: str, *fields: FieldType) -> Schema:
    message = MessageType(name, (FieldType("timestamp", _TIMESTAMP), FieldType("data", "bytes"), *fields))
    described = describe_file("foxglove", [message], imports=["google.protobuf"])
    return Schema(f"foxglove.{name}", "protobuf", _TIME_FILE + described)


def _own(message: MessageType, *parts: MessageType) -> Schema:
    """Make a schema of this program, of a message and those that it contains."""
    return Schema(f"tactophone.{message.name}", "protobuf", describe_file("tactophone", [*parts, message]))


_NUMBERS = dict.fromkeys(
    ("window_end", "window", "delay", "none", "smooth", "rough", "level_dbfs", "roughness", "frequency", "amplitude"),
    "number",
)  # fmt: skip

COMPRESSED_AUDIO = _audio("CompressedAudio", FieldType("format", "string"))
RAW_AUDIO = _audio(
    "RawAudio",
    FieldType("format", "string"),
    FieldType("sample_rate", "fixed32"),
    FieldType("number_of_channels", "fixed32"),
)
_ARRIVAL = MessageType(
    "EventBatch",
    (
        FieldType("time", "double"),
        FieldType("polled", "bool"),
        FieldType("events", "bytes", repeated=True),
        FieldType("count", "int64"),
    ),
)
_PACKETS = _own(
    MessageType(
        "Packets",
        (FieldType("arrivals", "tactophone.EventBatch", repeated=True), FieldType("base", "int64"),
         FieldType("step", "int64"), FieldType("delays", "sint64", repeated=True)),
    ),
    _ARRIVAL,
)  # fmt: skip

PREDICTION_COLUMNS = MessageType(
    "Predictions",
    (
        *(FieldType(name, "sint64", repeated=True) for name in (*_NUMBERS, "touch")),
        FieldType("check", "bytes"),
        FieldType("event_rows", "int64", repeated=True),
        FieldType("event_kinds", "string", repeated=True),
        FieldType("event_times", "double", repeated=True),
    ),
)

RUN = Topic(
    "/tactophone/run",
    _json_schema(
        "tactophone.Run",
        {"role": "string", "settings": "object", "models": "object", "versions": "object",
         "calibration": "string", "epoch": "number"},
    ),
    "how the process was started: settings, hash of the model, versions",
)  # fmt: skip
PACKETS = Topic("/tactophone/packets", _PACKETS, "decrypted packets with their arrival times, in s")
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
        {**_NUMBERS, "touch": "string", "contact": "number", "event": "string", "event_time": "number"},
    ),
    "a prediction, and its command as limited; null where there was none",
)
PREDICTIONS = Topic(
    "/tactophone/predictions", _own(PREDICTION_COLUMNS), "each prediction and command, in columns of differences"
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

OF_FINGER = (PREDICTION, PREDICTIONS, CONTACT_SOUND, AIR_SOUND, PCM_SOUND)
"""Of these, each finger of a hand has its own (`of_finger`)."""

TOPICS = (RUN, PACKETS, CONTROLS, PREDICTION, PREDICTIONS, STATE, HEALTH, EVENTS, CONTACT_SOUND, AIR_SOUND, PCM_SOUND)


@functools.cache
def of_finger(topic: Topic, finger: int, name: str) -> Topic:
    """Return the topic of a finger of a hand; without a name, the topic itself.

    >>> of_finger(PREDICTION, 1, "index").name
    '/tactophone/index/prediction'
    """
    place = topic.name.replace("/tactophone/", f"/tactophone/{name}/")
    return replace(topic, name=place, words=f"{name}: {topic.words}", finger=finger) if name else topic


def topics_of(names: Sequence[str]) -> tuple[Topic, ...]:
    """Return the topics of a run with fingers of these names; one empty name where there is no hand."""
    common = [topic for topic in TOPICS if topic not in OF_FINGER]
    fingers = enumerate(names)
    return (*common, *(of_finger(topic, place, name) for place, name in fingers for topic in OF_FINGER))
