"""Everything that the link's packets hold: RTP (RFC 3550) with redundancy (RFC 2198),
Opus frames, predictions.

It parses and builds bytes, and needs neither a codec nor encryption, so that logs and
bridges read packets with it too.

A packet may carry, beside its own payload, the one or two payloads before it. Its
payload type is then ``RED`` and the actual types are inside, so that any tool that
implements RFC 2198 can read it.

An Opus payload of two microphones is a packet of two streams, the first in its
self-delimited form (RFC 6716 appendix B, RFC 7845 section 5.1.1): after its first byte
stands the length of its frame.

While the robot moves, it is a contributing source of its packets (`MOTION`).

A prediction takes 16 bytes, for links too slow for sound:

===========  =====================  ==============================================
bytes        field                  encoding
===========  =====================  ==============================================
0            touch                  0 none, 1 smooth, 2 rough
1            flags                  1 for invalid sound or model output, 2 for unknown
2-7          probabilities          three times 16 bits, 65535 is 1
8-9          roughness              16 bits, 65535 is 1
10-11        level                  hundredths of dBFS; the lowest number is -inf
12-15        length of the window   samples at 48 kHz; it ends at the timestamp
===========  =====================  ==============================================

Predictions of a hand whose windows end together share a payload: for each, a byte with
the number of fingers (upper four bits) and the finger, counted from 0, and then these
16.
"""

import enum
import math
import struct
from collections.abc import Mapping
from typing import TypeAlias

import msgspec
from msgspec.structs import replace

from tactophone.core.errors import PacketError
from tactophone.core.types import MOST_FINGERS, Prediction, Touch

CLOCK_RATE = 48_000
"""Clock rate of all RTP timestamps, in Hz: RFC 7587 section 4.1 requires it for Opus,
and all payloads use it."""

MAX_DATAGRAM = 1_280 - 48
"""Maximum bytes of a datagram: the minimum MTU of IPv6 (RFC 8200) without the headers
of IPv6 and UDP."""

SRTP_OVERHEAD = 16
"""Bytes that SRTP adds to a packet: the full GCM tag (RFC 7714)."""

MOTION = b"MOVE"
"""Contributing source (RFC 3550 section 5.1) of a packet while the robot moves; other
receivers skip it."""

PAYLOAD_SPACE = MAX_DATAGRAM - SRTP_OVERHEAD - 16
"""Bytes for payloads in a packet: without the SRTP tag, the RTP header and a
contributing source."""

_VERSION = 2
"""Version of RTP (RFC 3550 section 5.1)."""

_HEADER = struct.Struct("!BBHII")
"""Header of RTP: version and flags, marker and payload type, sequence number,
timestamp, SSRC (RFC 3550 section 5.1)."""

_EXTENSION = struct.Struct("!HH")
"""Head of a header extension: its profile, and its length in words (RFC 3550 section
5.3.1)."""

_EARLIER = struct.Struct("!I")
"""Header of an earlier payload (RFC 2198 section 3): a set bit, 7 bits of type, 14 of
timestamp offset and 10 of length."""

MAX_EARLIER_OFFSET = (1 << 14) - 1
"""Maximum samples by which an earlier payload may lie behind its packet (RFC 2198
section 3): 341 ms."""

MAX_EARLIER = 2
"""Maximum earlier payloads in a packet: as many as a sender makes."""

MAX_EARLIER_SIZE = (1 << 10) - 1
"""Maximum bytes of an earlier payload (RFC 2198 section 3)."""


class PayloadType(enum.IntEnum):
    """RTP payload types, in the dynamic range of RFC 3551; the table is fixed, so
    nothing is negotiated.

    Sound of a hand has a type for each number of fingers, with contact and air of each
    finger in turn: whoever receives one packet knows the hand.
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
    **{
        PayloadType(101 + fingers): ("pcm16", 2 * fingers)
        for fingers in range(2, MOST_FINGERS + 1)
    },
    **{
        PayloadType(110 + fingers): ("opus", 2 * fingers)
        for fingers in range(2, MOST_FINGERS + 1)
    },
}
"""Codec and channels of each payload type of sound: a hand of N fingers has 2 N."""

_PLAIN = _VERSION << 6
"""First byte of a header without padding, extension and contributing sources."""

_HALF_TURN = 1 << 31
"""Half the range of an RTP timestamp."""

_SOUND_KINDS = {int(kind): kind for kind in PayloadType if kind != PayloadType.RED}
"""Payload types outside redundancy, by number: a look-up takes a fifth of the time of
the enumeration's own."""

