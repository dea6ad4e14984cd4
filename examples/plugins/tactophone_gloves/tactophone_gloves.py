"""MANUS and HaptX gloves on ROS 2, as a plug-in: pip install
examples/plugins/tactophone_gloves

    tactophone receive --bridge ros --set bridges.ros_sinks=manus

Neither was tried on a glove. A HaptX glove inflates slowly: it shows strength, not
vibration.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from tactophone.core.hand import FINGER_NAMES
from tactophone.faces.bridges.ros_topics import Sink, message_type

# Intensities of a MANUS glove, thumb to little finger, 0 to 1.
ManusVibrationCommand = message_type(
    "manus_ros2_msgs/msg/ManusVibrationCommand", "float32[5] intensities"
)
# Groups of a HaptX glove's tactors by name, and the share of full inflation of each, 0
# to 1.
TactorGroupState = message_type(
    "haptx_interfaces/msg/TactorGroupState",
    "string[] tactor_group\nfloat64[] inflation",
)

HAPTX_FINGERS = ("th", "ff", "mf", "rf", "lf")
"""Names of tactor groups, in the order of `FINGER_NAMES`
(github.com/NU-Haptics-Lab/haptx_interfaces)."""


def manus(fingers: Sequence[str]) -> Sink:
    """Vibrate each fingertip of a MANUS glove."""

    def make(amplitudes: Mapping[str, float], beat: int) -> Any:
        return ManusVibrationCommand(
            intensities=[amplitudes.get(finger, 0.0) for finger in FINGER_NAMES]
        )

    return Sink("manus_glove_0/vibration_cmd", ManusVibrationCommand, make)


def haptx(fingers: Sequence[str], hand: str = "rh") -> Sink:
    """Inflate the tactors of each fingertip of a right HaptX glove."""
    groups = [
        f"{hand}_{HAPTX_FINGERS[FINGER_NAMES.index(finger)]}" for finger in fingers
    ]

    def make(amplitudes: Mapping[str, float], beat: int) -> Any:
        return TactorGroupState(
            tactor_group=groups, inflation=[amplitudes[finger] for finger in fingers]
        )

    return Sink(f"haptx/{hand}/tactor_group_state", TactorGroupState, make)


def haptx_left(fingers: Sequence[str]) -> Sink:
    """Inflate the tactors of a left HaptX glove."""
    return haptx(fingers, "lh")
