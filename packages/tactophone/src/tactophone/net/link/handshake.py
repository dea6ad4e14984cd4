"""DTLS handshakes as values (RFC 6347, RFC 5764): datagrams in, datagrams out, the
secrets of a session at the end.

OpenSSL works on memory buffers only. The newest flight is retransmitted unchanged until
the peer answers it: DTLS drops duplicates. OpenSSL's own retransmissions depend on the
wall clock, and are removed (`NewRecords`).

`Admission` bounds the work that unauthenticated hellos can cause. One with the label of
a trusted caller (`call_label`) has places of its own. Anybody else may still call, so
that an untrusted robot gets its refusal, but shares few places and little time with all
other strangers.
"""

import codecs
import hashlib
import hmac
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from OpenSSL import SSL, crypto

from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.packet import MAX_DATAGRAM, Address
from tactophone.net.link.rate_limit import RateLimit

PROFILE = b"SRTP_AEAD_AES_256_GCM"
"""The one SRTP protection profile that both ends offer (RFC 7714 section 14.2)."""

KEY_SIZE = 32
"""Bytes of a master key (RFC 7714 section 12)."""

SALT_SIZE = 12
"""Bytes of a master salt (RFC 7714 section 12)."""


@dataclass(frozen=True, slots=True)
class Secrets:
    """The result of a handshake, seen from one end: SRTP master key and salt, and an
    SSRC, for each direction."""

    outbound: bytes
    inbound: bytes
    local_ssrc: int
    remote_ssrc: int

    def __repr__(self) -> str:
        return (
            f"Secrets(<hidden>, local_ssrc={self.local_ssrc}, "
            f"remote_ssrc={self.remote_ssrc})"
        )


_RECORD_HEADER = 13
"""Bytes of the header of a record (RFC 6347 section 4.1)."""

_HELLO_RANDOM = slice(27, 59)
"""Position of a ClientHello's random, after the headers of record and message (RFC 6347
sections 4.1, 4.2)."""

_CHANGE_CIPHER = 20
"""Type of a record that changes to the new keys (RFC 5246 section 6.2.1)."""

_ALERT = 21
"""Type of a record that holds an alert (RFC 5246 section 6.2.1)."""

_HANDSHAKE = 22
"""Type of a record that holds a handshake message (RFC 5246 section 6.2.1)."""

_CLIENT_HELLO = 1
"""Type of the handshake message that begins a call (RFC 5246 section 7.4)."""

_FATAL = 2
"""Level of an alert that ends the connection (RFC 5246 section 7.2)."""

_CERTIFICATE_ALERTS = tuple(bytes([number]) for number in range(42, 50))
"""Alerts on a certificate: bad, unsupported, revoked, expired, unknown, of an unknown
authority, denied (RFC 5246)."""


def is_hello(datagram: bytes) -> bool:
    return (
        len(datagram) >= _HELLO_RANDOM.stop
        and datagram[0] == _HANDSHAKE
        and datagram[13] == _CLIENT_HELLO
        and not is_encrypted(datagram)
    )


def hello_random(hello: bytes) -> bytes:
    """Return the caller's random, which is the same in a retransmitted ClientHello."""
    return hello[_HELLO_RANDOM]


def is_encrypted(datagram: bytes) -> bool:
    """Whether the first record is encrypted (its epoch is not 0)."""
    return datagram[3:5] != b"\0\0"


class NewRecords:
    """Removes from OpenSSL's output the messages that it has written before.

    OpenSSL has a retransmission timer that reads the wall clock and cannot be turned
    off from here. When a datagram comes more than a second after the newest flight, it
    writes that flight again, *before* the next one: an answerer takes the two together
    for a new call, and a caller that is done for a flight that was lost.

    ``changed_cipher``: whether this end has sent its last message, under the new keys.
    """

    def __init__(self) -> None:
        # What has been written: messages up to this number, and whether the change to
        # the new keys was among them.
        self._messages = 0
        self.changed_cipher = False

    def of(self, written: bytes) -> bytes:
        records = list(_records(written))
        # All are judged by what was written before, and only then noted: a flight holds
        # several of each kind.
        fresh = b"".join(record for record in records if self._is_new(record))
        numbers = [
            _message_number(record) for record in records if _is_plain_message(record)
        ]
        self._messages = max([self._messages, *(number + 1 for number in numbers)])
        self.changed_cipher |= any(record[0] == _CHANGE_CIPHER for record in records)
        return fresh

    def _is_new(self, record: bytes) -> bool:
        if _is_plain_message(record):
            return _message_number(record) >= self._messages
        # Only one flight of each end holds these: the cipher's change, and the
        # encrypted message after it.
        return record[0] not in (_CHANGE_CIPHER, _HANDSHAKE) or not self.changed_cipher