Address: TypeAlias = tuple[str, int]
"""Host and port of a datagram's source or destination, as the socket expects and
returns them."""


def split_address(text: str, port: int) -> Address:
    """Split ``host``, ``host:port`` or ``[host]:port``, with a default port;
    `ValueError` for anything else.

    >>> split_address("[2001:db8::1]:3479", 3478), split_address("2001:db8::1", 3478)
    (('2001:db8::1', 3479), ('2001:db8::1', 3478))
    """
    host, colon, number = text.rpartition(":")
    # The colons of an IPv6 address alone are no port.
    if not colon or text.endswith("]") or (":" in host and not host.endswith("]")):
        host = text
        number = str(port)
    if not host:
        raise ValueError("there is no host")
    if not number.isascii() or not number.isdecimal() or not 0 < int(number) < 1 << 16:
        raise ValueError(f"{number!r} is no port")
    return host.strip("[]"), int(number)


def is_dtls(datagram: bytes) -> bool:
    """Whether a datagram belongs to a handshake, by its first byte (RFC 7983 section
    7)."""
    return len(datagram) > 0 and 20 <= datagram[0] < 64


def is_srtp(datagram: bytes) -> bool:
    """Whether a datagram is an encrypted packet or report, by its first byte (RFC 7983
    section 7)."""
    return len(datagram) > 0 and 128 <= datagram[0] < 192


def is_report(packet: bytes) -> bool:
    """Whether a packet is RTCP, not RTP, by its second byte (RFC 5761 section 4)."""
    return len(packet) > 1 and 64 <= packet[1] & 0x7F <= 95


def stream_of(packet: bytes, *, report: bool) -> int:
    """Return the SSRC in the clear header of RTP, or of RTCP (`report`); -1 when the
    packet is too short for one."""
    field = packet[4:8] if report else packet[8:12]
    return int.from_bytes(field) if len(field) == 4 else -1


class Payload(msgspec.Struct, frozen=True):
    """Encoded sound or a prediction: ``content`` of type ``kind``, which begins at
    ``timestamp``."""

    kind: PayloadType
    timestamp: int
    content: bytes


