"""ROS 2's messages as DDS types, so that no ROS installation is needed.

A type ``std_msgs/msg/Float32`` is ``std_msgs::msg::dds_::Float32_`` on the wire, and a topic ``/name`` is ``rt/name``
(ROS 2 design, "Topic and Service name mapping to DDS"). Fields and their order are those of ROS 2 Humble to Kilted.
"""

from dataclasses import dataclass, field

from cyclonedds.idl import IdlStruct, types


def _name(package: str, message: str) -> str:
    return f"{package}::msg::dds_::{message}_"


@dataclass
class Time(IdlStruct, typename=_name("builtin_interfaces", "Time")):
    """Seconds and nanoseconds since 1970."""

    sec: types.int32 = 0
    nanosec: types.uint32 = 0


@dataclass
class Header(IdlStruct, typename=_name("std_msgs", "Header")):
    """Time and frame."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Empty(IdlStruct, typename=_name("std_msgs", "Empty")):
    """Nothing; DDS needs a member."""

    structure_needs_at_least_one_member: types.uint8 = 0


@dataclass
class Float32(IdlStruct, typename=_name("std_msgs", "Float32")):
    """One number."""

    data: types.float32 = 0.0


@dataclass
class Dimension(IdlStruct, typename=_name("std_msgs", "MultiArrayDimension")):
    """One axis of an array."""

    label: str = ""
    size: types.uint32 = 0
    stride: types.uint32 = 0


@dataclass
class Layout(IdlStruct, typename=_name("std_msgs", "MultiArrayLayout")):
    """Axes of an array."""

    dim: types.sequence[Dimension] = field(default_factory=list)
    data_offset: types.uint32 = 0


@dataclass
class Float32MultiArray(IdlStruct, typename=_name("std_msgs", "Float32MultiArray")):
    """Numbers."""

    layout: Layout = field(default_factory=Layout)
    data: types.sequence[types.float32] = field(default_factory=list)


@dataclass
class Float64MultiArray(IdlStruct, typename=_name("std_msgs", "Float64MultiArray")):
    """Numbers in double precision."""

    layout: Layout = field(default_factory=Layout)
    data: types.sequence[types.float64] = field(default_factory=list)


@dataclass
class KeyValue(IdlStruct, typename=_name("diagnostic_msgs", "KeyValue")):
    """A name and its value."""

    key: str = ""
    value: str = ""


@dataclass
class DiagnosticStatus(IdlStruct, typename=_name("diagnostic_msgs", "DiagnosticStatus")):
    """State of a part: level 0 is OK, 1 a warning, 2 an error."""

    level: types.uint8 = 0
    name: str = ""
    message: str = ""
    hardware_id: str = ""
    values: types.sequence[KeyValue] = field(default_factory=list)


@dataclass
class DiagnosticArray(IdlStruct, typename=_name("diagnostic_msgs", "DiagnosticArray")):
    """States of parts."""

    header: Header = field(default_factory=Header)
    status: types.sequence[DiagnosticStatus] = field(default_factory=list)


@dataclass
class AudioData(IdlStruct, typename=_name("audio_common_msgs", "AudioData")):
    """Samples as bytes."""

    data: types.sequence[types.uint8] = field(default_factory=list)


@dataclass
class AudioDataStamped(IdlStruct, typename=_name("audio_common_msgs", "AudioDataStamped")):
    """Samples as bytes, with the time of the first."""

    header: Header = field(default_factory=Header)
    audio: AudioData = field(default_factory=AudioData)


@dataclass
class AudioInfo(IdlStruct, typename=_name("audio_common_msgs", "AudioInfo")):
    """What the bytes are; published once, for late subscribers too."""

    channels: types.uint8 = 0
    sample_rate: types.uint32 = 0
    sample_format: str = ""
    bitrate: types.uint32 = 0
    coding_format: str = ""


@dataclass
class JoyFeedback(IdlStruct, typename=_name("sensor_msgs", "JoyFeedback")):
    """Feedback of a gamepad: type 1 is rumble, intensity 0 to 1."""

    type: types.uint8 = 0
    id: types.uint8 = 0
    intensity: types.float32 = 0.0


@dataclass
class TactorGroupState(IdlStruct, typename=_name("haptx_interfaces", "TactorGroupState")):
    """Groups of a HaptX glove's tactors by name, and the share of full inflation of each, 0 to 1."""

    tactor_group: types.sequence[str] = field(default_factory=list)
    inflation: types.sequence[types.float64] = field(default_factory=list)


@dataclass
class ManusVibrationCommand(IdlStruct, typename=_name("manus_ros2_msgs", "ManusVibrationCommand")):
    """Intensities of a MANUS glove, thumb to little finger, 0 to 1."""

    intensities: types.array[types.float32, 5] = field(default_factory=lambda: [0.0] * 5)
