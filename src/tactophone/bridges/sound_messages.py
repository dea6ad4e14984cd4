"""Sound of received packets as Foxglove's audio messages: Opus is repackaged, never decoded.

A packet of two microphones holds two Opus streams, the first in its self-delimited form (RFC 6716 appendix B, RFC
7845 section 5.1.1). They become two streams that any Opus decoder plays, with the frames of `JOINED` seconds in one
packet of code 3 (RFC 6716 section 3.2.5), as a message for each 5 ms would cost more than its sound. Sound that only
redundancy or concealment would bring back is missing here; the packets in the log hold it.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tactophone.bridges import protobuf
from tactophone.bridges.schemas import AIR_SOUND, CONTACT_SOUND, PCM_SOUND, Topic, of_finger
from tactophone.types import LIVE_SAMPLE_RATE, MOST_FINGERS

JOINED = 0.1
"""Seconds of sound in a message; Opus allows 0.12 s and 48 frames in a packet."""

_RTP = struct.Struct("!BBHII")
_RED = 101
_PCM = {96: 1, 97: 2, **{101 + fingers: 2 * fingers for fingers in range(2, MOST_FINGERS + 1)}}
_OPUS = {98: 1, 99: 2, **{110 + fingers: 2 * fingers for fingers in range(2, MOST_FINGERS + 1)}}
# Channels of each payload type (docs/reference/wire-format.md); a hand has contact and air of each finger in turn.
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

    topic: Topic
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
    known = kind in (_PCM | _OPUS) and position < len(packet)
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
    """Turns packets into messages; a call of `flush` ends those that have begun.

    Parameters
    ----------
    names
        Of the fingers of a hand; packets of another number of fingers are left out, as the operator refuses them.
    """

    def __init__(self, names: Sequence[str] = ("",)) -> None:
        self._names = names
        self._joined: dict[str, _Joined] = {}
        self._newest: int | None = None
        self._begun = 0.0

    def push(self, packet: SoundPacket, *, arrival: float) -> Iterator[tuple[Topic, float, bytes]]:
        """Take a packet that arrived at ``arrival`` (s since 1970); yield topic, time (s) and message."""
        channels = _PCM.get(packet.kind) or _OPUS[packet.kind]
        if max(1, channels // 2) != len(self._names):
            return
        position = self._position(packet.timestamp, arrival)
        if packet.kind in _PCM:
            yield from self._raw(packet.content, channels, self._time(position))
            return
        each = len(packet.content) // len(self._names)
        for finger, name in enumerate(self._names):
            content = packet.content[finger * each : (finger + 1) * each]
            parts = split_opus(content) if channels > 1 else (content,)
            for topic, part in zip((CONTACT_SOUND, AIR_SOUND), parts or (), strict=False):
                yield from self._join(of_finger(topic, finger, name), part, position)

    def flush(self) -> Iterator[tuple[Topic, float, bytes]]:
        """Yield what has begun."""
        for joined in self._joined.values():
            yield from self._finish(joined)

    def reset(self) -> None:
        """Begin a new session, whose timestamps have another origin."""
        self._newest = None

    def _join(self, topic: Topic, part: bytes, position: int) -> Iterator[tuple[Topic, float, bytes]]:
        joined = self._joined.setdefault(topic.name, _Joined(topic))
        if part[0] & 3 or part[0] >> 3 < 16:
            return  # not one CELT frame, which is all that our encoder makes
        size = _CELT_SAMPLES[part[0] >> 3 & 3]
        full = position + size - joined.begun > JOINED * LIVE_SAMPLE_RATE
        if joined.frames and (position != joined.end or part[0] != joined.head or full):
            yield from self._finish(joined)
        if not joined.frames:
            joined.begun, joined.head = position, part[0]
        joined.frames.append(part[1:])
        joined.end = position + size

    def _raw(self, content: bytes, channels: int, time: float) -> Iterator[tuple[Topic, float, bytes]]:
        whole = len(content) // (2 * channels) * 2 * channels
        samples = np.frombuffer(content[:whole], ">i2").reshape(-1, channels).astype("<i2")
        for finger, name in enumerate(self._names):
            part = samples[:, 2 * finger : 2 * finger + 2]
            yield of_finger(PCM_SOUND, finger, name), time, _raw_audio(part, time)

    def _finish(self, joined: _Joined) -> Iterator[tuple[Topic, float, bytes]]:
        if joined.frames:
            time = self._time(joined.begun)
            data = join_opus(joined.head, joined.frames)
            yield (
                joined.topic,
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


def _raw_audio(samples: NDArray[np.int16], time: float) -> bytes:
    return (
        protobuf.octets(1, timestamp(time))
        + protobuf.octets(2, samples.tobytes())
        + protobuf.octets(3, b"pcm-s16")
        + protobuf.fixed32(4, LIVE_SAMPLE_RATE)
        + protobuf.fixed32(5, samples.shape[1])
    )


def _length(size: int) -> bytes:
    return bytes([size]) if size < 252 else bytes([252 + (size & 3), (size - 252 - (size & 3)) >> 2])
