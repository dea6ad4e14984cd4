"""Devices of ROS 2 that the vibration drives; each takes amplitudes *as limited*, 0 to 1 of full drive."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from tactophone.bridges.ros import messages
from tactophone.errors import ConfigError
from tactophone.types import FINGER_NAMES

_SENSEGLOVE_VALUES = 12
# The order of the values (github.com/Adjuvo/senseglove_ros/issues/47): brakes of thumb to little finger, vibration of
# their tips, then of two places of the palm. A Nova 2 has tips of thumb and index only.
_SENSEGLOVE_TIPS = 5

_HAPTX_FINGERS = ("th", "ff", "mf", "rf", "lf")
# Names of a HaptX glove's tactor groups, in the order of FINGER_NAMES (github.com/NU-Haptics-Lab/haptx_interfaces).

_RUMBLE = 1

HEARTBEAT = 0.01
"""Per cent that the SenseGlove's value alternates by: its driver does not send an equal value again."""


@dataclass(frozen=True, slots=True)
class Sink:
    """A topic, its type, and how the fingers' amplitudes become its message; ``beat`` counts the messages."""

    topic: str
    kind: type
    make: Callable[[Mapping[str, float], int], Any]


def open_sinks(text: str, *, fingers: Sequence[str]) -> list[Sink]:
    """Return the sinks of ``KIND`` or ``KIND:TOPIC``: one, or for plain numbers one for each finger.

    Raises `ConfigError` if there is none of that kind, or a finger has no name that the glove knows.
    """
    kind, _, topic = text.partition(":")
    if kind not in _SINKS:
        raise ConfigError(f"--ros-sink {text}: there are {', '.join(_SINKS)}; write KIND or KIND:/topic")
    strange = [finger for finger in fingers if finger not in FINGER_NAMES]
    if kind not in ("joy", "float32") and strange:
        raise ConfigError(f"--ros-sink {text}: a glove has {', '.join(FINGER_NAMES)}, and no {strange[0]!r}")
    sinks = [_SINKS[kind](own) for own in ([[finger] for finger in fingers] if kind == "float32" else [fingers])]
    if topic and len(sinks) > 1:
        raise ConfigError(
            f"--ros-sink {text}: {len(sinks)} fingers cannot share a topic of one number; leave :TOPIC out"
        )
    return [Sink((topic or sink.topic).lstrip("/"), sink.kind, sink.make) for sink in sinks]


def _joy(fingers: Sequence[str]) -> Sink:
    return Sink(
        "joy/set_feedback", messages.JoyFeedback,
        # One rumble for all: it follows the finger that vibrates most.
        lambda amplitudes, beat: messages.JoyFeedback(type=_RUMBLE, id=0, intensity=max(amplitudes.values())),
    )  # fmt: skip


def _senseglove(fingers: Sequence[str]) -> Sink:
    def make(amplitudes: Mapping[str, float], beat: int) -> Any:
        values = [0.0] * _SENSEGLOVE_VALUES
        for finger, amplitude in amplitudes.items():
            # Below its highest value, so that the heartbeat adds nothing to full drive; silence stays silence.
            value = max(0.0, 100 * amplitude - HEARTBEAT * (beat % 2)) if amplitude else 0.0
            values[_SENSEGLOVE_TIPS + FINGER_NAMES.index(finger)] = value
        return messages.Float64MultiArray(data=values)

    return Sink("haptics_controller/commands", messages.Float64MultiArray, make)


def _manus(fingers: Sequence[str]) -> Sink:
    return Sink(
        "manus_glove_0/vibration_cmd", messages.ManusVibrationCommand,
        lambda amplitudes, beat: messages.ManusVibrationCommand(
            intensities=[amplitudes.get(finger, 0.0) for finger in FINGER_NAMES]
        ),
    )  # fmt: skip


def _haptx(hand: str, fingers: Sequence[str]) -> Sink:
    groups = [f"{hand}_{_HAPTX_FINGERS[FINGER_NAMES.index(finger)]}" for finger in fingers]
    return Sink(
        f"haptx/{hand}/tactor_group_state", messages.TactorGroupState,
        lambda amplitudes, beat: messages.TactorGroupState(
            tactor_group=groups, inflation=[amplitudes[finger] for finger in fingers]
        ),
    )  # fmt: skip


def _float32(fingers: Sequence[str]) -> Sink:
    (finger,) = fingers
    return Sink(
        f"tactophone/{finger}/amplitude", messages.Float32,
        lambda amplitudes, beat: messages.Float32(data=amplitudes[finger]),
    )  # fmt: skip


_SINKS: dict[str, Callable[[Sequence[str]], Sink]] = {
    "joy": _joy,
    "senseglove": _senseglove,
    "manus": _manus,
    "haptx": partial(_haptx, "rh"),
    "haptx-left": partial(_haptx, "lh"),
    "float32": _float32,
}
