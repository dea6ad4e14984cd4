"""Devices of ROS 2 that the vibration drives; each takes amplitudes *as limited*, 0 to 1 of full drive."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from tactophone.bridges.ros import messages
from tactophone.errors import ConfigError

FINGERS = ("thumb", "index", "middle", "ring", "pinky")

_SENSEGLOVE_VALUES = 12
# The order of the values (github.com/Adjuvo/senseglove_ros/issues/47): brakes of thumb to pinky, vibration of their
# tips, then of two places of the palm. A Nova 2 has tips of thumb and index only.
_SENSEGLOVE_TIPS = 5

_HAPTX_FINGERS = ("th", "ff", "mf", "rf", "lf")
# Names of a HaptX glove's tactor groups, in the order of FINGERS (github.com/NU-Haptics-Lab/haptx_interfaces).

_RUMBLE = 1

HEARTBEAT = 0.01
"""Per cent that the SenseGlove's value alternates by: its driver does not send an equal value again."""


@dataclass(frozen=True, slots=True)
class Sink:
    """A topic, its type, and how an amplitude becomes its message; ``beat`` counts the messages."""

    topic: str
    kind: type
    make: Callable[[float, int], Any]


def open_sink(text: str, *, finger: str) -> Sink:
    """Return the sink of ``KIND`` or ``KIND:TOPIC``.

    Raises
    ------
    ConfigError
        If there is none of that kind, or the finger has no name that the glove knows.
    """
    kind, _, topic = text.partition(":")
    if kind not in _SINKS:
        raise ConfigError(f"--ros-sink {text}: there are {', '.join(_SINKS)}; write KIND or KIND:/topic")
    if kind not in ("joy", "float32") and finger not in FINGERS:
        raise ConfigError(f"--finger {finger}: a glove has {', '.join(FINGERS)}")
    sink = _SINKS[kind](finger)
    return Sink((topic or sink.topic).lstrip("/"), sink.kind, sink.make)


def _joy(finger: str) -> Sink:
    return Sink(
        "joy/set_feedback", messages.JoyFeedback,
        lambda amplitude, beat: messages.JoyFeedback(type=_RUMBLE, id=0, intensity=amplitude),
    )  # fmt: skip


def _senseglove(finger: str) -> Sink:
    place = _SENSEGLOVE_TIPS + FINGERS.index(finger)

    def make(amplitude: float, beat: int) -> Any:
        values = [0.0] * _SENSEGLOVE_VALUES
        # Below its highest value, so that the heartbeat adds nothing to full drive; silence stays silence.
        values[place] = max(0.0, 100 * amplitude - HEARTBEAT * (beat % 2)) if amplitude else 0.0
        return messages.Float64MultiArray(data=values)

    return Sink("haptics_controller/commands", messages.Float64MultiArray, make)


def _manus(finger: str) -> Sink:
    place = FINGERS.index(finger)

    def make(amplitude: float, beat: int) -> Any:
        return messages.ManusVibrationCommand(
            intensities=[amplitude if number == place else 0.0 for number in range(len(FINGERS))]
        )

    return Sink("manus_glove_0/vibration_cmd", messages.ManusVibrationCommand, make)


def _haptx(hand: str, finger: str) -> Sink:
    group = f"{hand}_{_HAPTX_FINGERS[FINGERS.index(finger)]}"
    return Sink(
        f"haptx/{hand}/tactor_group_state", messages.TactorGroupState,
        lambda amplitude, beat: messages.TactorGroupState(tactor_group=[group], inflation=[amplitude]),
    )  # fmt: skip


def _float32(finger: str) -> Sink:
    return Sink(
        f"tactophone/{finger}/amplitude", messages.Float32,
        lambda amplitude, beat: messages.Float32(data=amplitude),
    )  # fmt: skip


_SINKS: dict[str, Callable[[str], Sink]] = {
    "joy": _joy,
    "senseglove": _senseglove,
    "manus": _manus,
    "haptx": partial(_haptx, "rh"),
    "haptx-left": partial(_haptx, "lh"),
    "float32": _float32,
}
