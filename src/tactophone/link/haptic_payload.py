"""A prediction as the vibration that stands for it, in the RTP payload for haptics (RFC 9993).

RFC 9993 carries units of MPEG's haptic stream (MIHS, ISO/IEC 23090-31) behind one byte: dependency (1 bit), unit type
(3 bits) and layer (4 bits). Here each packet has one unit: *temporal* with the vibration of a touch, or *silent*. Every
unit can be decoded without those before it, so a lost packet costs nothing but itself.

The inside of a unit follows the newest field table of MPEG's reference software that could be found
(`IOBinaryFields.h` of MPEGGroup/HapticReferenceSoftware) in the order in which that software writes the fields. It was
checked neither against the ISO text nor with a decoder; `docs/reference/wire-format.md` lists what is missing.
"""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from tactophone.errors import PacketError
from tactophone.link.packet import CLOCK_RATE
from tactophone.types import Prediction, Touch

SMOOTH_HZ, ROUGH_HZ = 120.0, 60.0
"""Ends of the scale of roughness on the wire; frequencies between them by ratio. The paper's stimuli, and part of the
format: a change of the rendering profile must not change them."""

SMOOTH_DBFS = -25.0
"""Amplitude of *smooth*, in dB of that of *rough*; between them linear in dB."""

INTERVAL = 512
"""Duration of a unit in samples of the RTP clock: from one prediction to the next, the paper's buffer at 48 kHz."""

Field = tuple[str, int]
"""Name and bits of a field."""

_PAYLOAD: Sequence[Field] = (("dependent", 1), ("kind", 3), ("layer", 4))
_UNIT: Sequence[Field] = (
    ("unit_type", 6), ("sync", 2), ("unit_layer", 4), ("duration", 24), ("length", 32), ("unit_reserved", 4),
)  # fmt: skip
_DATA: Sequence[Field] = (
    ("packet_type", 6), ("packet_length", 17), ("packet_reserved", 1),
    ("dependent_data", 1), ("perception", 8), ("channel", 16), ("band", 8), ("effects", 16),
    ("effect", 16), ("effect_type", 2), ("semantic", 1), ("position", 25), ("keyframes", 16), ("phase", 16),
    ("base_signal", 4), ("amplitude_and_frequency", 2), ("amplitude", 8), ("keyframe_position", 16), ("frequency", 16),
    ("padding", 5),
)  # fmt: skip
_DATA_PACKET = 5
_PACKET_HEADER = 3  # bytes
_AMPLITUDE_STEPS = 255  # of -1 to 1


class UnitType(enum.IntEnum):
    """Unit types of RFC 9993, section 5.2; only temporal and silent units are sent and taken."""

    INITIALIZATION = 1
    TEMPORAL = 2
    SPATIAL = 3
    SILENT = 4


@dataclass(frozen=True, slots=True)
class Vibration:
    """What a temporal unit contains: amplitude from 0 to 1, frequency in Hz."""

    amplitude: float
    frequency: float


def is_silent(content: bytes) -> bool:
    """Return whether a payload is a silent unit; the first packet after silence has RTP's marker."""
    return content[0] >> 4 & 7 == UnitType.SILENT


