"""The seal on every packet: SRTP with AES-256-GCM (RFC 3711, RFC 7714), under keys of one session only."""

from dataclasses import dataclass

from pylibsrtp import Error, Policy, Session

from tactophone.errors import PacketError

PROFILE = b"SRTP_AEAD_AES_256_GCM"
KEY_SIZE, SALT_SIZE = 32, 12
"""Bytes of master key and salt (RFC 7714 section 12)."""

OVERHEAD = 16
"""Bytes that the seal adds to a packet: the whole GCM tag."""

LARGEST_SEALED = 1_280 - 48
"""Bytes of a datagram at most: IPv6's smallest guaranteed path (RFC 8200), less its headers and UDP's."""


@dataclass(frozen=True, slots=True)
class Secrets:
    """What the two ends agreed upon, seen from one of them: an SRTP master key and salt, and a stream, each way."""

    outbound: bytes
    inbound: bytes
    local_ssrc: int
    remote_ssrc: int

    def __repr__(self) -> str:
        return f"Secrets(<hidden>, local_ssrc={self.local_ssrc}, remote_ssrc={self.remote_ssrc})"


class SrtpCrypto:
    """Seals what leaves and opens what comes; refuses whatever is not from the peer, or comes twice.

    Only the peer's one stream is let in: libsrtp would otherwise keep state for every stream that is named to it.
    Belongs to one thread, because libsrtp works in one buffer.
    """

    def __init__(self, secrets: Secrets) -> None:
        self.local_ssrc, self.remote_ssrc = secrets.local_ssrc, secrets.remote_ssrc
        self._out = Session(_policy(secrets.outbound, secrets.local_ssrc))
        self._in = Session(_policy(secrets.inbound, secrets.remote_ssrc))

    def close(self, packet: bytes) -> bytes:
        """SrtpCrypto an RTP packet or an RTCP report."""
        if is_report(packet):
            return bytes(self._out.protect_rtcp(packet))
        return bytes(self._out.protect(packet))

    def open(self, datagram: bytes) -> bytes:
        """Check and open what came; `PacketError` when it was forged, changed, cut, replayed or is too old."""
        try:
            if is_report(datagram):
                return bytes(self._in.unprotect_rtcp(datagram))
            return bytes(self._in.unprotect(datagram))
        except (Error, ValueError) as error:
            raise PacketError(f"a datagram of {len(datagram)} bytes was refused: {error}") from error


def is_report(packet: bytes) -> bool:
    """Tell RTCP from RTP by its second byte (RFC 5761 section 4)."""
    return len(packet) > 1 and 64 <= packet[1] & 0x7F <= 95


def _policy(key: bytes, ssrc: int) -> Policy:
    return Policy(
        key=key, ssrc_type=Policy.SSRC_SPECIFIC, ssrc_value=ssrc, srtp_profile=Policy.SRTP_PROFILE_AEAD_AES_256_GCM
    )
