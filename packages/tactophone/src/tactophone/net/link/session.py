"""An encrypted session as values: datagrams and the time go in, events and datagrams
come out; no socket, no clock.

One end *calls* (the robot), the other *answers* (the operator). Every start of either
end makes fresh keys:

=============  ===============================================  =============
state          what happens                                     next state
=============  ===============================================  =============
idle           a call, or a valid hello                         handshaking
handshaking    the peer is authenticated                        connected
handshaking    failure, or no answer in time                    idle
connected      a call again, a renewal, or a valid hello        rehandshaking
connected      silence for `SESSION_TIMEOUT`, or goodbye        idle
rehandshaking  the handshake has ended, well or not             connected
rehandshaking  the session ends first                           handshaking
=============  ===============================================  =============

A connected session continues undisturbed while another handshake runs beside it, and is
replaced only by the same peer, once it has authenticated itself: a forged ClientHello
has no effect, and another trusted robot is sent away. A caller that receives nothing
for `RECALL_AFTER` calls again in parallel, which is how the link recovers from a
restart of the operator. A caller whose keys are old renews them in the same way, but
the stream continues (`Renewed`). The first byte of a datagram gives its protocol (RFC
7983).
"""

import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Literal

import pylibsrtp

from tactophone.core.errors import PacketError
from tactophone.net.link.events import (
    Connected,
    Disconnected,
    Event,
    PacketReceived,
    Renewed,
)
from tactophone.net.link.handshake import (
    FIRST_RETRANSMISSION,
    REFUSED,
    Admission,
    Agreement,
    Handshake,
    Handshakes,
    Secrets,
    hello_random,
    is_hello,
)
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.packet import Address, is_dtls, is_report, is_srtp, stream_of
from tactophone.net.link.rtcp import Goodbye, Introduction, parse_report

RENEW_AFTER = 11 * 3600.0
"""Seconds after which the caller renews the keys; it then has an hour for it."""

MAX_KEY_AGE = 12 * 3600.0
"""Seconds after which keys that were not renewed end with their session."""

RENEW_PACKETS = 1 << 30
"""Packets after which the caller renews the keys: half of the lower limit, 2**31 of
SRTCP (RFC 3711, 9.2)."""

KEY_OVERLAP = 2.0
"""Seconds for which packets under the keys before are still accepted: above any delay
of the path."""

CONFIRM_TIMEOUT = 10.0
"""Seconds that renewed keys wait for the caller's first packet, and that a handshake
repeats its last flight."""

SessionState = Literal["idle", "handshaking", "connected", "rehandshaking"]

_LAST_SAFE_SEQUENCE = 0xC000
"""Sequence number from which keys are not renewed: the receiver of a new stream takes
its first packet as before the first wrap (RFC 3711 section 3.3.1), so the wrap must not
come before that packet."""


class SrtpCrypto:
    """Encrypts outgoing packets; authenticates and decrypts incoming ones, and refuses
    replays (RFC 3711, RFC 7714).

    Only the peer's one SSRC is accepted: libsrtp would otherwise keep state for every
    SSRC in a forged packet. Belongs to one thread, because libsrtp works in one buffer.
    """

    def __init__(self, secrets: Secrets) -> None:
        self._out = pylibsrtp.Session(_policy(secrets.outbound, secrets.local_ssrc))
        self._in = pylibsrtp.Session(_policy(secrets.inbound, secrets.remote_ssrc))

    def protect(self, packet: bytes) -> bytes:
        if is_report(packet):
            return bytes(self._out.protect_rtcp(packet))
        return bytes(self._out.protect(packet))

    def unprotect(self, datagram: bytes) -> bytes:
        """Authenticate and decrypt a datagram.

        Raises `PacketError` when it was forged, changed, cut or replayed, or is too
        old.
        """
        try:
            if is_report(datagram):
                return bytes(self._in.unprotect_rtcp(datagram))
            return bytes(self._in.unprotect(datagram))
        except (pylibsrtp.Error, ValueError) as error:
            raise PacketError(
                f"a datagram of {len(datagram)} bytes was refused: {error}"
            ) from error


