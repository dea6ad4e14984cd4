"""RTCP reports on the stream (RFC 3550 section 6), encrypted like all packets.

They are sent five times a second, not every five seconds (RFC 4585 permits it), because
redundancy is adapted to them and because their absence shows that the peer is gone.
"""

import re
import struct
from dataclasses import dataclass
from typing import TypeAlias

from tactophone.core.errors import PacketError
from tactophone.net.link.packet import CLOCK_RATE

# Packet types (RFC 3550 section 12.1).
_SENDER = 200
_RECEIVER = 201
_DESCRIPTION = 202
_GOODBYE = 203
_APPLICATION = 204

_TOOL = 6
"""Item of a description that names the program (RFC 3550 section 6.5.6)."""

_PROGRAM = "tactophone "
"""What that item begins with; the version follows."""

_HEAD = struct.Struct("!BBHI")
"""Header of every report: version and count, packet type, length in words less one,
SSRC."""

_SENT = struct.Struct("!QIII")
"""Sender information: NTP time, RTP timestamp, packets and octets sent (RFC 3550
section 6.4.1)."""

_BLOCK = struct.Struct("!IIIIII")
"""Report block: SSRC, losses, highest number, jitter, stamp and age of the last sender
report (RFC 3550 section 6.4.1)."""

_REQUEST = struct.Struct("!4sI")
"""Content of a `ReceiverRequest`: `_NAME`, and a frequency in Hz."""

_NAME = b"TACT"
"""Name of our application packets, in four characters (RFC 3550 section 6.7)."""

_VERSION = 2
"""Version of RTP and RTCP (RFC 3550 section 5.1)."""

_VERSION_TEXT = re.compile(r"[\w.+-]{0,64}", re.ASCII)
"""What a peer may say its version is: a terminal shows it, and a peer chose it."""

NTP_ERA = 2_208_988_800
"""Seconds between the NTP epoch, 1900, and the Unix epoch, 1970 (RFC 868)."""


@dataclass(frozen=True, slots=True)
class ReceiverReport:
    """Reception statistics of the peer's stream."""

    ssrc: int
    of: int
    """`ssrc` and `of`: SSRC of the reporting end, and of the stream that it reports
    on."""
    fraction_lost: float
    """Share of the packets expected since the last report, 0 to 1, before recovery by
    redundancy."""
    lost: int
    """Packets lost since the stream began."""
    highest: int
    """Extended highest sequence number received."""
    jitter: float
    """Interarrival jitter in seconds."""
    last_report: int = 0
    since: float = 0.0
    """`last_report` and `since`: the stamp of the peer's last `SenderReport` (middle 32
    bits of its ``ntp``), and seconds since it was received."""

    def __bytes__(self) -> bytes:
        lost = round(self.fraction_lost * 256)
        block = _BLOCK.pack(
            self.of,
            min(lost, 255) << 24 | max(0, min(self.lost, (1 << 23) - 1)),
            self.highest % (1 << 32),
            min(round(self.jitter * CLOCK_RATE), (1 << 32) - 1),
            self.last_report,
            round(self.since * 65_536) % (1 << 32),
        )
        return _head(_RECEIVER, 1, self.ssrc, block)


@dataclass(frozen=True, slots=True)
class SenderReport:
    """The sender's position in its stream at a time; also keeps the session alive while
    the source is silent."""

    ssrc: int
    ntp: float
    """Seconds since 1970, or of any other clock (RFC 3550 section 6.4.1)."""
    timestamp: int
    """RTP timestamp of the sound at that time."""
    packets: int
    octets: int
    """`packets` and `octets`: sent since the stream began."""

    @property
    def stamp(self) -> int:
        """The middle 32 bits of the NTP time, which the peer returns."""
        return _ntp(self.ntp) >> 16 & 0xFFFFFFFF

    def __bytes__(self) -> bytes:
        sent = _SENT.pack(
            _ntp(self.ntp),
            self.timestamp % (1 << 32),
            self.packets % (1 << 32),
            self.octets % (1 << 32),
        )
        return _head(_SENDER, 0, self.ssrc, sent)


@dataclass(frozen=True, slots=True)
class Goodbye:
    """The peer ends the session, for a reason or none (RFC 3550 section 6.6).

    >>> bytes(Goodbye(1, "busy")).hex(" ", -4)
    '81cb0003 00000001 04627573 79000000'
    """

    ssrc: int
    reason: str = ""

    def __bytes__(self) -> bytes:
        text = self.reason.encode()[:255]
        body = bytes([len(text)]) + text if text else b""
        return _head(_GOODBYE, 1, self.ssrc, body + bytes(-len(body) % 4))


