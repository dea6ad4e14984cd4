"""What a session reports, and the protocols that its datagrams belong to."""

import enum
from dataclasses import dataclass
from typing import TypeAlias


class DatagramKind(enum.Enum):
    """The protocol of a datagram, by its first byte (RFC 7983 section 7)."""

    DTLS = range(20, 64)
    SRTP = range(128, 192)
    NEITHER = range(0)

    @classmethod
    def of(cls, datagram: bytes) -> "DatagramKind":
        """Return the kind of a datagram."""
        return _KINDS[datagram[0]] if datagram else cls.NEITHER


_KINDS = [
    next((kind for kind in (DatagramKind.SRTP, DatagramKind.DTLS) if first in kind.value), DatagramKind.NEITHER)
    for first in range(256)
]
"""The kind for each first byte: a flood must not cost a search a datagram."""


@dataclass(frozen=True, slots=True)
class Connected:
    """Both ends have authenticated themselves; keys and SSRCs are fresh."""

    peer: str
    local_ssrc: int
    remote_ssrc: int


@dataclass(frozen=True, slots=True)
class Renewed:
    """The session continues under fresh keys and SSRCs; sequence numbers and timestamps run on."""

    local_ssrc: int
    remote_ssrc: int


@dataclass(frozen=True, slots=True)
class Disconnected:
    """The session has ended."""

    reason: str


@dataclass(frozen=True, slots=True)
class PacketReceived:
    """An authentic packet, decrypted: RTP, or RTCP where ``report`` is true."""

    packet: bytes
    report: bool


Event: TypeAlias = Connected | Renewed | Disconnected | PacketReceived