def split_flight(written: bytes) -> Iterator[bytes]:
    """Return OpenSSL's output as datagrams of whole records; its memory buffer has no
    datagram boundaries."""
    datagram = b""
    for record in _records(written):
        if datagram and len(datagram) + len(record) > MAX_DATAGRAM:
            yield datagram
            datagram = b""
        datagram += record
    if datagram:
        yield datagram


def _is_plain_message(record: bytes) -> bool:
    return record[0] == _HANDSHAKE and not is_encrypted(record)


def _message_number(record: bytes) -> int:
    """Return the number of the handshake message in a record (RFC 6347 section
    4.2.2)."""
    return int.from_bytes(record[17:19])


def _records(written: bytes) -> Iterator[bytes]:
    position = 0
    while position < len(written):
        end = (
            position
            + _RECORD_HEADER
            + int.from_bytes(written[position + 11 : position + 13])
        )
        yield written[position:end]
        position = end


FIRST_RETRANSMISSION = 0.1
"""Seconds until a flight is retransmitted for the first time: above most round-trip
times."""

MAX_RETRANSMISSION = 0.4
"""Upper limit, in seconds, of the pause between retransmissions, which doubles."""

# pyOpenSSL uses this codec at the first certificate. It is loaded now, not in a run.
codecs.lookup("charmap")

HANDSHAKE_TIMEOUT = 3.0
"""Seconds after which a handshake fails; the caller then begins another."""

MAX_FLIGHT_DATAGRAMS = 256
"""Datagrams that one handshake processes; it needs 4 to 8, and each of at most 30
retransmissions as many again."""

REFUSED = "it refused this machine's certificate"
"""What a plain alert says; nobody is identified yet, so it may be forged and is only
shown."""

# Level 3 wants 128 bits of everything: P-256 has them, and no signature with SHA-1 is
# offered.
_CIPHERS = b"ECDHE-ECDSA-AES256-GCM-SHA384:ECDHE-ECDSA-CHACHA20-POLY1305:@SECLEVEL=3"


@dataclass(frozen=True, slots=True)
class Agreement:
    """The result of a handshake: the peer's name, its fingerprint, and the shared
    secrets."""

    peer: str
    fingerprint: str
    secrets: Secrets

    @property
    def continuation(self) -> bytes:
        """What only the two ends of this session know: a caller that renews its keys
        puts it in its ClientHello."""
        # The order of the two keys is the same at both ends.
        keys = b"".join(sorted((self.secrets.outbound, self.secrets.inbound)))
        return (
            hmac.digest(keys, b"tactophone continuation", hashlib.sha256)
            .hex()[:32]
            .encode()
        )