@dataclass(frozen=True, slots=True)
class Introduction:
    r"""The version of the program that an end runs: a description with one item, TOOL
    (RFC 3550 section 6.5.6).

    >>> bytes(Introduction(1, "0.1.0"))
    b'\x81\xca\x00\x06\x00\x00\x00\x01\x06\x10tactophone 0.1.0\x00\x00'
    """

    ssrc: int
    version: str

    def __bytes__(self) -> bytes:
        text = (_PROGRAM + self.version).encode()[:255]
        item = bytes([_TOOL, len(text)]) + text
        # At least one zero byte ends the list of items.
        return _head(_DESCRIPTION, 1, self.ssrc, item + bytes(4 - len(item) % 4))


@dataclass(frozen=True, slots=True)
class ReceiverRequest:
    """The highest frequency in Hz that the operator's model uses (an APP packet, RFC
    3550 section 6.7)."""

    ssrc: int
    bandwidth: int

    def __bytes__(self) -> bytes:
        return _head(_APPLICATION, 0, self.ssrc, _REQUEST.pack(_NAME, self.bandwidth))


Report: TypeAlias = (
    ReceiverReport | SenderReport | Introduction | Goodbye | ReceiverRequest
)


def parse_report(packet: bytes) -> Report:
    """Parse a report; raises `PacketError` when the bytes are not one of the five
    reports above."""
    if len(packet) < _HEAD.size:
        raise PacketError(
            f"{len(packet)} bytes, but a report has at least {_HEAD.size}"
        )
    first, kind, words, ssrc = _HEAD.unpack_from(packet)
    if first >> 6 != _VERSION or len(packet) != 4 * (words + 1):
        raise PacketError(
            f"a report of {len(packet)} bytes that claims {4 * (words + 1)}, version "
            f"{first >> 6}"
        )
    body = packet[_HEAD.size :]
    match kind:
        case 203:
            return Goodbye(ssrc, _text(body))
        case 202 if body[:1] == bytes([_TOOL]) and (
            program := _text(body[1:])
        ).startswith(_PROGRAM):
            if not _VERSION_TEXT.fullmatch(version := program.removeprefix(_PROGRAM)):
                raise PacketError(
                    f"a version of {len(version)} characters; at most 64 letters, "
                    "digits and .+- are one"
                )
            return Introduction(ssrc, version)
        case 201 if len(body) == _BLOCK.size:
            of, losses, highest, jitter, last_report, since = _BLOCK.unpack(body)
            fraction = (losses >> 24) / 256
            lost = losses & 0xFFFFFF
            return ReceiverReport(
                ssrc,
                of,
                fraction,
                lost,
                highest,
                jitter / CLOCK_RATE,
                last_report,
                since / 65_536,
            )
        case 200 if len(body) == _SENT.size:
            ntp, timestamp, packets, octets = _SENT.unpack(body)
            return SenderReport(
                ssrc, ntp / (1 << 32) - NTP_ERA, timestamp, packets, octets
            )
        case 204 if len(body) == _REQUEST.size and body.startswith(_NAME):
            return ReceiverRequest(ssrc, _REQUEST.unpack(body)[1])
    raise PacketError(
        f"an RTCP packet of type {kind} with {len(body)} bytes; 200 to 204 are known"
    )


def round_trip_time(report: ReceiverReport, *, now: float) -> float | None:
    """Return the round-trip time in s, by the answer to a `SenderReport` (RFC 3550,
    6.4.1); ``None`` before one.

    >>> sent = SenderReport(1, ntp=1000.0, timestamp=0, packets=0, octets=0)
    >>> answer = ReceiverReport(
    ...     2, 1, 0.0, 0, 0, 0.0, last_report=sent.stamp, since=0.25
    ... )
    >>> round_trip_time(answer, now=1000.5)
    0.25
    """
    if not report.last_report:
        return None
    elapsed = ((_ntp(now) >> 16 & 0xFFFFFFFF) - report.last_report) % (1 << 32) / 65_536
    return max(0.0, elapsed - report.since)


def _text(field: bytes) -> str:
    """Return the text after a byte with its length, without characters that a terminal
    may interpret."""
    text = field[1 : 1 + field[0]] if field else b""
    return "".join(filter(str.isprintable, text.decode(errors="ignore")))


def _head(kind: int, count: int, ssrc: int, body: bytes) -> bytes:
    return (
        _HEAD.pack(_VERSION << 6 | count, kind, (_HEAD.size + len(body)) // 4 - 1, ssrc)
        + body
    )


def _ntp(time: float) -> int:
    """Return seconds since 1970 as an NTP timestamp (32.32 fixed point)."""
    return int((time + NTP_ERA) * (1 << 32)) % (1 << 64)  # it begins anew in 2036
