"""The topics and messages of ROS 2 as DDS types, without a ROS installation; and how
predictions become messages.

A type ``std_msgs/msg/Float32`` is ``std_msgs::msg::dds_::Float32_`` on the wire, and a
topic ``/name`` is ``rt/name`` (ROS 2 design, "Topic and Service name mapping to DDS").
Fields and their order match ROS 2 Humble to Kilted.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import new_class
from typing import Any

import numpy as np
from cyclonedds.idl import IdlStruct, types

from tactophone.core import plugins
from tactophone.core.errors import ConfigError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.types import FINGER_NAMES, LIVE_SAMPLE_RATE, FloatArray
from tactophone.live.log.reader import Passed

LARGEST_SAMPLE = 1 << 20
"""Bytes of a message at most, 5 s of sound. DDS passes up to 2 GB, for which Python
takes 16 times as much memory, and a second for 20 MB."""

_DEFINITIONS: dict[str, str] = {}
_TYPES: dict[str, Any] = {
    name: getattr(types, name)
    for name in ("uint8", "int32", "uint32", "float32", "float64")
}
_TYPES["string"] = str
# Every message's definition by its full name, and every type by its name in
# definitions; `_message` adds to both.


def message_type(name: str, definition: str) -> Any:
    """Return the DDS type of a message, whose fields are a line each, as in a file
    ``.msg``; they default to zero."""
    namespace: dict[str, Any] = {"__annotations__": {}}
    for kind, key in map(str.split, definition.splitlines()):
        base, bracket, length = kind.rstrip("]").partition("[")
        made = _TYPES[base]
        # What makes the default: a number's type, or the field's own.
        zero: Any = float if "float" in base else int
        if base == "string" or "/" in base:
            zero = made
        if bracket:
            made = types.array[made, int(length)] if length else types.sequence[made]
            zero = partial(list, [zero()] * int(length or 0))
        namespace["__annotations__"][key] = made
        namespace[key] = field(default_factory=zero)
    package, _, short = name.split("/")
    wire = {"typename": f"{package}::msg::dds_::{short}_"}
    _DEFINITIONS[name] = definition
    _TYPES[f"{package}/{short}"] = dataclass(
        new_class(short, (IdlStruct,), wire, lambda own: own.update(namespace))
    )
    return _TYPES[f"{package}/{short}"]


Time = message_type("builtin_interfaces/msg/Time", "int32 sec\nuint32 nanosec")
Header = message_type(
    "std_msgs/msg/Header", "builtin_interfaces/Time stamp\nstring frame_id"
)
# Empty in ROS; a structure of DDS needs a member.
Empty = message_type("std_msgs/msg/Empty", "uint8 structure_needs_at_least_one_member")
Float32 = message_type("std_msgs/msg/Float32", "float32 data")
Dimension = message_type(
    "std_msgs/msg/MultiArrayDimension", "string label\nuint32 size\nuint32 stride"
)
Layout = message_type(
    "std_msgs/msg/MultiArrayLayout",
    "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset",
)
Float32MultiArray = message_type(
    "std_msgs/msg/Float32MultiArray", "std_msgs/MultiArrayLayout layout\nfloat32[] data"
)
Float64MultiArray = message_type(
    "std_msgs/msg/Float64MultiArray", "std_msgs/MultiArrayLayout layout\nfloat64[] data"
)
KeyValue = message_type("diagnostic_msgs/msg/KeyValue", "string key\nstring value")
DiagnosticStatus = message_type(  # level 0 is OK, 1 a warning, 2 an error
    "diagnostic_msgs/msg/DiagnosticStatus",
    "uint8 level\nstring name\nstring message\nstring "
    "hardware_id\ndiagnostic_msgs/KeyValue[] values",
)
DiagnosticArray = message_type(
    "diagnostic_msgs/msg/DiagnosticArray",
    "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
)
AudioData = message_type("audio_common_msgs/msg/AudioData", "uint8[] data")
AudioDataStamped = message_type(
    "audio_common_msgs/msg/AudioDataStamped",
    "std_msgs/Header header\naudio_common_msgs/AudioData audio",
)
AudioInfo = message_type(
    "audio_common_msgs/msg/AudioInfo",
    "uint8 channels\nuint32 sample_rate\nstring sample_format\nuint32 bitrate\nstring "
    "coding_format",
)
JointState = message_type(
    "sensor_msgs/msg/JointState",
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] "
    "velocity\nfloat64[] effort",
)
# Type 1 is rumble (`_RUMBLE`).
JoyFeedback = message_type(
    "sensor_msgs/msg/JoyFeedback", "uint8 type\nuint8 id\nfloat32 intensity"
)
# A prediction and its command with their times: ros/tactophone_msgs/msg/Prediction.msg
# explains each field.
StampedPrediction = message_type(
    "tactophone_msgs/msg/Prediction",
    "std_msgs/Header header\nbuiltin_interfaces/Time made\nbuiltin_interfaces/Time "
    "rendered\nuint8 touch\n"
    "float32[3] probabilities\nfloat32 roughness\nfloat32 level_dbfs\nfloat32 "
    "amplitude\nfloat32 frequency\n"
    "string event",
)

PUBLISHED: dict[str, Any] = {
    "touch": StampedPrediction,
    "prediction": Float32MultiArray,
    "vibration": Float32MultiArray,
    "roughness": Float32,
    "contact_dbfs": Float32,
    "audio": AudioDataStamped,
}
"""Topics of a finger, under ``/tactophone/<finger>/``, without the latched
``audio_info``."""

INFO = AudioInfo(2, LIVE_SAMPLE_RATE, "S16LE", 0, "wave")


def predicted(passed: Passed) -> dict[str, Any]:
    """Return the messages of a prediction and its command, by the topics of
    `PUBLISHED`."""
    prediction = passed.prediction
    command = passed.command
    roughness = passed.roughness
    level_dbfs = max(prediction.level_dbfs, _LOWEST_DBFS)
    return {
        "touch": StampedPrediction(
            header(passed.sound, passed.finger),
            time_of(passed.made),
            time_of(passed.rendered),
            prediction.touch,
            list(prediction.probabilities),
            roughness,
            level_dbfs,
            command.amplitude,
            command.frequency,
            prediction.events[-1].kind if prediction.events else "",
        ),
        "prediction": Float32MultiArray(data=list(prediction.probabilities)),
        "vibration": Float32MultiArray(data=[command.amplitude, command.frequency]),
        "roughness": Float32(roughness),
        "contact_dbfs": Float32(level_dbfs),
    }


def sound(samples: FloatArray, now: float) -> Any:
    """Return sound, shape ``(samples, 1 or 2)``, whose first sample was taken at
    ``now`` (s since 1970)."""
    every = (
        samples
        if samples.shape[1] > 1
        else np.repeat(samples, len(MICROPHONES), axis=1)
    )
    data = (np.clip(every, -1, 1) * 32_767).astype("<i2").tobytes()
    return AudioDataStamped(header(now), AudioData(data=list(data)))


def header(now: float, frame: str = "fingertip") -> Any:
    """Return the header of a message stamped ``now`` (s since 1970)."""
    return Header(time_of(now), frame)


def time_of(now: float) -> Any:
    """Return a time in s since 1970; 0 for one that is not known, or that ROS has no
    number for."""
    return Time(int(now), int(now % 1 * 1e9)) if 0 <= now < _LATEST else Time()


_LATEST = 1 << 31
"""Seconds since 1970 at which ROS's 32 bits end, in 2038."""

