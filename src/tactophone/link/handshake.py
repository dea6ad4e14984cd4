"""One DTLS handshake as values (RFC 6347, RFC 5764): datagrams in, datagrams out, session secrets at its end.

OpenSSL works on memory buffers only, and its retransmission timer is not used because it reads a clock. Instead the
newest flight is retransmitted unchanged until the peer answers it: DTLS drops duplicates.
"""

import hashlib
import hmac
import secrets
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

from OpenSSL import SSL

from tactophone.link.identity import Identity, Peers, fingerprint_of
from tactophone.link.srtp import KEY_SIZE, MAX_DATAGRAM, PROFILE, SALT_SIZE, Secrets

Address: TypeAlias = Hashable
"""Source or destination of a datagram; only compared here, interpreted by the socket."""

FIRST_RETRANSMISSION, MAX_RETRANSMISSION = 0.1, 0.4
"""Seconds until a flight is retransmitted: the first time (above most round-trip times), and at most after doubling."""

HANDSHAKE_TIMEOUT = 3.0
"""Seconds after which a handshake fails; the caller then begins another."""

_RECORD_HEADER = 13
_HELLO_RANDOM = slice(27, 59)
"""Position of a ClientHello's random, after the headers of record and message (RFC 6347 sections 4.1, 4.2)."""

_CIPHERS = b"ECDHE-ECDSA-AES256-GCM-SHA384:ECDHE-ECDSA-CHACHA20-POLY1305"


@dataclass(frozen=True, slots=True)
class Agreement:
    """The result of a handshake: the peer's name and the shared secrets."""

    peer: str
    secrets: Secrets


class Handshakes:
    """Starts handshakes for one identity and its trusted peers."""

    def __init__(self, identity: Identity, peers: Peers) -> None:
        self._peers = peers
        self._cookie_key = secrets.token_bytes(32)
        self._context = self._make_context(identity)

    def call(self, *, now: float) -> "Handshake":
        """Begin a handshake as the caller."""
        connection = self._connection()
        connection.set_connect_state()
        handshake = Handshake(connection, self._peers, calls=True, now=now)
        handshake.step(now)
        return handshake

    def answer(self, hello: bytes, *, source: Address, now: float) -> "tuple[Handshake | None, list[bytes]]":
        """Answer a ClientHello; return the handshake, once the caller has returned its cookie, and the replies.

        Until then no state is kept (RFC 6347 section 4.2.1), so that forged addresses cost no memory.
        """
        connection = self._connection()
        connection.set_app_data((source, hello_random(hello)))
        connection.bio_write(hello)
        try:
            connection.DTLSv1_listen()
        except SSL.Error:
            return None, list(_flight(connection))
        handshake = Handshake(connection, self._peers, calls=False, now=now)
        handshake.step(now)
        return handshake, []

    def _connection(self) -> SSL.Connection:
        connection = SSL.Connection(self._context, None)
        connection.set_ciphertext_mtu(MAX_DATAGRAM)
        return connection

    def _make_context(self, identity: Identity) -> SSL.Context:
        context = SSL.Context(SSL.DTLS_METHOD)
        context.use_privatekey(identity.key)
        context.use_certificate(identity.certificate)
        context.set_cipher_list(_CIPHERS)
        for option in (SSL.OP_COOKIE_EXCHANGE, SSL.OP_NO_QUERY_MTU, SSL.OP_NO_RENEGOTIATION, SSL.OP_NO_TICKET):
            context.set_options(option or 0)
        context.set_session_cache_mode(SSL.SESS_CACHE_OFF)
        context.set_tlsext_use_srtp(PROFILE)
        context.set_cookie_generate_callback(self._cookie)
        context.set_cookie_verify_callback(
            lambda connection, cookie: hmac.compare_digest(self._cookie(connection), cookie)
        )
        context.set_verify(SSL.VERIFY_PEER | SSL.VERIFY_FAIL_IF_NO_PEER_CERT, self._is_trusted)
        return context

    def _is_trusted(self, _: SSL.Connection, certificate: object, error: int, depth: int, ok: int) -> bool:
        """Accept the pinned certificate itself, whatever its issuer; certificates above it do not count."""
        fingerprint = fingerprint_of(certificate.to_cryptography())  # type: ignore[attr-defined]
        return depth == 0 and self._peers.name_of(fingerprint) is not None

    def _cookie(self, connection: SSL.Connection) -> bytes:
        return hmac.digest(self._cookie_key, repr(connection.get_app_data()).encode(), hashlib.sha256)


