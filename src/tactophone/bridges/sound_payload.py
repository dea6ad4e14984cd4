"""Sound payloads of this link taken apart, one part for each microphone, and put together again.

A packet of two microphones holds two Opus streams; of a hand, such a pair for each finger. Readable messages hold the
parts; as the payload follows from them, a log holds it only once.
"""

import struct
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tactophone.bridges import protobuf
from tactophone.bridges.schemas import AIR_SOUND, CONTACT_SOUND, PCM_SOUND
from tactophone.opus_packets import join_streams, split_frames, split_streams
from tactophone.types import MOST_FINGERS

RTP_HEADER = struct.Struct("!BBHII")
"""Flags, payload type, number, timestamp, source (RFC 3550 section 5.1)."""

_RED = 101
PCM = {96: 1, 97: 2, **{101 + fingers: 2 * fingers for fingers in range(2, MOST_FINGERS + 1)}}
OPUS = {98: 1, 99: 2, **{110 + fingers: 2 * fingers for fingers in range(2, MOST_FINGERS + 1)}}
"""Channels of each payload type (docs/reference/wire-format.md); a hand has contact and air of each finger in turn."""

_FINGERS = {kind: max(1, channels // 2) for kind, channels in (PCM | OPUS).items()}

_CODE, _CELT = 3, 16  # bits with the number of frames; the first configuration of CELT (RFC 6716 section 3.1)


@dataclass(frozen=True, slots=True)
class PacketLayout:
    """Where the payloads of an RTP packet begin, and how old and long those are that redundancy (RED) repeats."""

    kind: int
    timestamp: int
    start: int
    repeated: tuple[tuple[int, int], ...] = ()

    @property
    def newest(self) -> int:
        """Where the newest payload begins."""
        return self.start + sum(size for _, size in self.repeated)


def read_layout(packet: bytes) -> PacketLayout | None:
    """Read an RTP packet of this link's wire format; ``None`` if it is no sound."""
    if len(packet) < RTP_HEADER.size:
        return None
    first, second, _, timestamp, _ = RTP_HEADER.unpack_from(packet)
    kind, position, repeated = second & 0x7F, RTP_HEADER.size, []
    if first != 0x80:
        return None
    if kind == _RED:
        # Each header of an earlier payload takes four bytes and begins with a set bit (RFC 2198 section 3).
        while position + 4 < len(packet) and packet[position] & 0x80:
            bits = int.from_bytes(packet[position + 1 : position + 4])
            repeated.append((bits >> 10, bits & 0x3FF))
            position += 4
        if position >= len(packet):
            return None
        kind, position = packet[position], position + 1
    return PacketLayout(kind, timestamp, position, tuple(repeated)) if kind in _FINGERS else None


def split_payload(kind: int, payload: bytes) -> list[bytes] | None:
    """Return the Opus packet of each microphone, or the 16-bit samples of each finger, little-endian.

    ``None`` unless `join_payload` makes the same payload of them: if it was cut, or is not of our encoder.

    >>> split_payload(99, bytes([0xF0, 2, 1, 2, 0xF0, 3, 4]))
    [b'\\xf0\\x01\\x02', b'\\xf0\\x03\\x04']
    """
    parts: list[bytes] = []
    if channels := PCM.get(kind):
        whole = len(payload) // (2 * channels) * channels
        samples = np.frombuffer(payload, ">i2", count=whole).reshape(-1, channels).astype("<i2")
        parts = [samples[:, first : first + 2].tobytes() for first in range(0, channels, 2)]
    else:
        each = len(payload) // fingers_of(kind)
        for first in range(0, each * fingers_of(kind), max(each, 1)):
            parts += split_streams(payload[first : first + each], min(OPUS[kind], 2))
        if any(part[0] & _CODE or part[0] >> 3 < _CELT for part in parts):
            return None  # not one CELT frame each, which is all that our encoder makes
    return parts if parts and join_payload(kind, parts) == payload else None


def join_payload(kind: int, parts: Sequence[bytes]) -> bytes:
    """Return the payload whose parts these are."""
    if channels := PCM.get(kind):
        width = min(channels, 2)
        return np.hstack([np.frombuffer(part, "<i2").reshape(-1, width) for part in parts]).astype(">i2").tobytes()
    return b"".join(join_streams(parts[first : first + 2]) for first in range(0, len(parts), 2))


def fingers_of(kind: int) -> int:
    """Return how many fingers a payload type is for."""
    return _FINGERS[kind]


class LoggedSound:
    """The parts in the messages of a log, in their order, until packets ask for them."""

    def __init__(self) -> None:
        self._parts: dict[tuple[int, str], deque[bytes]] = defaultdict(deque)

    def add(self, finger: int, kind: str, message: bytes) -> None:
        """Take a message of the topic of this kind."""
        (data,) = (bytes(value) for number, value in protobuf.fields(message) if number == 2)
        self._parts[finger, kind] += [data] if kind == PCM_SOUND.kind else split_frames(data)

    def next_payload(self, kind: int) -> bytes:
        """Return the payload of the next packet; raises `ValueError` if its sound is missing."""
        topics = [PCM_SOUND] if kind in PCM else [CONTACT_SOUND, AIR_SOUND][: OPUS[kind]]
        queues = [self._parts[finger, topic.kind] for finger in range(fingers_of(kind)) for topic in topics]
        if not all(queues):
            raise ValueError("the sound of a packet is missing")
        return join_payload(kind, [queue.popleft() for queue in queues])