def write_haptics(prediction: Prediction) -> bytes:
    """Encode a prediction as a payload that begins at the end of its window; faults are silence.

    >>> write_haptics(Prediction((0.0, 0.0, 1.0), Touch.ROUGH, 1.0, -20.0, 0.0, 0.256)).hex(" ", 1)[:29]
    '20 04 00 00 20 00 00 00 01 90'
    >>> write_haptics(Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -60.0, 0.0, 0.256)).hex(" ")
    '40 0c 00 00 20 00 00 00 00 00'
    """
    if prediction.touch is Touch.NONE or prediction.faulty or not math.isfinite(prediction.roughness):
        return _write(UnitType.SILENT, b"")
    roughness = max(0.0, min(prediction.roughness, 1.0))
    amplitude = 10 ** (SMOOTH_DBFS * (1 - roughness) / 20)
    vibration = Vibration(amplitude, SMOOTH_HZ * (ROUGH_HZ / SMOOTH_HZ) ** roughness)
    # A decoder adds the keyframes of an effect whose number it knows to that effect, so each has a number of its own.
    return _write(UnitType.TEMPORAL, _effect(vibration, round(prediction.end * CLOCK_RATE) // INTERVAL % (1 << 16)))


def read_vibration(content: bytes) -> Vibration | None:
    """Decode a payload; ``None`` is silence.

    Raises `PacketError` when it is no temporal or silent unit, or holds anything but one vibration.
    """
    header = _read(_PAYLOAD, content[:1])
    unit = _read(_UNIT, content[1 : 1 + _size(_UNIT)])
    body = content[1 + _size(_UNIT) :]
    if header["kind"] not in (UnitType.TEMPORAL, UnitType.SILENT) or unit["unit_type"] != header["kind"] - 1:
        raise PacketError(f"a haptic unit of type {header['kind']}, but only temporal and silent ones (2, 4) are taken")
    if header["dependent"] or unit["length"] != len(body):
        raise PacketError(f"a haptic unit of {len(body)} bytes that states {unit['length']}, or needs earlier ones")
    if header["kind"] == UnitType.SILENT:
        return None
    effect = _read(_DATA, body)
    if (effect["packet_type"], effect["effects"], effect["keyframes"]) != (_DATA_PACKET, 1, 1):
        raise PacketError("a temporal haptic unit with anything but one keyframe of one effect")
    amplitude = 2 * effect["amplitude"] / _AMPLITUDE_STEPS - 1
    return Vibration(max(0.0, amplitude), float(effect["frequency"]))


def read_haptics(content: bytes, *, end: float) -> Prediction:
    """Decode a payload that begins at ``end`` seconds as a prediction; its level is unknown, -inf.

    Raises
    ------
    PacketError
        As `read_vibration`.
    """
    vibration, start = read_vibration(content), end - INTERVAL / CLOCK_RATE
    if vibration is None or vibration.amplitude == 0 or vibration.frequency == 0:
        return Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, start, end)
    # The frequency has finer steps than the amplitude: 61 against 8 in the lower half of the scale.
    ratio = math.log(vibration.frequency / SMOOTH_HZ) / math.log(ROUGH_HZ / SMOOTH_HZ)
    roughness = max(0.0, min(ratio, 1.0))
    touch = Touch.ROUGH if roughness >= 0.5 else Touch.SMOOTH
    return Prediction((0.0, 1 - roughness, roughness), touch, roughness, -math.inf, start, end)


def _effect(vibration: Vibration, number: int) -> bytes:
    amplitude = round((vibration.amplitude + 1) / 2 * _AMPLITUDE_STEPS)
    values = {
        "packet_type": _DATA_PACKET, "packet_length": _size(_DATA) - _PACKET_HEADER, "effects": 1, "effect": number,
        "keyframes": 1, "amplitude_and_frequency": 3, "amplitude": amplitude, "frequency": round(vibration.frequency),
    }  # fmt: skip
    return _pack(_DATA, values)


def _write(kind: UnitType, body: bytes) -> bytes:
    unit = {"unit_type": kind - 1, "duration": INTERVAL, "length": len(body)}
    return _pack(_PAYLOAD, {"kind": kind}) + _pack(_UNIT, unit) + body


def _pack(fields: Sequence[Field], values: dict[str, int]) -> bytes:
    """Write fields one after another, the most significant bit first; a field without a value is 0."""
    number = 0
    for name, bits in fields:
        number = number << bits | values.get(name, 0)
    return number.to_bytes(_size(fields), "big")


def _read(fields: Sequence[Field], content: bytes) -> dict[str, int]:
    if len(content) != _size(fields):
        raise PacketError(f"{len(content)} bytes of a haptic unit where {_size(fields)} are due")
    number, values = int.from_bytes(content, "big"), {}
    for name, bits in reversed(fields):
        number, values[name] = number >> bits, number & (1 << bits) - 1
    return values


def _size(fields: Sequence[Field]) -> int:
    return sum(bits for _, bits in fields) // 8
