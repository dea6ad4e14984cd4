"""RTP packets (RFC 3550) with redundancy (RFC 2198): parsing and serializing.

A packet may carry, beside its own payload, the one or two payloads before it. Its payload type is then ``RED`` and the
actual types are inside, so that any tool that implements RFC 2198 can read it.
"""

import enum
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from tactophone.errors import PacketError
from tactophone.link.srtp import MAX_DATAGRAM, OVERHEAD
from tactophone.types import MOST_FINGERS

CLOCK_RATE = 48_000
"""Clock rate of all RTP timestamps, in Hz: RFC 7587 section 4.1 requires it for Opus, and all payloads use it."""

PAYLOAD_SPACE = MAX_DATAGRAM - OVERHEAD - 13
"""Bytes for payloads in a packet: without the SRTP tag, the RTP header and the last header of RFC 2198."""

_VERSION = 2
_HEADER = struct.Struct("!BBHII")
_EXTENSION = struct.Struct("!HH")
_EARLIER = struct.Struct("!I")  # RFC 2198 section 3: F, 7 bits of type, 14 of timestamp offset, 10 of length

MAX_EARLIER_OFFSET = (1 << 14) - 1
"""Maximum samples by which an earlier payload may lie behind its packet (RFC 2198 section 3): 341 ms."""

MAX_EARLIER = 2
"""Maximum earlier payloads in a packet: as many as a sender makes."""

MAX_EARLIER_SIZE = (1 << 10) - 1
"""Maximum bytes of an earlier payload (RFC 2198 section 3)."""


class PayloadType(enum.IntEnum):
    """RTP payload types, in the dynamic range of RFC 3551; the table is fixed, so nothing is negotiated.

    Sound of a hand has a type for each number of fingers, with contact and air of each finger in turn: whoever receives
    one packet knows the hand.
    """

    L16_MONO = 96
    L16_STEREO = 97
    OPUS = 98
    MULTIOPUS = 99
    PREDICTION = 100
    RED = 101
    L16_HAND_2 = 103
    L16_HAND_3 = 104
    L16_HAND_4 = 105
    L16_HAND_5 = 106
    L16_HAND_6 = 107
    L16_HAND_7 = 108
    L16_HAND_8 = 109
    L16_HAND_9 = 110
    L16_HAND_10 = 111
    MULTIOPUS_HAND_2 = 112
    MULTIOPUS_HAND_3 = 113
    MULTIOPUS_HAND_4 = 114
    MULTIOPUS_HAND_5 = 115
    MULTIOPUS_HAND_6 = 116
    MULTIOPUS_HAND_7 = 117
    MULTIOPUS_HAND_8 = 118
    MULTIOPUS_HAND_9 = 119
    MULTIOPUS_HAND_10 = 120
    HAND_PREDICTION = 121


SOUND_FORMATS: dict[PayloadType, tuple[str, int]] = {
    PayloadType.L16_MONO: ("pcm16", 1),
    PayloadType.L16_STEREO: ("pcm16", 2),
    PayloadType.OPUS: ("opus", 1),
    PayloadType.MULTIOPUS: ("opus", 2),
    **{PayloadType(101 + fingers): ("pcm16", 2 * fingers) for fingers in range(2, MOST_FINGERS + 1)},
    **{PayloadType(110 + fingers): ("opus", 2 * fingers) for fingers in range(2, MOST_FINGERS + 1)},
}
"""Codec and channels of each payload type of sound: a hand of N fingers has 2 N."""


_PLAIN = _VERSION << 6
"""First byte of a header without padding, extension and contributing sources."""

_HALF_TURN = 1 << 31
"""Half of the RTP timestamps."""

_SOUND_KINDS = {int(kind): kind for kind in PayloadType if kind != PayloadType.RED}
"""Payload types outside redundancy, by number: a look-up takes a fifth of the time of the enumeration's own."""


@dataclass(frozen=True, slots=True)
class Payload:
    """Encoded sound or a prediction: ``content`` of type ``kind``, which begins at ``timestamp``."""

    kind: PayloadType
    timestamp: int
    content: bytes


@dataclass(frozen=True, slots=True)
class Packet:
    """One unencrypted RTP packet; ``bytes(packet)`` is the inverse of :func:`parse_packet`.

    Examples
    --------
    >>> packet = Packet(7, ssrc=1, payload=Payload(PayloadType.OPUS, 960, b"sound"))
    >>> bytes(packet).hex(" ", -4)
    '80620007 000003c0 00000001 736f756e 64'
    >>> parse_packet(bytes(packet)) == packet
    True
    """

    sequence: int
    """Packet number, modulo 2**16."""
    ssrc: int
    payload: Payload
    """The sound or prediction of this packet."""
    earlier: tuple[Payload, ...] = ()
    """Payloads of the packets before this one, oldest first."""
    marker: bool = False
    """True on the first packet and after a gap in the sound itself (RFC 3551 section 4.1)."""

    def __bytes__(self) -> bytes:
        kind = PayloadType.RED if self.earlier else self.payload.kind
        head = _HEADER.pack(
            _PLAIN, self.marker << 7 | kind, self.sequence, self.payload.timestamp % (1 << 32), self.ssrc
        )
        if not self.earlier:
            return head + self.payload.content
        return head + _write_redundancy(self.payload, self.earlier)


