"""Sound of received packets as Foxglove's audio messages of 20 ms: Opus is repackaged,
never decoded.

The stream of each microphone is one that any Opus decoder plays. Sound that only
redundancy or concealment would bring back is missing here; the packets in the log hold
it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from tactophone.core.errors import PacketError
from tactophone.core.microphones import fingers_of
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.live.log import log_topics
from tactophone.live.log.log_topics import (
    AIR_SOUND,
    CONTACT_SOUND,
    PACKETS,
    PCM_SOUND,
    RUN,
    Message,
    Topic,
    of_finger,
)
from tactophone.live.telemetry.records import RunStart
from tactophone.net.link.packet import (
    FRAME_SIZES,
    SOUND_FORMATS,
    Payload,
    TimestampUnwrapper,
    join_frames,
    parse_packet,
    split_streams,
)

JOINED = 0.02
"""Seconds of sound in a message, about as much as the schemas of Foxglove ask for."""

# First bytes of the link's events (`tactophone.net.link.events`).
_PACKET = 0
_CONNECTED = 2

_CODE = 3
"""Bits of an Opus packet's first byte that say how many frames follow (RFC 6716 section
3.1)."""

_CELT = 16
"""The first configuration of CELT (RFC 6716 section 3.1)."""


@dataclass(slots=True)
class _Joined:
    """Frames of one stream, or samples, that follow one another; ``head`` is the first
    byte of a frame."""

    topic: Topic
    channels: int = 1
    head: int = 0
    begun: int = 0
    end: int = 0
    frames: list[bytes] = field(default_factory=list)


class SoundMessages:
    """Turns a run's messages into messages of its sound.

    Packets of another number of fingers than ``names`` has are left out, as the
    operator refuses them.
    """

    def __init__(self, names: Sequence[str] = ("",)) -> None:
        self._names = names
        self._joined: dict[str, _Joined] = {}
        self._epoch = self._begun = 0.0
        self._stamps: TimestampUnwrapper | None = None

    def push(self, topic: str, data: bytes) -> Iterator[Message]:
        """Take a message of the run; yield the messages of sound that its packets
        complete."""
        if topic == RUN.name:
            yield from self.flush()
            self._epoch = msgspec.json.decode(data, type=RunStart).epoch
            self._stamps = None
        elif topic == PACKETS.name:
            for arrival in msgspec.json.decode(data, type=log_topics.Packets).arrivals:
                for event in arrival.events:
                    if event[:1] == bytes([_CONNECTED]):
                        # A new session, whose timestamps have another origin.
                        yield from self.flush()
                        self._stamps = None
                    elif event[:1] == bytes([_PACKET]):
                        yield from self._packet(event[1:], self._epoch + arrival.time)

    def flush(self) -> Iterator[Message]:
        for joined in self._joined.values():
            yield from self._finish(joined)

    def _packet(self, packet: bytes, arrival: float) -> Iterator[Message]:
        try:
            payload = parse_packet(packet).payload
        except PacketError:
            return
        codec, channels = SOUND_FORMATS.get(payload.kind, ("", 0))
        if not codec or fingers_of(channels) != len(self._names):
            return
        parts = (
            _split_opus(payload, channels)
            if codec == "opus"
            else _split_pcm(payload, channels)
        )
        if self._stamps is None:
            # All times are counted from the arrival of the session's first packet.
            self._stamps = TimestampUnwrapper()
            self._begun = arrival
        position = self._stamps.position(payload.timestamp)
        each = len(parts) // len(self._names)
        for number, (part, size) in enumerate(parts):
            finger = number // each
            topic = (
                (CONTACT_SOUND, AIR_SOUND)[number % each]
                if codec == "opus"
                else PCM_SOUND
            )
            topic = of_finger(topic, finger, self._names[finger])
            joined = self._joined.setdefault(
                topic.name, _Joined(topic, min(channels, 2))
            )
            head = part[0] if codec == "opus" else 0
            full = position + size - joined.begun > JOINED * LIVE_SAMPLE_RATE
            if joined.frames and (
                position != joined.end or head != joined.head or full
            ):
                yield from self._finish(joined)
            if not joined.frames:
                joined.begun = position
                joined.head = head
            joined.frames.append(part[1:] if codec == "opus" else part)
            joined.end = position + size

    def _finish(self, joined: _Joined) -> Iterator[Message]:
        frames = joined.frames
        joined.frames = []
        if not frames:
            return
        time = self._begun + joined.begun / LIVE_SAMPLE_RATE
        nanoseconds = max(0, round(time * 1e9))
        stamp = log_topics.integer(1, nanoseconds // 10**9) + log_topics.integer(
            2, nanoseconds % 10**9
        )
        if joined.topic.schema is log_topics.COMPRESSED_AUDIO:
            data = join_frames(joined.head, frames)
            ending = log_topics.octets(3, b"opus")
        else:
            data = b"".join(frames)
            ending = log_topics.octets(3, b"pcm-s16")
            ending += log_topics.fixed32(4, LIVE_SAMPLE_RATE) + log_topics.fixed32(
                5, joined.channels
            )
        yield Message(
            joined.topic,
            time,
            log_topics.octets(1, stamp) + log_topics.octets(2, data) + ending,
        )


def _split_pcm(payload: Payload, channels: int) -> list[tuple[bytes, int]]:
    """Return the 16-bit samples of each finger, little-endian, and their number."""
    size = len(payload.content) // (2 * channels)
    samples = (
        np.frombuffer(payload.content, ">i2", count=size * channels)
        .reshape(-1, channels)
        .astype("<i2")
    )
    return [
        (part.tobytes(), size)
        for part in np.split(samples, fingers_of(channels), axis=1)
    ]


def _split_opus(payload: Payload, channels: int) -> list[tuple[bytes, int]]:
    """Return the Opus packet of each microphone and its samples; none if one is not a
    single CELT frame.

    Our encoder makes nothing else. A hand is its fingers one after another, each as
    long.
    """
    fingers = fingers_of(channels)
    each = len(payload.content) // fingers
    parts = [
        part
        for first in range(0, each * fingers, max(each, 1))
        for part in split_streams(
            payload.content[first : first + each], min(channels, 2)
        )
    ]
    if len(parts) != channels or any(
        part[0] & _CODE or part[0] >> 3 < _CELT for part in parts
    ):
        return []
    return [(part, FRAME_SIZES[part[0] >> 3 & 3]) for part in parts]