_LOWEST_DBFS = -200.0
"""What stands for a level of -inf dBFS: plots and JSON cannot show infinity."""


def open_type_store() -> Any:
    """Return the types of all messages here, with their serialization and RIHS01
    hashes."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    # The store knows ROS's own messages; ours and other packages' are added.
    for name in _DEFINITIONS.keys() - store.fielddefs.keys():
        store.register(get_types_from_msg(_DEFINITIONS[name], name))
    return store


def type_name(kind: type) -> str:
    """Return the name that ROS gives a type.

    >>> type_name(Float32)
    'std_msgs/msg/Float32'
    """
    package, _, message = str(kind.__idl_typename__).replace(".", "::").split("::", 2)  # type: ignore[attr-defined]
    return f"{package}/msg/{message.removeprefix('dds_::').removesuffix('_')}"


_SENSEGLOVE_VALUES = 12
"""Values in a SenseGlove's message: brakes of thumb to little finger, vibration of
their tips, then vibration of two places of the palm
(github.com/Adjuvo/senseglove_ros/issues/47). A Nova 2 only has the tips of thumb and
index."""

_SENSEGLOVE_TIPS = 5
"""Place of the thumb's tip among these values."""

_RUMBLE = 1
"""Type of a ``sensor_msgs/JoyFeedback`` that vibrates."""