def _policy(key: bytes, ssrc: int) -> pylibsrtp.Policy:
    return pylibsrtp.Policy(
        key=key,
        ssrc_type=pylibsrtp.Policy.SSRC_SPECIFIC,
        ssrc_value=ssrc,
        srtp_profile=pylibsrtp.Policy.SRTP_PROFILE_AEAD_AES_256_GCM,
    )


class Connection:
    """A connected session: its keys, the peer's address, and its times.

    - ``begun``, ``last_received``, ``until``: when the handshake was finished, when the
      last authentic packet came, and until when the keys are used (s).
    - ``stream``: SSRC of the peer's packets.
    - ``unprotect``: authenticates and decrypts a datagram (`SrtpCrypto.unprotect`).
    """

    def __init__(
        self, handshake: Handshake, agreement: Agreement, address: Address, now: float
    ) -> None:
        self.handshake = handshake
        self.agreement = agreement
        self.address = address
        self.begun = self.last_received = now
        self.until = now + MAX_KEY_AGE
        self.stream = agreement.secrets.remote_ssrc
        self._crypto = SrtpCrypto(agreement.secrets)
        self.unprotect = self._crypto.unprotect
        self._sent = self._sequence = 0

    def protect(self, packet: bytes) -> bytes:
        self._sent += 1
        if not is_report(packet):
            self._sequence = int.from_bytes(packet[2:4])
        return self._crypto.protect(packet)

    @property
    def renewed(self) -> Renewed:
        """The event that the session goes on with this connection."""
        return Renewed(self.agreement.secrets.local_ssrc, self.stream)

    def needs_renewal(self, now: float, *, after: float) -> bool:
        used_up = now - self.begun > after or self._sent > RENEW_PACKETS
        return used_up and self._sequence < _LAST_SAFE_SEQUENCE


class KeyRing:
    """The connection in use, and while keys are renewed another one beside it.

    - ``current``: the connection that packets are sent through; ``None`` without a
      session.
    - ``beside``: the next connection until the caller uses it, then for a while the one
      before; else ``None``.
    - ``remote``: the peer's address and the SSRCs of its packets; ``None`` without a
      session. A new object only when it changes.
    """

    def __init__(self) -> None:
        self.use(None)

    def of_stream(self, stream: int) -> Connection | None:
        for connection in (self.current, self.beside):
            if connection is not None and connection.stream == stream:
                return connection
        return None

    def __iter__(self) -> Iterator[Connection]:
        return iter(
            [connection for connection in (self.current, self.beside) if connection]
        )

    def use(self, current: Connection | None, beside: Connection | None = None) -> None:
        """Send through one connection, and accept packets of another one beside it."""
        self.current = current
        self.beside = beside
        # Asked for with every packet, so it is computed here.
        streams = frozenset(connection.stream for connection in self)
        self.remote = (current.address, streams) if current else None

    def add(self, connection: Connection, now: float) -> None:
        """Accept packets of renewed keys too, until the caller has used them or was
        given time enough to."""
        connection.until = now + CONFIRM_TIMEOUT
        self.use(self.current, connection)

    def confirm(self, connection: Connection, now: float) -> bool:
        """Change to renewed keys now that the caller has used them; return whether
        ``connection`` has renewed keys."""
        before = self.current
        if before is None or connection.begun <= before.begun:
            return False
        # The two change places: packets under the keys before may still be on their
        # way.
        self.use(connection, before)
        connection.until = connection.begun + MAX_KEY_AGE
        before.until = now + KEY_OVERLAP
        return True


RECALL_AFTER = 1.0
"""Seconds without a packet from the peer after which a caller calls again; reports are
sent five times a second."""

SESSION_TIMEOUT = 5.0
"""Seconds without a packet from the peer after which the session ends."""

BUSY = "it is connected to another robot, and takes one at a time"
"""The reason that a second trusted caller gets."""