class Packet(msgspec.Struct, frozen=True):
    """One unencrypted RTP packet; ``bytes(packet)`` is the inverse of
    :func:`parse_packet`.

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
    """True on the first packet and after a gap in the sound itself (RFC 3551 section
    4.1)."""
    moving: bool = False
    """Whether the robot moves."""

    def __bytes__(self) -> bytes:
        kind = PayloadType.RED if self.earlier else self.payload.kind
        head = _HEADER.pack(
            _PLAIN | self.moving,
            self.marker << 7 | kind,
            self.sequence,
            self.payload.timestamp % (1 << 32),
            self.ssrc,
        )
        if self.moving:
            head += MOTION
        if not self.earlier:
            return head + self.payload.content
        heads = b""
        contents = b""
        for past in self.earlier:
            behind = (self.payload.timestamp - past.timestamp) % (1 << 32)
            heads += _EARLIER.pack(
                1 << 31 | past.kind << 24 | behind << 10 | len(past.content)
            )
            contents += past.content
        return (
            head + heads + bytes([self.payload.kind]) + contents + self.payload.content
        )


def parse_packet(datagram: bytes) -> Packet:
    """Parse an RTP packet; raises `PacketError` when the bytes are not RTP, or the
    payload type is unknown."""
    if len(datagram) < _HEADER.size:
        raise PacketError(
            f"{len(datagram)} bytes, but an RTP header has {_HEADER.size}; the "
            "datagram was cut"
        )
    first, second, sequence, timestamp, ssrc = _HEADER.unpack_from(datagram)
    if first >> 6 != _VERSION:
        raise PacketError(
            f"RTP version {first >> 6}, but only {_VERSION} exists; this is not an "
            "RTP packet"
        )
    if first == _PLAIN and (kind := _SOUND_KINDS.get(second & 0x7F)) is not None:
        # What our own senders make when nothing is lost: no extras in the header, one
        # payload.
        payload = Payload(kind, timestamp, datagram[_HEADER.size :])
        return Packet(sequence, ssrc, payload, (), second > 0x7F)
    body = _body(datagram, first)
    if second & 0x7F == PayloadType.RED:
        payload, earlier = _read_redundancy(timestamp, body)
    else:
        payload = Payload(_kind(second & 0x7F), timestamp, body)
        earlier = ()
    moving = (
        first & 0x0F == 1
        and datagram[_HEADER.size : _HEADER.size + len(MOTION)] == MOTION
    )
    return Packet(sequence, ssrc, payload, earlier, second > 0x7F, moving)


def ahead(value: int, reference: int, *, bits: int) -> int:
    """Return how far a wrapping counter is ahead of another; negative when it is
    behind.

    >>> ahead(2, 65_534, bits=16), ahead(65_534, 2, bits=16)
    (4, -4)
    """
    half = 1 << (bits - 1)
    return (value - reference + half) % (1 << bits) - half


class TimestampUnwrapper:
    """Turns wrapping timestamps into samples since the first timestamp.

    ``start``: position of the first timestamp.

    ``origin``: the timestamp at position 0; 0 before the first call.

    >>> unwrapper = TimestampUnwrapper()
    >>> [unwrapper.position(timestamp) for timestamp in (2**32 - 100, 140, 20)]
    [0, 240, 120]
    """

    def __init__(self, start: int = 0) -> None:
        self.origin = 0
        self._start = start
        self._newest: int | None = None

    def position(self, timestamp: int) -> int:
        """Return the samples since the first timestamp, whose position is ``start``;
        less for an older one."""
        if self._newest is None:
            self._newest = timestamp
            self.origin = timestamp - self._start
        # As `ahead`, without a call for each packet.
        reached = (
            self._newest
            + (timestamp - self._newest + _HALF_TURN) % (1 << 32)
            - _HALF_TURN
        )
        # Only forwards: a late packet does not move the reference, or the next wrap
        # could be taken for a step back.
        self._newest = max(self._newest, reached)
        return reached - self.origin


def _body(datagram: bytes, first: int) -> bytes:
    """Return what is between the header and the end, without the extras that other
    senders may use.

    These are contributing sources and an extension of the header, and padding at the
    end (RFC 3550 section 5.1).
    """
    start = _HEADER.size + 4 * (first & 0x0F)
    end = len(datagram)
    if first & 0x10:
        if start + _EXTENSION.size > end:
            raise PacketError(
                f"a header extension at byte {start} of {end}; the datagram was cut"
            )
        start += _EXTENSION.size + 4 * _EXTENSION.unpack_from(datagram, start)[1]
    if start > end:
        raise PacketError(
            f"a header of {start} bytes in a datagram of {end}; the datagram was cut"
        )
    padding = datagram[-1] if first & 0x20 else 0
    if first & 0x20 and not 0 < padding <= end - start:
        raise PacketError(
            f"{padding} bytes of padding in a datagram of {end}; its last byte is wrong"
        )
    return datagram[start : end - padding]


def _read_redundancy(
    timestamp: int, body: bytes
) -> tuple[Payload, tuple[Payload, ...]]:
    """Return a packet's own payload, which is the last and takes the rest, and the
    earlier ones."""
    heads: list[tuple[int, int, int]] = []
    position = 0
    size = len(body)
    # Headers with a set first bit announce earlier payloads; the one without announces
    # the packet's own, and has no length. The contents follow in the same order.
    while position < size and body[position] & 0x80:
        if position + _EARLIER.size > size:
            raise PacketError(
                "a redundancy header that ends within; the datagram was cut"
            )
        word = _EARLIER.unpack_from(body, position)[0]
        if len(heads) == MAX_EARLIER:
            raise PacketError(
                f"more than {MAX_EARLIER} earlier payloads, which no sender makes"
            )
        heads.append((word >> 24 & 0x7F, word >> 10 & 0x3FFF, word & 0x3FF))
        position += _EARLIER.size
    if position == size:
        raise PacketError(
            "redundancy without a last header: the packet's own payload is missing"
        )
    own = _kind(body[position])
    position += 1
    earlier: list[Payload] = []
    for number, offset, length in heads:
        if position + length > size:
            raise PacketError(
                f"an earlier payload of {length} bytes, but {size - position} are left"
            )
        content = body[position : position + length]
        earlier.append(
            Payload(_kind(number), (timestamp - offset) % (1 << 32), content)
        )
        position += length
    return Payload(own, timestamp, body[position:]), tuple(earlier)


def _kind(number: int) -> PayloadType:
    """Return the payload type; RED within RED is refused like an unknown type."""
    if (kind := _SOUND_KINDS.get(number)) is not None:
        return kind
    raise PacketError(
        f"payload type {number}, but {PayloadType.L16_MONO} to "
        f"{PayloadType.HAND_PREDICTION} are known"
    )


FRAME_SIZES = (120, 240, 480, 960)
"""Frame sizes at low delay, in samples at 48 kHz, by the two lowest bits of their
configuration (RFC 6716, 3.1)."""

LARGEST_FRAME = 1275
"""Bytes of the largest frame (RFC 6716 section 3.4)."""

LONG_LENGTH = 252
"""Least length of a frame that takes two bytes to write (RFC 6716 section 3.2.1)."""

_CODE = 3
"""Bits of a packet's first byte that say how many frames follow (RFC 6716 section
3.1)."""


def frame_length(size: int) -> bytes:
    """Encode the length of a frame (RFC 6716 section 3.2.1).

    >>> frame_length(251).hex(), frame_length(1275).hex()
    ('fb', 'ffff')
    """
    if size < LONG_LENGTH:
        return bytes([size])
    low = LONG_LENGTH + size % 4
    return bytes([low, (size - low) // 4])


def split_streams(payload: bytes, streams: int) -> list[bytes]:
    """Return a packet of each stream, 1 or 2, where each holds one frame of the same
    kind; nothing otherwise.

    >>> parts = split_streams(bytes([0xE0, 2, 7, 8, 0xE0, 9]), 2)
    >>> parts == [bytes([0xE0, 7, 8]), bytes([0xE0, 9])]
    True
    """
    if streams == 1 or len(payload) < 3:
        return [payload] if payload and streams == 1 else []
    length = payload[1]
    start = 2
    if length >= LONG_LENGTH:
        length += 4 * payload[2]
        start = 3
    end = start + length
    if (
        payload[0] & _CODE
        or not end < len(payload) <= end + 1 + LARGEST_FRAME
        or payload[end] != payload[0]
    ):
        return []
    return [payload[:1] + payload[start:end], payload[end:]]


def join_frames(head: int, frames: list[bytes]) -> bytes:
    """Join frames of the same configuration to a packet of code 3 (RFC 6716 section
    3.2.5)."""
    if len(frames) == 1:
        return bytes([head]) + frames[0]
    if len({len(frame) for frame in frames}) == 1:
        return bytes([head | _CODE, len(frames)]) + b"".join(frames)
    lengths = b"".join(frame_length(len(frame)) for frame in frames[:-1])
    return bytes([head | _CODE, 0x80 | len(frames)]) + lengths + b"".join(frames)


_PREDICTION = struct.Struct("!BBHHHHhI")
"""A prediction as in the table above: touch, flags, three probabilities, roughness,
level and length."""

_FAULTY = 1
"""Flag of a prediction from invalid sound or model output."""

_UNKNOWN = 2
"""Flag of a touch whose evidence has reached neither smooth nor rough."""

_ONE = 65_535
"""A probability or roughness of 1, in 16 bits."""

_SILENT = -32_768
"""A level of -inf dBFS, in hundredths: the lowest number of 16 bits."""


def write_prediction(prediction: Prediction) -> bytes:
    """Encode a prediction without its end, which is the packet's timestamp; non-finite
    values become a fault."""
    shares = (*prediction.probabilities, prediction.roughness)
    if not all(map(math.isfinite, shares)) or math.isnan(prediction.level_dbfs):
        return write_prediction(
            replace(
                prediction,
                probabilities=(1, 0, 0),
                roughness=0,
                level_dbfs=-math.inf,
                faulty=True,
            )
        )
    length = round((prediction.end - prediction.start) * CLOCK_RATE)
    level = round(100 * max(_SILENT / 100, min(prediction.level_dbfs, 327.0)))
    rounded = [round(_ONE * max(0.0, min(share, 1.0))) for share in shares]
    flags = _FAULTY * prediction.faulty | _UNKNOWN * prediction.unknown
    return _PREDICTION.pack(prediction.touch, flags, *rounded, level, max(0, length))


def read_prediction(content: bytes, *, end: float) -> Prediction:
    """Decode a prediction whose window ended at ``end`` seconds.

    Raises `PacketError` when the bytes are not a prediction.
    """
    if len(content) != _PREDICTION.size:
        raise PacketError(
            f"a prediction of {len(content)} bytes, but it has {_PREDICTION.size}"
        )
    touch, flags, *shares, roughness, level, length = _PREDICTION.unpack(content)
    if touch not in list(Touch) or not sum(shares):
        raise PacketError(
            f"a prediction of touch {touch} with probabilities {shares}; there are "
            f"{len(Touch)} touches"
        )
    none, smooth, rough = (share / sum(shares) for share in shares)
    return Prediction(
        probabilities=(none, smooth, rough),
        touch=Touch(touch),
        roughness=roughness / _ONE,
        level_dbfs=-math.inf if level == _SILENT else level / 100,
        start=end - length / CLOCK_RATE,
        end=end,
        faulty=bool(flags & _FAULTY),
        unknown=bool(flags & _UNKNOWN),
    )


def write_predictions(
    predictions: Mapping[int, Prediction], *, fingers: int
) -> tuple[PayloadType, bytes]:
    """Encode predictions by finger, of windows that end together.

    >>> silence = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -60.0, 0.0, 0.256)
    >>> kind, content = write_predictions({1: silence}, fingers=5)
    >>> kind.name, content[:3].hex(" ")
    ('HAND_PREDICTION', '51 00 00')
    """
    if fingers == 1:
        return PayloadType.PREDICTION, write_prediction(predictions[0])
    records = [
        bytes([fingers << 4 | finger]) + write_prediction(each)
        for finger, each in predictions.items()
    ]
    return PayloadType.HAND_PREDICTION, b"".join(records)


def read_predictions(
    payload: Payload, *, end: float
) -> tuple[dict[int, Prediction], int]:
    """Decode predictions whose windows ended at ``end`` seconds; returns them by
    finger, and the number of fingers.

    Raises `PacketError` when the bytes are not predictions of one hand, each of another
    finger.
    """
    if payload.kind == PayloadType.PREDICTION:
        return {0: read_prediction(payload.content, end=end)}, 1
    content = payload.content
    size = 1 + _PREDICTION.size
    records = [content[start : start + size] for start in range(0, len(content), size)]
    predictions = {
        record[0] & 15: read_prediction(record[1:], end=end) for record in records
    }
    counts = {record[0] >> 4 for record in records}
    if len(counts) != 1 or len(predictions) != len(records):
        raise PacketError(
            f"{len(records)} predictions of a hand, but of hands with "
            f"{sorted(counts)} fingers, or twice"
        )
    fingers = counts.pop()
    if not 2 <= fingers <= MOST_FINGERS or max(predictions) >= fingers:
        raise PacketError(
            f"a prediction of finger {max(predictions)} of {fingers}; a hand has 2 to "
            f"{MOST_FINGERS}"
        )
    return predictions, fingers