TOPIC_HEARTBEAT = 0.01
"""Per cent that the SenseGlove's value alternates by: its driver does not send an equal
value again."""


@dataclass(frozen=True, slots=True)
class Sink:
    """A device of ROS that takes amplitudes *as limited*, 0 to 1 of full drive.

    Its topic, its type, and how the amplitudes of the fingers become its message;
    ``beat`` counts the messages.
    """

    topic: str
    kind: type
    make: Callable[[Mapping[str, float], int], Any]


def open_sinks(text: str, *, fingers: Sequence[str]) -> list[Sink]:
    """Return the sinks of ``KIND`` or ``KIND:TOPIC``: one, or for plain numbers one for
    each finger.

    Raises `ConfigError` for an unknown kind, or if the glove does not know the name of
    a finger.
    """
    kind, _, topic = text.partition(":")
    make = _SINKS.get(kind) or plugins.load(plugins.ROS_SINKS, kind)
    if make is None:
        known = ", ".join([*_SINKS, *plugins.registered(plugins.ROS_SINKS)])
        raise ConfigError(
            f"bridges.ros_sinks {text}: there are {known}; write KIND or KIND:/topic"
        )
    strange = [finger for finger in fingers if finger not in FINGER_NAMES]
    if kind not in ("joy", "float32") and strange:
        raise ConfigError(
            f"bridges.ros_sinks {text}: a glove has {', '.join(FINGER_NAMES)}, and no "
            f"{strange[0]!r}"
        )
    sinks = [
        make(own)
        for own in (
            [[finger] for finger in fingers] if kind == "float32" else [fingers]
        )
    ]
    if topic and len(sinks) > 1:
        raise ConfigError(
            f"bridges.ros_sinks {text}: {len(sinks)} fingers cannot share a topic of "
            "one number; leave :TOPIC out"
        )
    return [
        Sink((topic or sink.topic).lstrip("/"), sink.kind, sink.make) for sink in sinks
    ]


def _joy(fingers: Sequence[str]) -> Sink:
    return Sink(
        "joy/set_feedback",
        JoyFeedback,
        # One rumble for all: it follows the finger that vibrates most.
        lambda amplitudes, beat: JoyFeedback(
            type=_RUMBLE, id=0, intensity=max(amplitudes.values())
        ),
    )


def _senseglove(fingers: Sequence[str]) -> Sink:
    def make(amplitudes: Mapping[str, float], beat: int) -> Any:
        values = [0.0] * _SENSEGLOVE_VALUES
        for finger, amplitude in amplitudes.items():
            # Below its highest value, so that the heartbeat adds nothing to full drive;
            # silence stays silence.
            value = (
                max(0.0, 100 * amplitude - TOPIC_HEARTBEAT * (beat % 2))
                if amplitude
                else 0.0
            )
            values[_SENSEGLOVE_TIPS + FINGER_NAMES.index(finger)] = value
        return Float64MultiArray(data=values)

    return Sink("haptics_controller/commands", Float64MultiArray, make)


def _float32(fingers: Sequence[str]) -> Sink:
    (finger,) = fingers
    return Sink(
        f"tactophone/{finger}/amplitude",
        Float32,
        lambda amplitudes, beat: Float32(data=amplitudes[finger]),
    )


_SINKS: dict[str, Callable[[Sequence[str]], Sink]] = {
    "joy": _joy,
    "senseglove": _senseglove,
    "float32": _float32,
}