SAME_KEY = (
    "another machine with the same key is connected: delete the key of one of the two, "
    "and run `tactophone pair init` there"
)
"""The reason that a robot gets whose key is at work elsewhere, as after a copied
disk."""

ALIVE = 0.5
"""Seconds after its last packet in which a peer is at work: it sends reports five times
a second."""

INTRODUCTION_PAUSE = 0.1
"""Seconds from a new connection's first introduction to the second; each further pause
is twice the one before, so that one of them arrives over any link, and a run of a day
sends twenty."""

BUSY_PAUSE = 3.0
"""Seconds before a caller that was sent away, or that has refused a peer as taken,
calls again."""


class Session:
    """One end of the link.

    It calls the addresses of ``call`` in turn; without one it waits for a call.
    ``renew_after`` is when a caller renews the keys, in s. ``version`` is what it tells
    the other end of itself, by default nothing.

    - ``faults``: counts of ``rejected`` datagrams, ``stray`` ones that belong to no
      session, failed ``handshakes``, ``contained`` exceptions.
    - ``failure``: why the newest handshake failed, or ``None``.
    - ``sent_away``: name of the trusted caller that was sent away last, and when;
      ``None`` before the first.
    - ``hung_up``: name of the peer that ended the last session without a reason; empty
      if none has.
    """

    def __init__(
        self,
        identity: Identity,
        peers: Peers,
        *,
        call: Address | list[Address] | None = None,
        renew_after: float = RENEW_AFTER,
        version: str = "",
    ) -> None:
        self.faults: Counter[str] = Counter()
        self.failure: str | None = None
        self.sent_away: tuple[str, float] | None = None
        self.hung_up = ""
        self._identity = identity
        self._handshakes = Handshakes(identity, peers)
        self._admission = Admission()
        self._version = version
        self._peer_version = ""
        self._introduce_at = 0.0
        self._callees: list[Address] = []
        if isinstance(call, list):
            self._callees = call
        elif call is not None:
            self._callees = [call]
        self._call_after = -1.0
        self._renew_after = renew_after
        self._pending: dict[tuple[Address, bytes], Handshake] = {}
        self._keys = KeyRing()
        self._outgoing: list[tuple[bytes, Address]] = []

    def trust(self, peers: Peers) -> None:
        """Trust these peers and nobody else from now on; a session with another ends at
        the next `poll`. It may be called from another thread."""
        self._handshakes.trust(peers)

    @property
    def state(self) -> SessionState:
        """Where the session stands in the table at the head of this file: it follows
        from the keys and handshakes that there are, and so cannot contradict them."""
        if self._keys.current:
            return "rehandshaking" if self._pending else "connected"
        return "handshaking" if self._pending else "idle"

    @property
    def peer(self) -> str | None:
        current = self._keys.current
        return current.agreement.peer if current else None

    @property
    def version_conflict(self) -> str:
        """One sentence for the user where the two ends run different versions; else
        empty."""
        if (
            not (self._keys.current and self._version and self._peer_version)
            or self._peer_version == self._version
        ):
            return ""
        return (
            f"{self.peer} runs tactophone {self._peer_version}, this machine "
            f"{self._version}: "
            "update the older one, as the two may not understand each other"
        )

    def leave_to_others(self, others: "Sequence[Session]") -> None:
        """Refuse the peers that other sessions of this end `claims`."""
        self._handshakes.is_taken = lambda fingerprint: any(
            other.claims(fingerprint) for other in others
        )

    def claims(self, fingerprint: str) -> bool:
        """Whether this session is connected to a peer.

        A handshake claims nobody until it ends: a certificate is public, and whoever
        shows it may lack its key.
        """
        current = self._keys.current
        return current is not None and current.agreement.fingerprint == fingerprint

    def call_at(self, addresses: Sequence[Address]) -> None:
        """Call these addresses from now on; a session that there is goes on."""
        if set(addresses) != set(self._callees):
            self._callees = list(addresses)

    @property
    def callees(self) -> Sequence[Address]:
        """The addresses that this end calls in turn; empty where it waits for a
        call."""
        return self._callees

    @property
    def remote(self) -> tuple[Address, frozenset[int]] | None:
        """The peer's address and the SSRCs of its packets, for a socket to filter by;
        ``None`` without a session."""
        return self._keys.remote

    @property
    def refused(self) -> int:
        """Number of datagrams that belong to no session: forged, changed, replayed or
        foreign."""
        return self.faults["rejected"] + self.faults["stray"]

    def receive(self, datagram: bytes, *, source: Address, now: float) -> list[Event]:
        """Process a datagram from the network; no content can make it raise."""
        try:
            if is_srtp(datagram):
                return self._open(datagram, now)
            if is_dtls(datagram):
                return self._handle_dtls(datagram, source, now)
        except Exception as error:
            # The one boundary between bytes of the network and the process: whatever
            # they made a library raise ends the handshake with their sender, and
            # nothing else.
            self._contain(error, source)
            return []
        self.faults["stray"] += 1
        return []

    def send(self, packet: bytes) -> None:
        """Encrypt and queue a packet for the peer; without a session it is dropped."""
        if current := self._keys.current:
            self._outgoing.append((current.protect(packet), current.address))

    def poll(self, now: float) -> list[Event]:
        """Let time pass: retransmit, call again, renew keys, time out. Call it about
        twenty times a second."""
        for key, handshake in list(self._pending.items()) if self._pending else ():
            try:
                handshake.poll(now)
            except Exception as error:
                # As in `receive`: a handshake that makes a library raise ends alone.
                self._contain(error, key[0])
                continue
            self._collect(handshake, key[0])
            if handshake.failure:
                self._drop(key, handshake.failure)
        if self._keys.beside and now > self._keys.beside.until:
            # Its time is over, whether it was the connection before or one that the
            # caller never used.
            self._keys.use(self._keys.current)
        current = self._keys.current
        if self._version and current and now >= self._introduce_at:
            ssrc = current.agreement.secrets.local_ssrc
            self.send(bytes(Introduction(ssrc, self._version)))
            self._introduce_at = now + max(INTRODUCTION_PAUSE, now - current.begun)
        if current and now - current.last_received > SESSION_TIMEOUT:
            return self._end(f"nothing received for {SESSION_TIMEOUT:g} s")
        if current and now > current.until:
            return self._end("the keys were not renewed in time")
        if current and not self._handshakes.trusts(current.agreement.fingerprint):
            return self.hang_up("the other machine no longer trusts this one")
        if self._callees and not self._pending and now > self._call_after:
            self._call(now)
        return []

    def hang_up(self, reason: str = "") -> list[Event]:
        """Send a goodbye, so that the other end need not wait for the timeout; a caller
        shows the reason."""
        if self._keys.current is None:
            return []
        self.send(
            bytes(Goodbye(self._keys.current.agreement.secrets.local_ssrc, reason))
        )
        return self._end("closed on this side")

    def contain(self, error: Exception, *, now: float) -> list[Event]:
        """End the session with a peer whose authentic packets made something raise.

        Whoever owns the session calls this where it handles what a peer sent: a fault
        that one peer can cause ends that peer's session alone, and is counted and
        logged. A caller calls again after a pause.
        """
        self._note_contained(error, self.peer or "the peer")
        self._call_after = now + BUSY_PAUSE
        return self.hang_up(f"an error on the other side ({type(error).__name__})")

    def outgoing(self) -> list[tuple[bytes, Address]]:
        ready = self._outgoing
        self._outgoing = []
        return ready

    def _call(self, now: float) -> None:
        """Begin a handshake if there is no session, if the peer is silent, or if the
        keys are old."""
        current = self._keys.current
        if current is None or now - current.last_received > RECALL_AFTER:
            # An operator that only stood still goes on with the stream; one that is new
            # makes a new one of it.
            continues = current.agreement.continuation if current else b""
            callee = self._callees[0]
            # If this address does not answer, the next call tries the next one.
            self._callees = [*self._callees[1:], callee]
        elif self._keys.beside is None and current.needs_renewal(
            now, after=self._renew_after
        ):
            continues = current.agreement.continuation
            callee = current.address
        else:
            return
        handshake = self._handshakes.call(now=now, continues=continues)
        self._pending[callee, b""] = handshake
        self._collect(handshake, callee)

    def _open(self, datagram: bytes, now: float) -> list[Event]:
        report = is_report(datagram)  # by the header, which is not encrypted
        connection = self._keys.of_stream(stream_of(datagram, report=report))
        if connection is None:
            self.faults["rejected" if self._keys.current else "stray"] += 1
            return []
        try:
            packet = connection.unprotect(datagram)
        except PacketError:
            self.faults["rejected"] += 1
            return []
        # The first packet under renewed keys is the proof that the peer has them too:
        # from now on both ends use them.
        confirmed = self._keys.confirm(connection, now)
        events: list[Event] = [connection.renewed] if confirmed else []
        if current := self._keys.current:
            # Also for a packet under the keys before: it proves that the same peer is
            # alive.
            current.last_received = now
        if not report:
            return [*events, PacketReceived(packet, report)]
        # A report that cannot be read is passed on below: whoever reads the other
        # reports counts it.
        with suppress(PacketError):
            match parse_report(packet):
                case Goodbye(reason=""):
                    self.hung_up = self.peer or ""
                    return [*events, *self._end(f"{self.peer} hung up")]
                case Goodbye(reason=reason):
                    # Sent away, not forgotten: the caller shows why, and calls again
                    # after a pause.
                    self.failure = reason
                    self._call_after = now + BUSY_PAUSE
                    return [*events, *self._end(f"{self.peer} hung up: {reason}")]
                case Introduction(version=version):
                    self._peer_version = version
                    return events
        return [*events, PacketReceived(packet, report)]

    def _handle_dtls(self, datagram: bytes, source: Address, now: float) -> list[Event]:
        if is_hello(datagram):
            self._answer(datagram, source, now)
            return []
        for key, handshake in list(self._pending.items()):
            if key[0] == source:
                return self._advance(key, handshake, datagram, now)
        for connection in self._keys:
            if (
                source == connection.address
                and now - connection.begun < CONFIRM_TIMEOUT
            ):
                connection.handshake.receive(datagram, now=now)
                self._collect(connection.handshake, source)
                return []
        self.faults["stray"] += 1
        return []

    def _answer(self, hello: bytes, source: Address, now: float) -> None:
        # A caller answers no hello. A repeated hello needs nothing new: the pending
        # handshake retransmits its answer.
        key = source, hello_random(hello)
        if self._callees or key in self._pending:
            return
        known = self._handshakes.knows(hello)
        if not self._admission.admits(self._pending, known=known, now=now):
            self.faults["stray"] += 1
            return
        handshake, replies = self._handshakes.answer(hello, source=source, now=now)
        self._outgoing += [(reply, source) for reply in replies]
        if handshake is None:
            return
        for displaced in self._admission.displaced(
            self._pending, source=source, known=known, now=now
        ):
            self._drop(displaced, "another call took its place")
        # The hello names the session that it continues, if any; only the finished
        # handshake proves that it may.
        handshake.known = known
        if self._keys.current and self._keys.current.agreement.continuation in hello:
            handshake.continues = self._keys.current.agreement.continuation
        self._pending[key] = handshake
        self._collect(handshake, source)

    def _advance(
        self,
        key: tuple[Address, bytes],
        handshake: Handshake,
        datagram: bytes,
        now: float,
    ) -> list[Event]:
        handshake.receive(datagram, now=now)
        self._collect(handshake, key[0])
        if handshake.refused:
            self.failure = self._refusal()
        if handshake.agreement and self._handshakes.is_taken(
            handshake.agreement.fingerprint
        ):
            # Two handshakes with one peer ended together: the first to end has it.
            self._handshakes.taken = handshake.agreement.peer
            handshake.failure = "taken"
        if handshake.failure:
            # Whoever answers first may have forged the answer; a pause bounds what the
            # answers cost.
            self._call_after = now + FIRST_RETRANSMISSION
        if handshake.failure and (name := self._handshakes.taken):
            self._handshakes.taken = ""
            self._call_after = now + BUSY_PAUSE
            handshake.failure = (
                f"it is {name!r}, connected already under another "
                "address: name each operator once, and give each machine its own key"
            )
        if handshake.failure:
            self._drop(key, handshake.failure)
            return []
        if handshake.agreement is None:
            return []
        del self._pending[key]
        return self._connect(handshake, handshake.agreement, key[0], now)

    def _connect(
        self, handshake: Handshake, agreement: Agreement, address: Address, now: float
    ) -> list[Event]:
        """Take the keys of a finished handshake: only here is a running session
        replaced, or continued."""
        current = self._keys.current
        if current and current.agreement.fingerprint != agreement.fingerprint:
            # A second trusted caller gets a goodbye with the reason, under its own
            # keys; the first goes on undisturbed.
            self._send_away(agreement, address, BUSY, now)
            return []
        connection = Connection(handshake, agreement, address, now)
        if current and handshake.continues == current.agreement.continuation:
            # The caller cannot decrypt yet: it is sent packets under the new keys once
            # it has sent one. A caller itself changes at once.
            self.failure = None
            self._keys.add(connection, now)
            if self._callees and self._keys.confirm(connection, now):
                return [connection.renewed]
            return []
        if current and self._is_elsewhere(current, address, now):
            self._send_away(agreement, address, SAME_KEY, now)
            return []
        self.failure = None
        self._keys.use(connection)
        self._peer_version = ""
        self._introduce_at = now
        return [
            Connected(
                agreement.peer,
                agreement.secrets.local_ssrc,
                agreement.secrets.remote_ssrc,
            )
        ]

    def _is_elsewhere(self, current: Connection, address: Address, now: float) -> bool:
        """Whether the peer of a session is still at work at another address than a call
        comes from, so that two machines have its key.

        A robot that starts again has been silent for longer, and one whose address
        changed continues its session.
        """
        alive = now - current.last_received < ALIVE
        return alive and address != current.address

    def _send_away(
        self, agreement: Agreement, address: Address, reason: str, now: float
    ) -> None:
        """Say goodbye to a caller under the keys of its own handshake."""
        self.sent_away = agreement.peer, now
        goodbye = bytes(Goodbye(agreement.secrets.local_ssrc, reason))
        self._outgoing.append((SrtpCrypto(agreement.secrets).protect(goodbye), address))

    def _refusal(self) -> str:
        return (
            f"{REFUSED}; if that is the right machine, run there: "
            f"{self._identity.trust_command}; if it trusts this one already, another "
            "machine uses the same key"
        )

    def _end(self, reason: str) -> list[Event]:
        self._keys.use(None)
        return [Disconnected(reason)]

    def _note_contained(self, error: Exception, source: object) -> None:
        self.faults["contained"] += 1
        # At a flood, the log gets the first, second, fourth, eighth... of them.
        if self.faults["contained"].bit_count() == 1:
            _log.warning(
                "a datagram from %s led to %r; its connection was ended", source, error
            )

    def _contain(self, error: Exception, source: Address) -> None:
        self._note_contained(error, source)
        for key in [key for key in self._pending if key[0] == source]:
            self._drop(key, f"the handshake failed ({type(error).__name__})")

    def _drop(self, key: tuple[Address, bytes], failure: str) -> None:
        del self._pending[key]
        self.faults["handshakes"] += 1
        self.failure = self._refusal() if failure == REFUSED else failure

    def _collect(self, handshake: Handshake, address: Address) -> None:
        self._outgoing += [(datagram, address) for datagram in handshake.outgoing()]


_log = logging.getLogger(__name__)