class Handshake:
    """One attempt to connect with one peer.

    ``outgoing`` returns what to send now. ``agreement`` is set when both ends have authenticated themselves,
    ``failure`` when the handshake cannot succeed any more.
    """

    def __init__(self, connection: SSL.Connection, peers: Peers, *, calls: bool, now: float) -> None:
        self.agreement: Agreement | None = None
        self.failure: str | None = None
        self._connection, self._peers, self._calls = connection, peers, calls
        self._begun, self._sent, self._retransmit_after = now, now, FIRST_RETRANSMISSION
        self._newest_flight: list[bytes] = []
        self._outgoing: list[bytes] = []

    def receive(self, datagram: bytes, *, now: float) -> None:
        """Process a datagram of this handshake."""
        if self.failure or _is_plain_alert(datagram):
            return  # anybody can forge a plain alert, so only time ends a handshake (RFC 6347, 4.1.2.7)
        self._connection.bio_write(datagram)
        if self.agreement is None:
            self.step(now)
        elif not _is_encrypted(datagram):
            self._retransmit(now)  # the peer still retransmits its last flight, so this side's was lost

    def poll(self, now: float) -> None:
        """Retransmit an unanswered flight; fail after `HANDSHAKE_TIMEOUT`."""
        if self.agreement or self.failure:
            return
        if now - self._begun > HANDSHAKE_TIMEOUT:
            self.failure = f"no answer within {HANDSHAKE_TIMEOUT:g} s"
        elif now - self._sent > self._retransmit_after:
            self._retransmit_after = min(2 * self._retransmit_after, MAX_RETRANSMISSION)
            self._retransmit(now)

    def outgoing(self) -> list[bytes]:
        """Return the datagrams to send."""
        ready, self._outgoing = self._outgoing, []
        return ready

    def step(self, now: float) -> None:
        """Let OpenSSL process its input."""
        try:
            self._connection.do_handshake()
            self.agreement = self._agree()
        except SSL.WantReadError:
            pass
        except SSL.Error as error:
            self.failure = _reason(error)
        if flight := list(_flight(self._connection)):
            self._newest_flight, self._retransmit_after, self._sent = flight, FIRST_RETRANSMISSION, now
            self._outgoing += flight

    def _retransmit(self, now: float) -> None:
        if self.agreement and now - self._sent < FIRST_RETRANSMISSION / 2:
            return
        self._sent = now
        self._outgoing += self._newest_flight

    def _agree(self) -> Agreement:
        connection = self._connection
        certificate = connection.get_peer_certificate(as_cryptography=True)
        name = self._peers.name_of(fingerprint_of(certificate)) if certificate else None
        if name is None or connection.get_selected_srtp_profile() != PROFILE:
            raise SSL.Error([("", "", "the peer is not trusted, or does not support AES-256-GCM")])
        return Agreement(name, self._export())

    def _export(self) -> Secrets:
        """Split the exported key material as in RFC 5764 section 4.2; the SSRCs come from a second export."""
        material = self._connection.export_keying_material(b"EXTRACTOR-dtls_srtp", 2 * (KEY_SIZE + SALT_SIZE))
        keys, salts = material[: 2 * KEY_SIZE], material[2 * KEY_SIZE :]
        caller = keys[:KEY_SIZE] + salts[:SALT_SIZE]
        answerer = keys[KEY_SIZE:] + salts[SALT_SIZE:]
        ssrcs = self._connection.export_keying_material(b"EXPORTER-tactophone-ssrc", 8)
        first, second = int.from_bytes(ssrcs[:4]), int.from_bytes(ssrcs[4:])
        if self._calls:
            return Secrets(caller, answerer, local_ssrc=first, remote_ssrc=second)
        return Secrets(answerer, caller, local_ssrc=second, remote_ssrc=first)


def is_hello(datagram: bytes) -> bool:
    """Whether a datagram is a ClientHello, which begins a handshake."""
    return (
        len(datagram) >= _HELLO_RANDOM.stop and datagram[0] == 22 and datagram[13] == 1 and not _is_encrypted(datagram)
    )


def hello_random(hello: bytes) -> bytes:
    """Return the caller's random, which is the same in a retransmitted ClientHello."""
    return hello[_HELLO_RANDOM]


def _is_encrypted(datagram: bytes) -> bool:
    """Whether the first record is encrypted (its epoch is not 0)."""
    return datagram[3:5] != b"\0\0"


def _is_plain_alert(datagram: bytes) -> bool:
    return datagram[:1] == b"\x15" and not _is_encrypted(datagram)


def _flight(connection: SSL.Connection) -> Iterator[bytes]:
    """Return OpenSSL's output as datagrams of whole records; its memory buffer has no datagram boundaries."""
    datagram = b""
    for record in _records(connection):
        if datagram and len(datagram) + len(record) > MAX_DATAGRAM:
            yield datagram
            datagram = b""
        datagram += record
    if datagram:
        yield datagram


def _records(connection: SSL.Connection) -> Iterator[bytes]:
    try:
        written = connection.bio_read(1 << 16)
    except SSL.WantReadError:
        return
    position = 0
    while position < len(written):
        end = position + _RECORD_HEADER + int.from_bytes(written[position + 11 : position + 13])
        yield written[position:end]
        position = end


def _reason(error: SSL.Error) -> str:
    words = error.args[0][-1][-1] if error.args and error.args[0] else "the handshake failed"
    return str(words)
