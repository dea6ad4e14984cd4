"""Sound of received packets as Foxglove's audio messages: Opus is repackaged, never decoded.

A packet of two microphones holds two Opus streams, the first in its self-delimited form (RFC 6716 appendix B, RFC
7845 section 5.1.1). They become two streams that any Opus decoder plays, with the frames of `JOINED` seconds in one
packet of code 3 (RFC 6716 section 3.2.5), as a message for each 5 ms would cost more than its sound. Sound that only
redundancy or concealment would bring back is missing here; the packets in the log hold it.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from tactophone.bridges import protobuf
from tactophone.bridges.schemas import AIR_SOUND, CONTACT_SOUND, PCM_SOUND, Topic
from tactophone.types import LIVE_SAMPLE_RATE

JOINED = 0.1
"""Seconds of sound in a message; Opus allows 0.12 s and 48 frames in a packet."""

_RTP = struct.Struct("!BBHII")
_L16_MONO, _L16_STEREO, _OPUS, _MULTIOPUS, _, _RED = range(96, 102)
# Frame durations of the CELT modes, by the two lowest bits of the configuration (RFC 6716 section 3.1).
_CELT_SAMPLES = (120, 240, 480, 960)


@dataclass(frozen=True, slots=True)
class SoundPacket:
    """The newest payload of an RTP packet."""

    kind: int
    timestamp: int
    content: bytes


@dataclass(slots=True)
class _Joined:
    """Opus frames of one stream that follow one another."""

    head: int = 0
    begun: int = 0
    end: int = 0
    frames: list[bytes] = field(default_factory=list)


def read_sound_packet(packet: bytes) -> SoundPacket | None:
    """Read an RTP packet of this link's wire format; ``None`` if it is no sound."""
    if len(packet) < _RTP.size:
        return None
    first, second, _, timestamp, _ = _RTP.unpack_from(packet)
    kind, position = second & 0x7F, _RTP.size
    if first != 0x80:
        return None
    if kind == _RED:
        # Each header of an earlier payload takes four bytes and begins with a set bit (RFC 2198 section 3).
        skipped = 0
        while position + 4 < len(packet) and packet[position] & 0x80:
            skipped += int.from_bytes(packet[position + 2 : position + 4]) & 0x3FF
            position += 4
        kind, position = packet[position], position + 1 + skipped
    known = _L16_MONO <= kind <= _MULTIOPUS and position < len(packet)
    return SoundPacket(kind, timestamp, packet[position:]) if known else None


def split_opus(content: bytes) -> tuple[bytes, bytes] | None:
    """Split a packet of two streams, each of one frame; ``None`` if it is not built so.

    >>> split_opus(bytes([0xF0, 2, 1, 2, 0xF0, 3, 4]))
    (b'\\xf0\\x01\\x02', b'\\xf0\\x03\\x04')
    """
    if len(content) < 3 or content[0] & 3:
        return None
    size, start = content[1], 2
    if size >= 252:  # RFC 6716 section 3.2.1
        size, start = 4 * content[2] + size, 3
    first, second = content[start : start + size], content[start + size :]
    return (content[:1] + first, second) if len(first) == size and second else None


def join_opus(head: int, frames: list[bytes]) -> bytes:
    """Join frames of the same configuration to a packet of code 3 with a length for each but the last."""
    if len(frames) == 1:
        return bytes([head]) + frames[0]
    lengths = b"".join(_length(len(frame)) for frame in frames[:-1])
    return bytes([head | 3, 0x80 | len(frames)]) + lengths + b"".join(frames)


class SoundMessages:
    """Turns packets into messages; a call of `flush` ends those that have begun."""

    def __init__(self) -> None:
        self._joined = {CONTACT_SOUND.name: _Joined(), AIR_SOUND.name: _Joined()}
        self._newest: int | None = None
        self._begun = 0.0

    def push(self, packet: SoundPacket, *, arrival: float) -> Iterator[tuple[Topic, float, bytes]]:
        """Take a packet that arrived at ``arrival`` (s since 1970); yield topic, time (s) and message."""
        position = self._position(packet.timestamp, arrival)
        if packet.kind in (_L16_MONO, _L16_STEREO):
            time = self._time(position)
            yield PCM_SOUND, time, _raw_audio(packet, time)
            return
        parts = split_opus(packet.content) if packet.kind == _MULTIOPUS else (packet.content,)
        for topic, part in zip((CONTACT_SOUND, AIR_SOUND), parts or (), strict=False):
            yield from self._join(topic, part, position)

    def flush(self) -> Iterator[tuple[Topic, float, bytes]]:
        """Yield what has begun."""
        for topic in (CONTACT_SOUND, AIR_SOUND):
            yield from self._finish(topic)

    def reset(self) -> None:
        """Begin a new session, whose timestamps have another origin."""
        self._newest = None

    def _join(self, topic: Topic, part: bytes, position: int) -> Iterator[tuple[Topic, float, bytes]]:
        joined = self._joined[topic.name]
        if part[0] & 3 or part[0] >> 3 < 16:
            return  # not one CELT frame, which is all that our encoder makes
        size = _CELT_SAMPLES[part[0] >> 3 & 3]
        full = position + size - joined.begun > JOINED * LIVE_SAMPLE_RATE
        if joined.frames and (position != joined.end or part[0] != joined.head or full):
            yield from self._finish(topic)
        if not joined.frames:
            joined.begun, joined.head = position, part[0]
        joined.frames.append(part[1:])
        joined.end = position + size

    def _finish(self, topic: Topic) -> Iterator[tuple[Topic, float, bytes]]:
        joined = self._joined[topic.name]
        if joined.frames:
            time = self._time(joined.begun)
            data = join_opus(joined.head, joined.frames)
            yield (
                topic,
                time,
                protobuf.octets(1, timestamp(time)) + protobuf.octets(2, data) + protobuf.octets(3, b"opus"),
            )
            joined.frames = []

    def _position(self, stamp: int, arrival: float) -> int:
        """Return the samples since the session's first packet, whose arrival all times are counted from."""
        if self._newest is None:
            self._newest, self._first, self._begun = stamp, stamp, arrival
        self._newest += (stamp - self._newest + (1 << 31)) % (1 << 32) - (1 << 31)
        return self._newest - self._first

    def _time(self, position: int) -> float:
        return self._begun + position / LIVE_SAMPLE_RATE


def timestamp(time: float) -> bytes:
    """Encode seconds since 1970 as ``google.protobuf.Timestamp``."""
    nanoseconds = max(0, round(time * 1e9))
    return protobuf.integer(1, nanoseconds // 10**9) + protobuf.integer(2, nanoseconds % 10**9)


def _raw_audio(packet: SoundPacket, time: float) -> bytes:
    little_endian = np.frombuffer(packet.content[: len(packet.content) // 2 * 2], ">i2").astype("<i2").tobytes()
    return (
        protobuf.octets(1, timestamp(time))
        + protobuf.octets(2, little_endian)
        + protobuf.octets(3, b"pcm-s16")
        + protobuf.fixed32(4, LIVE_SAMPLE_RATE)
        + protobuf.fixed32(5, 1 if packet.kind == _L16_MONO else 2)
    )


def _length(size: int) -> bytes:
    return bytes([size]) if size < 252 else bytes([252 + (size & 3), (size - 252 - (size & 3)) >> 2])
