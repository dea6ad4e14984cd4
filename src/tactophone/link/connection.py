"""The keys of a connected session, from one handshake to the next."""

from collections.abc import Iterator

from tactophone.link.events import Renewed
from tactophone.link.handshake import Address, Agreement, Handshake
from tactophone.link.srtp import SrtpCrypto, is_report

RENEW_AFTER = 11 * 3600.0
"""Seconds after which the caller renews the keys; it then has an hour for it."""

MAX_KEY_AGE = 12 * 3600.0
"""Seconds after which keys that were not renewed end with their session."""

RENEW_PACKETS = 1 << 30
"""Packets after which the caller renews the keys: half of the lower limit, 2**31 of SRTCP (RFC 3711, 9.2)."""

OVERLAP = 2.0
"""Seconds for which packets under the keys before are still accepted: above any delay of the path."""

CONFIRM_TIMEOUT = 10.0
"""Seconds that renewed keys wait for the caller's first packet, and that a handshake repeats its last flight."""

_LAST_SAFE_SEQUENCE = 0xC000
"""Sequence number from which keys are not renewed: the receiver of a new stream takes its first packet as before the
first wrap (RFC 3711 section 3.3.1), so the wrap must not come before that packet."""


class Connection:
    """A connected session: its keys, the peer's address, and its times.

    Attributes
    ----------
    begun, last_received, until
        When the handshake was finished, when the last authentic packet came, and until when the keys are used (s).
    stream
        SSRC of the peer's packets.
    unprotect
        Authenticates and decrypts a datagram (`SrtpCrypto.unprotect`).
    """

    __slots__ = (
        "_crypto",
        "_sent",
        "_sequence",
        "address",
        "agreement",
        "begun",
        "handshake",
        "last_received",
        "stream",
        "unprotect",
        "until",
    )

    def __init__(self, handshake: Handshake, agreement: Agreement, address: Address, now: float) -> None:
        self.handshake, self.agreement, self.address = handshake, agreement, address
        self.begun = self.last_received = now
        self.until = now + MAX_KEY_AGE
        self.stream = agreement.secrets.remote_ssrc
        self._crypto = SrtpCrypto(agreement.secrets)
        self.unprotect = self._crypto.unprotect
        self._sent = self._sequence = 0

    def protect(self, packet: bytes) -> bytes:
        """Encrypt a packet."""
        self._sent += 1
        if not is_report(packet):
            self._sequence = int.from_bytes(packet[2:4])
        return self._crypto.protect(packet)

    @property
    def renewed(self) -> Renewed:
        """The event that the session goes on with this connection."""
        return Renewed(self.agreement.secrets.local_ssrc, self.stream)

    def needs_renewal(self, now: float, *, after: float) -> bool:
        """Whether the keys are to be renewed, and may be now."""
        used_up = now - self.begun > after or self._sent > RENEW_PACKETS
        return used_up and self._sequence < _LAST_SAFE_SEQUENCE


class KeyRing:
    """The connection in use, and while keys are renewed another one beside it.

    Attributes
    ----------
    current
        The connection that packets are sent through; ``None`` without a session.
    beside
        The next connection until the caller uses it, then for a while the one before; else ``None``.
    remote
        The peer's address and the SSRCs of its packets; ``None`` without a session. A new object only when it changes.
    """

    def __init__(self) -> None:
        self._use(None, None)

    def of_stream(self, stream: int) -> Connection | None:
        """Return the connection of a peer's SSRC; ``None`` if there is none."""
        for connection in (self.current, self.beside):
            if connection is not None and connection.stream == stream:
                return connection
        return None

    def __iter__(self) -> Iterator[Connection]:
        return iter([connection for connection in (self.current, self.beside) if connection])

    def replace(self, connection: Connection | None) -> None:
        """Use this connection alone."""
        self._use(connection, None)

    def add(self, connection: Connection, now: float) -> None:
        """Accept packets of renewed keys too, until the caller has used them or was given time enough to."""
        connection.until = now + CONFIRM_TIMEOUT
        self._use(self.current, connection)

    def confirm(self, connection: Connection, now: float) -> bool:
        """Change to renewed keys now that the caller has used them; return whether ``connection`` is of such keys."""
        before = self.current
        if before is None or connection.begun <= before.begun:
            return False
        self._use(connection, before)
        connection.until, before.until = connection.begun + MAX_KEY_AGE, now + OVERLAP
        return True

    def expire(self, now: float) -> None:
        """Forget the connection beside the current one when its time is over."""
        if self.beside and now > self.beside.until:
            self._use(self.current, None)

    def _use(self, current: Connection | None, beside: Connection | None) -> None:
        self.current, self.beside = current, beside
        # Asked for with every packet, so it is computed here.
        streams = frozenset(connection.stream for connection in self)
        self.remote = (current.address, streams) if current else None