class Handshakes:
    """Starts handshakes for one identity and its trusted peers.

    - ``is_taken``: whether a trusted peer, by its fingerprint, is refused because
      another session has it already.
    - ``taken``: name of a peer that was refused as taken; empty if none was. Whoever
      shows a certificate need not have its key, so it is a reason to try later only.
    """

    def __init__(self, identity: Identity, peers: Peers) -> None:
        self.is_taken: Callable[[str], bool] = lambda _: False
        self.taken = ""
        self._cookie_key = secrets.token_bytes(32)
        self._context = self._make_context(identity)
        self._label = call_label(identity.fingerprint)
        self.trust(peers)

    def trust(self, peers: Peers) -> None:
        self._peers = peers
        self._known_labels = [call_label(pin) for _, pin in peers.items()]

    def trusts(self, fingerprint: str) -> bool:
        return self._peers.name_of(fingerprint) is not None

    def call(self, *, now: float, continues: bytes = b"") -> "Handshake":
        """Begin a handshake as the caller, or one that renews the keys of the session
        with this `continuation`."""
        connection = self._connection()
        connection.set_tlsext_host_name(
            b".".join((self._label, continues or b"new", b"tactophone"))
        )
        connection.set_connect_state()
        handshake = Handshake(connection, self._peers, calls=True, now=now)
        handshake.continues = continues
        handshake.step(now)
        return handshake

    def answer(
        self, hello: bytes, *, source: Address, now: float
    ) -> "tuple[Handshake | None, list[bytes]]":
        """Answer a ClientHello; return the handshake, once the caller has returned its
        cookie, and the replies.

        Until then no state is kept (RFC 6347 section 4.2.1), so that forged addresses
        cost no memory.
        """
        connection = self._connection()
        # The cookie proves the address alone: one that answers a call given up serves
        # the call after it.
        connection.set_app_data(source)
        connection.bio_write(hello)
        try:
            connection.DTLSv1_listen()
        except SSL.Error:
            return None, list(split_flight(_written(connection)))
        handshake = Handshake(connection, self._peers, calls=False, now=now)
        handshake.step(now)
        return handshake, []

    def knows(self, hello: bytes) -> bool:
        """Whether a ClientHello carries the `call_label` of a trusted peer."""
        return any(label in hello for label in self._known_labels)

    def _connection(self) -> SSL.Connection:
        connection = SSL.Connection(self._context, None)
        connection.set_ciphertext_mtu(MAX_DATAGRAM)
        return connection

    def _make_context(self, identity: Identity) -> SSL.Context:
        context = SSL.Context(SSL.DTLS_METHOD)
        context.use_privatekey(identity.key)
        context.use_certificate(identity.certificate)
        context.set_cipher_list(_CIPHERS)
        for option in (
            SSL.OP_COOKIE_EXCHANGE,
            SSL.OP_NO_QUERY_MTU,
            SSL.OP_NO_RENEGOTIATION,
            SSL.OP_NO_TICKET,
        ):
            context.set_options(option or 0)
        context.set_session_cache_mode(SSL.SESS_CACHE_OFF)
        context.set_tlsext_use_srtp(PROFILE)
        context.set_cookie_generate_callback(self._cookie)
        context.set_cookie_verify_callback(
            lambda connection, cookie: hmac.compare_digest(
                self._cookie(connection), cookie
            )
        )
        context.set_verify(
            SSL.VERIFY_PEER | SSL.VERIFY_FAIL_IF_NO_PEER_CERT, self._is_trusted
        )
        return context

    def _is_trusted(
        self,
        _: SSL.Connection,
        certificate: crypto.X509,
        error: int,
        depth: int,
        ok: int,
    ) -> bool:
        """Accept the pinned certificate itself, whatever its issuer; certificates above
        it do not count."""
        fingerprint = _fingerprint(certificate)
        name = self._peers.name_of(fingerprint) if depth == 0 else None
        if name is None:
            return False
        if self.is_taken(fingerprint):
            self.taken = name
            return False
        return True

    def _cookie(self, connection: SSL.Connection) -> bytes:
        return hmac.digest(
            self._cookie_key, repr(connection.get_app_data()).encode(), hashlib.sha256
        )


