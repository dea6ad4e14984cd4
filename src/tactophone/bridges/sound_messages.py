"""Sound of received packets as Foxglove's audio messages: Opus is repackaged, never decoded.

The stream of each microphone is one that any Opus decoder plays, with the frames of `JOINED` seconds in one packet of
code 3 (RFC 6716 section 3.2.5), as a message for each 5 ms would cost more than its sound. Sound that only redundancy
or concealment would bring back is missing here; the packets in the log hold it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from tactophone.bridges import protobuf
from tactophone.bridges.schemas import AIR_SOUND, CONTACT_SOUND, PCM_SOUND, Topic, of_finger
from tactophone.bridges.sound_payload import PCM, fingers_of, read_layout, split_payload
from tactophone.opus_packets import FRAME_SIZES, join_frames
from tactophone.types import LIVE_SAMPLE_RATE

JOINED = 0.12
"""Seconds of sound in a message: what Opus allows in a packet, with 48 frames."""

_SoundMessage = tuple[Topic, float, bytes]


@dataclass(slots=True)
class _Joined:
    """Opus frames of one stream that follow one another."""

    topic: Topic
    head: int = 0
    begun: int = 0
    end: int = 0
    frames: list[bytes] = field(default_factory=list)


class SoundMessages:
    """Turns packets into messages; a call of `flush` ends those that have begun.

    Packets of another number of fingers than ``names`` has are left out, as the operator refuses them.
    """

    def __init__(self, names: Sequence[str] = ("",)) -> None:
        self._names = names
        self._joined: dict[str, _Joined] = {}
        self._newest: int | None = None
        self._begun = 0.0

    def push(self, packet: bytes, *, arrival: float) -> list[_SoundMessage] | None:
        """Take an RTP packet that arrived at ``arrival`` (s since 1970); return topics, times (s) and messages.

        ``None`` if its newest payload is not in them: if it is no sound, or not of this hand or of our encoder.
        """
        layout = read_layout(packet)
        if layout is None or fingers_of(layout.kind) != len(self._names):
            return None
        parts = split_payload(layout.kind, packet[layout.newest :])
        if parts is None:
            return None
        position = self._position(layout.timestamp, arrival)
        each = len(parts) // len(self._names)
        messages: list[_SoundMessage] = []
        for number, part in enumerate(parts):
            finger = number // each
            if layout.kind in PCM:
                topic, time = of_finger(PCM_SOUND, finger, self._names[finger]), self._time(position)
                messages.append((topic, time, _raw_audio(part, min(2, PCM[layout.kind]), time)))
            else:
                topic = of_finger((CONTACT_SOUND, AIR_SOUND)[number % each], finger, self._names[finger])
                messages += self._join(topic, part, position)
        return messages

    def flush(self) -> Iterator[_SoundMessage]:
        """Yield what has begun."""
        for joined in self._joined.values():
            yield from self._finish(joined)

    def reset(self) -> None:
        """Begin a new session, whose timestamps have another origin."""
        self._newest = None

    def _join(self, topic: Topic, part: bytes, position: int) -> Iterator[_SoundMessage]:
        joined = self._joined.setdefault(topic.name, _Joined(topic))
        size = FRAME_SIZES[part[0] >> 3 & 3]
        full = position + size - joined.begun > JOINED * LIVE_SAMPLE_RATE
        if joined.frames and (position != joined.end or part[0] != joined.head or full):
            yield from self._finish(joined)
        if not joined.frames:
            joined.begun, joined.head = position, part[0]
        joined.frames.append(part[1:])
        joined.end = position + size

    def _finish(self, joined: _Joined) -> Iterator[_SoundMessage]:
        if joined.frames:
            time = self._time(joined.begun)
            data = join_frames(joined.head, joined.frames)
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


def _raw_audio(samples: bytes, channels: int, time: float) -> bytes:
    return (
        protobuf.octets(1, timestamp(time))
        + protobuf.octets(2, samples)
        + protobuf.octets(3, b"pcm-s16")
        + protobuf.fixed32(4, LIVE_SAMPLE_RATE)
        + protobuf.fixed32(5, channels)
    )
