"""Encryption and authentication of packets: SRTP with AES-256-GCM (RFC 3711, RFC 7714), keys of one session."""

from dataclasses import dataclass

from pylibsrtp import Error, Policy, Session

from tactophone.errors import PacketError

PROFILE = b"SRTP_AEAD_AES_256_GCM"
KEY_SIZE, SALT_SIZE = 32, 12
"""Bytes of master key and salt (RFC 7714 section 12)."""

OVERHEAD = 16
"""Bytes that SRTP adds to a packet: the full GCM tag."""

MAX_DATAGRAM = 1_280 - 48
"""Maximum bytes of a datagram: the minimum MTU of IPv6 (RFC 8200) without the headers of IPv6 and UDP."""


@dataclass(frozen=True, slots=True)
class Secrets:
    """The result of a handshake, seen from one end: SRTP master key and salt, and an SSRC, for each direction."""

    outbound: bytes
    inbound: bytes
    local_ssrc: int
    remote_ssrc: int

    def __repr__(self) -> str:
        return f"Secrets(<hidden>, local_ssrc={self.local_ssrc}, remote_ssrc={self.remote_ssrc})"


class SrtpCrypto:
    """Encrypts outgoing packets; authenticates and decrypts incoming ones, and refuses replays.

    Only the peer's one SSRC is accepted: libsrtp would otherwise keep state for every SSRC in a forged packet.
    Belongs to one thread, because libsrtp works in one buffer.
    """

    def __init__(self, secrets: Secrets) -> None:
        self.local_ssrc, self.remote_ssrc = secrets.local_ssrc, secrets.remote_ssrc
        self._out = Session(_policy(secrets.outbound, secrets.local_ssrc))
        self._in = Session(_policy(secrets.inbound, secrets.remote_ssrc))

    def protect(self, packet: bytes) -> bytes:
        """Encrypt an RTP packet or an RTCP report."""
        if is_report(packet):
            return bytes(self._out.protect_rtcp(packet))
        return bytes(self._out.protect(packet))

    def unprotect(self, datagram: bytes) -> bytes:
        """Authenticate and decrypt a datagram.

        Raises `PacketError` when it was forged, changed, cut or replayed, or is too old.
        """
        try:
            if is_report(datagram):
                return bytes(self._in.unprotect_rtcp(datagram))
            return bytes(self._in.unprotect(datagram))
        except (Error, ValueError) as error:
            raise PacketError(f"a datagram of {len(datagram)} bytes was refused: {error}") from error


def is_report(packet: bytes) -> bool:
    """Whether a packet is RTCP, not RTP, by its second byte (RFC 5761 section 4)."""
    return len(packet) > 1 and 64 <= packet[1] & 0x7F <= 95


def stream_of(packet: bytes, *, report: bool) -> int:
    """Return the SSRC in the clear header of RTP, or of RTCP (`report`); -1 when the packet is too short for one."""
    field = packet[4:8] if report else packet[8:12]
    return int.from_bytes(field) if len(field) == 4 else -1


def _policy(key: bytes, ssrc: int) -> Policy:
    return Policy(
        key=key, ssrc_type=Policy.SSRC_SPECIFIC, ssrc_value=ssrc, srtp_profile=Policy.SRTP_PROFILE_AEAD_AES_256_GCM
    )