class Handshake:
    """One attempt to connect with one peer.

    ``outgoing`` returns what to send now. ``agreement`` is set when both ends have
    authenticated themselves, ``failure`` when the handshake cannot succeed any more,
    ``refused`` when an alert says that the peer does not accept the certificate, which
    only an authenticated message could prove. ``known`` and ``continues`` are an
    answerer's notes on the ClientHello: whether it bore a trusted peer's label, and the
    `continuation` that it named.
    """

    def __init__(
        self, connection: SSL.Connection, peers: Peers, *, calls: bool, now: float
    ) -> None:
        self.agreement: Agreement | None = None
        self.failure: str | None = None
        self._connection = connection
        self._peers = peers
        self._calls = calls
        self.begun = self._sent = now
        self.refused = self.known = False
        self.continues = b""
        self._retransmit_after = FIRST_RETRANSMISSION
        self._received = 0
        self._new_records = NewRecords()
        self._newest_flight: list[bytes] = []
        self._outgoing: list[bytes] = []

    def receive(self, datagram: bytes, *, now: float) -> None:
        if self.failure:
            return
        if datagram[:1] == bytes([_ALERT]) and not is_encrypted(datagram):
            # Anybody can forge a plain alert, so only time ends a handshake (RFC 6347,
            # 4.1.2.7).
            about_certificate = (
                datagram[13:14] == bytes([_FATAL])
                and datagram[14:15] in _CERTIFICATE_ALERTS
            )
            self.refused |= self.agreement is None and about_certificate
        elif self.agreement is not None:
            # OpenSSL gets no more of it: it would store what nobody reads. If the
            # caller still retransmits its last flight, the answer was lost. A caller
            # that is done answers nothing, or the two would go on for ever.
            if not self._calls and not is_encrypted(datagram):
                self._retransmit(now)
        elif (
            self._calls
            and datagram[:1] == bytes([_CHANGE_CIPHER])
            and not self._new_records.changed_cipher
        ):
            # A late datagram: the last flight of the handshake before. OpenSSL would
            # end this one.
            pass
        elif self._received < MAX_FLIGHT_DATAGRAMS:
            self._received += 1
            self._connection.bio_write(datagram)
            self.step(now)

    def poll(self, now: float) -> None:
        """Retransmit an unanswered flight; fail after `HANDSHAKE_TIMEOUT`."""
        if self.agreement or self.failure:
            return
        if now - self.begun > HANDSHAKE_TIMEOUT:
            # The refusal could not be believed at once; that nothing else came makes it
            # likely.
            self.failure = (
                REFUSED if self.refused else f"no answer within {HANDSHAKE_TIMEOUT:g} s"
            )
        elif now - self._sent > self._retransmit_after:
            self._retransmit_after = min(2 * self._retransmit_after, MAX_RETRANSMISSION)
            self._retransmit(now)

    def outgoing(self) -> list[bytes]:
        ready = self._outgoing
        self._outgoing = []
        return ready

    def step(self, now: float) -> None:
        try:
            self._connection.do_handshake()
            self.agreement = self._agree()
        except SSL.WantReadError:
            pass
        except SSL.Error as error:
            self.failure = _reason(error)
        fresh = self._new_records.of(_written(self._connection))
        if flight := list(split_flight(fresh)):
            # The peer has answered, or nothing new would have been written: the flight
            # before need not be repeated.
            self._newest_flight = flight
            self._retransmit_after = FIRST_RETRANSMISSION
            self._sent = now
            self._outgoing += flight

    def _retransmit(self, now: float) -> None:
        if self.agreement and now - self._sent < FIRST_RETRANSMISSION / 2:
            return
        self._sent = now
        self._outgoing += self._newest_flight

    def _agree(self) -> Agreement:
        connection = self._connection
        certificate = connection.get_peer_certificate()
        fingerprint = _fingerprint(certificate) if certificate else ""
        name = self._peers.name_of(fingerprint)
        if name is None or connection.get_selected_srtp_profile() != PROFILE:
            raise SSL.Error(
                [("", "", "the peer is not trusted, or does not support AES-256-GCM")]
            )
        return Agreement(name, fingerprint, self._export())

    def _export(self) -> Secrets:
        """Split the exported key material as in RFC 5764 section 4.2; the SSRCs come
        from a second export."""
        material = self._connection.export_keying_material(
            b"EXTRACTOR-dtls_srtp", 2 * (KEY_SIZE + SALT_SIZE)
        )
        keys = material[: 2 * KEY_SIZE]
        salts = material[2 * KEY_SIZE :]
        caller = keys[:KEY_SIZE] + salts[:SALT_SIZE]
        answerer = keys[KEY_SIZE:] + salts[SALT_SIZE:]
        ssrcs = self._connection.export_keying_material(b"EXPORTER-tactophone-ssrc", 8)
        first = int.from_bytes(ssrcs[:4])
        second = int.from_bytes(ssrcs[4:])
        if self._calls:
            return Secrets(caller, answerer, local_ssrc=first, remote_ssrc=second)
        return Secrets(answerer, caller, local_ssrc=second, remote_ssrc=first)