def parse_packet(datagram: bytes) -> Packet:
    """Parse an RTP packet; raises `PacketError` when the bytes are not RTP, or the payload type is unknown."""
    if len(datagram) < _HEADER.size:
        raise PacketError(f"{len(datagram)} bytes, but an RTP header has {_HEADER.size}; the datagram was cut")
    first, second, sequence, timestamp, ssrc = _HEADER.unpack_from(datagram)
    if first >> 6 != _VERSION:
        raise PacketError(f"RTP version {first >> 6}, but only {_VERSION} exists; this is not an RTP packet")
    if first == _PLAIN and (kind := _SOUND_KINDS.get(second & 0x7F)) is not None:
        # What our own senders make when nothing is lost: no extras in the header, one payload.
        payload = Payload(kind, timestamp, datagram[_HEADER.size :])
        return Packet(sequence, ssrc, payload, (), second > 0x7F)
    start, end = (_HEADER.size, None) if first == _PLAIN else (_body_start(datagram, first), _body_end(datagram, first))
    body = datagram[start:end]
    if second & 0x7F == PayloadType.RED:
        payload, earlier = _read_redundancy(timestamp, body)
    else:
        payload, earlier = Payload(_kind(second & 0x7F), timestamp, body), ()
    return Packet(sequence, ssrc, payload, earlier, second > 0x7F)


def ahead(value: int, reference: int, *, bits: int) -> int:
    """Return how far a wrapping counter is ahead of another; negative when it is behind.

    Examples
    --------
    >>> ahead(2, 65_534, bits=16), ahead(65_534, 2, bits=16)
    (4, -4)
    """
    half = 1 << (bits - 1)
    return (value - reference + half) % (1 << bits) - half


class TimestampUnwrapper:
    """Turns wrapping timestamps into samples since the first timestamp.

    Parameters
    ----------
    start
        Position of the first timestamp.

    Attributes
    ----------
    origin
        The timestamp at position 0; 0 before the first call.

    Examples
    --------
    >>> unwrapper = TimestampUnwrapper()
    >>> [unwrapper.position(timestamp) for timestamp in (2**32 - 100, 140, 20)]
    [0, 240, 120]
    """

    def __init__(self, start: int = 0) -> None:
        self.origin = 0
        self._start = start
        self._newest: int | None = None

    def position(self, timestamp: int) -> int:
        """Return the samples since the first timestamp, whose position is ``start``; less for an older one."""
        if self._newest is None:
            self._newest, self.origin = timestamp, timestamp - self._start
        # As `ahead`, without a call for each packet.
        reached = self._newest + (timestamp - self._newest + _HALF_TURN) % (1 << 32) - _HALF_TURN
        self._newest = max(self._newest, reached)
        return reached - self.origin


def _body_start(datagram: bytes, first: int) -> int:
    """Return where the payload begins, after contributing sources and extension, which other senders may use."""
    start = _HEADER.size + 4 * (first & 0x0F)
    if first & 0x10:
        if start + _EXTENSION.size > len(datagram):
            raise PacketError(f"a header extension at byte {start} of {len(datagram)}; the datagram was cut")
        start += _EXTENSION.size + 4 * _EXTENSION.unpack_from(datagram, start)[1]
    if start > len(datagram):
        raise PacketError(f"a header of {start} bytes in a datagram of {len(datagram)}; the datagram was cut")
    return start


def _body_end(datagram: bytes, first: int) -> int:
    """Return where the payload ends, before padding, which other senders may use."""
    if not first & 0x20:
        return len(datagram)
    padding = datagram[-1]
    if not 0 < padding <= len(datagram) - _body_start(datagram, first):
        raise PacketError(f"{padding} bytes of padding in a datagram of {len(datagram)}; its last byte is wrong")
    return len(datagram) - padding


def _read_redundancy(timestamp: int, body: bytes) -> tuple[Payload, tuple[Payload, ...]]:
    """Return a packet's own payload, which is the last and takes the rest, and the earlier ones."""
    heads: list[tuple[int, int, int]] = []
    position, size = 0, len(body)
    while position < size and body[position] & 0x80:
        if position + _EARLIER.size > size:
            raise PacketError("a redundancy header that ends within; the datagram was cut")
        word = _EARLIER.unpack_from(body, position)[0]
        if len(heads) == MAX_EARLIER:
            raise PacketError(f"more than {MAX_EARLIER} earlier payloads, which no sender makes")
        heads.append((word >> 24 & 0x7F, word >> 10 & 0x3FFF, word & 0x3FF))
        position += _EARLIER.size
    if position == size:
        raise PacketError("redundancy without a last header: the packet's own payload is missing")
    own, position = _kind(body[position]), position + 1
    earlier: list[Payload] = []
    for number, offset, length in heads:
        if position + length > size:
            raise PacketError(f"an earlier payload of {length} bytes, but {size - position} are left")
        content = body[position : position + length]
        earlier.append(Payload(_kind(number), (timestamp - offset) % (1 << 32), content))
        position += length
    return Payload(own, timestamp, body[position:]), tuple(earlier)


def _write_redundancy(payload: Payload, earlier: Sequence[Payload]) -> bytes:
    now = payload.timestamp
    heads, contents = b"", b""
    for past in earlier:
        behind = (now - past.timestamp) % (1 << 32)
        heads += _EARLIER.pack(1 << 31 | past.kind << 24 | behind << 10 | len(past.content))
        contents += past.content
    return heads + bytes([payload.kind]) + contents + payload.content


def _kind(number: int) -> PayloadType:
    """Return the payload type; RED within RED is refused like an unknown type."""
    if (kind := _SOUND_KINDS.get(number)) is not None:
        return kind
    raise PacketError(f"payload type {number}, but {PayloadType.L16_MONO} to {PayloadType.HAND_PREDICTION} are known")