def call_label(fingerprint: str) -> bytes:
    """Return the label that a caller with this certificate puts in its ClientHello, as
    32 hexadecimal digits.

    It proves nothing, because whoever observes a call can repeat it. It lets an
    answerer tell the hellos of trusted callers, before any computation, from hellos
    sent by anybody who only knows the address.
    """
    return (
        hashlib.sha256(b"tactophone call " + fingerprint.encode())
        .hexdigest()[:32]
        .encode()
    )


def _written(connection: SSL.Connection) -> bytes:
    try:
        return bytes(connection.bio_read(1 << 16))
    except SSL.WantReadError:
        return b""


def _reason(error: SSL.Error) -> str:
    """Return OpenSSL's words for an error; ``SysCallError`` has a number where others
    have a list."""
    first = error.args[0] if error.args else None
    newest = first[-1] if isinstance(first, list | tuple) and first else None
    if isinstance(newest, list | tuple) and newest:
        return str(newest[-1])
    if first is None or first == []:
        return "the handshake failed"
    return f"the handshake failed ({error})"


def _fingerprint(certificate: crypto.X509) -> str:
    """Return the SHA-256 of the certificate's DER bytes, without parsing them a second
    time."""
    return certificate.digest("sha256").decode()


MAX_HANDSHAKES = 4
"""Concurrent handshakes of trusted callers, and the same number of strangers; each has
returned a cookie."""

STRANGER_TIME = 0.5
"""Seconds for which a stranger's unfinished handshake keeps its place: above the round
trip of most paths."""

KNOWN_RATE = 200.0
"""ClientHellos of trusted callers that are answered in a second. A caller sends 2 for
each handshake, and at most 10 a second."""

STRANGER_RATE = 50.0
"""ClientHellos of strangers that are answered in a second. One costs about 0.1 ms
before its cookie and 1 ms after, so that strangers get at most some 5 % of a
processor."""

HELLO_BURST = 0.5
"""Seconds of the rate that may come at once."""

Pending: TypeAlias = Mapping[tuple[Address, bytes], Handshake]
"""Unfinished handshakes, by address and ClientHello random, oldest first."""


class Admission:
    """Admits hellos, and chooses the unfinished handshake that gives way to another."""

    def __init__(self) -> None:
        self._limits = {
            known: RateLimit(rate, burst=rate * HELLO_BURST)
            for known, rate in ((True, KNOWN_RATE), (False, STRANGER_RATE))
        }

    def admits(self, pending: Pending, *, known: bool, now: float) -> bool:
        """Whether a hello is answered: it must be within the rate, and a stranger's
        hello needs a free place, or one that it may take over."""
        if (
            not known
            and self._is_full(pending, known=False)
            and not self._replaceable(pending, known=False, now=now)
        ):
            return False
        return self._limits[known].take(now)

    def displaced(
        self, pending: Pending, *, source: Address, known: bool, now: float
    ) -> list[tuple[Address, bytes]]:
        """Return the handshakes that end when one from ``source`` begins: the earlier
        one from there, else the oldest if all places are taken."""
        own = [key for key in pending if key[0] == source]
        if own or not self._is_full(pending, known=known):
            return own
        replaceable = self._replaceable(pending, known=known, now=now)
        return [] if replaceable is None else [replaceable]

    def _is_full(self, pending: Pending, *, known: bool) -> bool:
        return (
            sum(handshake.known == known for handshake in pending.values())
            >= MAX_HANDSHAKES
        )

    def _replaceable(
        self, pending: Pending, *, known: bool, now: float
    ) -> tuple[Address, bytes] | None:
        """Return the oldest handshake; ``None`` while it is a stranger's and too young
        to give way."""
        oldest = next(
            (key for key, handshake in pending.items() if handshake.known == known),
            None,
        )
        if oldest is None or known or now - pending[oldest].begun > STRANGER_TIME:
            return oldest
        return None
