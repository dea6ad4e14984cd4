"""An encrypted session as values: datagrams and the time go in, events and datagrams come out; no socket, no clock.

One end *calls* (the robot), the other *answers* (the operator). Every start of either end makes fresh keys::

              call / valid hello                    both authenticated
    idle  ─────────────────────────────▶ handshaking ─────────────▶ connected
      ▲                                                                 │
      └────── nothing authentic for `SESSION_TIMEOUT`, or goodbye ──────┘

A connected session continues undisturbed while another handshake runs beside it, and is replaced only by a peer that
has authenticated itself: a forged ClientHello has no effect. A caller that receives nothing for `RECALL_AFTER` calls
again in parallel, which is how the link recovers from a restart of the operator. The first byte of a datagram gives its
protocol (RFC 7983).
"""

import enum
from collections import Counter
from dataclasses import dataclass
from typing import TypeAlias

from tactophone.errors import PacketError
from tactophone.link.handshake import Address, Agreement, Handshake, Handshakes, hello_random, is_hello
from tactophone.link.identity import Identity, Peers
from tactophone.link.rtcp import Goodbye, is_goodbye
from tactophone.link.srtp import SrtpCrypto, is_report

RECALL_AFTER = 1.0
"""Seconds without a packet from the peer after which a caller calls again; reports are sent five times a second."""

SESSION_TIMEOUT = 5.0
"""Seconds without a packet from the peer after which the session ends."""

MAX_HANDSHAKES = 4
"""Concurrent handshakes of an answerer; each of their callers has returned a cookie."""

LINGER = 10.0
"""Seconds for which a finished handshake still repeats its last flight to a peer that missed it."""


class DatagramKind(enum.Enum):
    """The protocol of a datagram, by its first byte (RFC 7983 section 7)."""

    DTLS = range(20, 64)
    SRTP = range(128, 192)
    NEITHER = range(0)

    @classmethod
    def of(cls, datagram: bytes) -> "DatagramKind":
        """Return the kind of a datagram."""
        first = datagram[0] if datagram else -1
        return next((kind for kind in (cls.SRTP, cls.DTLS) if first in kind.value), cls.NEITHER)


@dataclass(frozen=True, slots=True)
class Connected:
    """Both ends have authenticated themselves; keys and SSRCs are fresh."""

    peer: str
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


Event: TypeAlias = Connected | Disconnected | PacketReceived


class Session:
    """One end of the link.

    Parameters
    ----------
    identity, peers
        The local identity, and the identities accepted.
    call
        The address to call; without it, the session waits for a call.

    Attributes
    ----------
    faults
        Counts of ``rejected`` datagrams, ``stray`` ones that belong to no session, failed ``handshakes``.
    failure
        Why the newest handshake failed, or ``None``.
    """

    def __init__(self, identity: Identity, peers: Peers, *, call: Address | None = None) -> None:
        self.faults: Counter[str] = Counter()
        self.failure: str | None = None
        self._handshakes = Handshakes(identity, peers)
        self._callee = call
        self._pending: dict[tuple[Address, bytes], Handshake] = {}
        self._current: _Connection | None = None
        self._outgoing: list[tuple[bytes, Address]] = []

    @property
    def peer(self) -> str | None:
        """Name of the connected peer, or ``None``."""
        return self._current.agreement.peer if self._current else None

    @property
    def refused(self) -> int:
        """Number of datagrams that belong to no session: forged, changed, replayed or foreign."""
        return self.faults["rejected"] + self.faults["stray"]

    def receive(self, datagram: bytes, *, source: Address, now: float) -> list[Event]:
        """Process a datagram from the network; no content can make it raise."""
        match DatagramKind.of(datagram):
            case DatagramKind.SRTP:
                return self._open(datagram, now)
            case DatagramKind.DTLS:
                return self._handle_dtls(datagram, source, now)
        self.faults["stray"] += 1
        return []

    def send(self, packet: bytes) -> None:
        """Encrypt and queue a packet for the peer; it is dropped when there is none."""
        if self._current:
            self._outgoing.append((self._current.crypto.protect(packet), self._current.address))

    def poll(self, now: float) -> list[Event]:
        """Let time pass: retransmit, call again, time out. Call it about twenty times a second."""
        for key, handshake in list(self._pending.items()):
            handshake.poll(now)
            self._collect(handshake, key[0])
            if handshake.failure:
                self._drop(key, handshake)
        if self._current and now - self._current.last_received > SESSION_TIMEOUT:
            return self._end(f"nothing received for {SESSION_TIMEOUT:g} s")
        if self._callee is not None and not self._pending and self._should_call(now):
            handshake = self._handshakes.call(now=now)
            self._pending[self._callee, b""] = handshake
            self._collect(handshake, self._callee)
        return []

    def hang_up(self) -> list[Event]:
        """Send a goodbye, so that the other end need not wait for the timeout."""
        if self._current is None:
            return []
        self.send(bytes(Goodbye(self._current.agreement.secrets.local_ssrc)))
        return self._end("closed on this side")

    def outgoing(self) -> list[tuple[bytes, Address]]:
        """Return the datagrams to send, each with its address."""
        ready, self._outgoing = self._outgoing, []
        return ready

    def _should_call(self, now: float) -> bool:
        return self._current is None or now - self._current.last_received > RECALL_AFTER

    def _open(self, datagram: bytes, now: float) -> list[Event]:
        if self._current is None:
            self.faults["stray"] += 1
            return []
        try:
            packet = self._current.crypto.unprotect(datagram)
        except PacketError:
            self.faults["rejected"] += 1
            return []
        self._current.last_received = now
        report = is_report(packet)
        if report and is_goodbye(packet):
            return self._end(f"{self._current.agreement.peer} hung up")
        return [PacketReceived(packet, report)]

    def _handle_dtls(self, datagram: bytes, source: Address, now: float) -> list[Event]:
        if is_hello(datagram):
            self._answer(datagram, source, now)
            return []
        for key, handshake in list(self._pending.items()):
            if key[0] == source:
                return self._advance(key, handshake, datagram, now)
        if self._current and source == self._current.address and now - self._current.begun < LINGER:
            self._current.handshake.receive(datagram, now=now)
            self._collect(self._current.handshake, source)
        else:
            self.faults["stray"] += 1
        return []

    def _answer(self, hello: bytes, source: Address, now: float) -> None:
        # A caller answers no hello. A repeated hello needs nothing new: the pending handshake retransmits its answer.
        if self._callee is not None or (source, hello_random(hello)) in self._pending:
            return
        handshake, replies = self._handshakes.answer(hello, source=source, now=now)
        self._outgoing += [(reply, source) for reply in replies]
        if handshake is None:
            return
        self._make_room(source)
        self._pending[source, hello_random(hello)] = handshake
        self._collect(handshake, source)

    def _make_room(self, source: Address) -> None:
        """Limit the handshakes to one for each address, and to `MAX_HANDSHAKES` in all."""
        dropped = [key for key in self._pending if key[0] == source]
        if not dropped and len(self._pending) >= MAX_HANDSHAKES:
            dropped = [next(iter(self._pending))]
        for key in dropped:
            self._drop(key, self._pending[key])

    def _advance(self, key: tuple[Address, bytes], handshake: Handshake, datagram: bytes, now: float) -> list[Event]:
        handshake.receive(datagram, now=now)
        self._collect(handshake, key[0])
        if handshake.failure:
            self._drop(key, handshake)
        if handshake.agreement is None:
            return []
        del self._pending[key]
        # Only here is a running session replaced: the new peer has authenticated itself.
        self._current, self.failure = _Connection(handshake, handshake.agreement, key[0], now), None
        secrets = handshake.agreement.secrets
        return [Connected(handshake.agreement.peer, secrets.local_ssrc, secrets.remote_ssrc)]

    def _end(self, reason: str) -> list[Event]:
        self._current = None
        return [Disconnected(reason)]

    def _drop(self, key: tuple[Address, bytes], handshake: Handshake) -> None:
        del self._pending[key]
        self.faults["handshakes"] += 1
        self.failure = handshake.failure

    def _collect(self, handshake: Handshake, address: Address) -> None:
        self._outgoing += [(datagram, address) for datagram in handshake.outgoing()]


class _Connection:
    """A connected session: its keys, the peer's address, and the time of the last authentic packet."""

    __slots__ = ("address", "agreement", "begun", "crypto", "handshake", "last_received")

    def __init__(self, handshake: Handshake, agreement: Agreement, address: Address, now: float) -> None:
        self.handshake, self.agreement, self.address = handshake, agreement, address
        self.crypto = SrtpCrypto(agreement.secrets)
        self.begun = self.last_received = now
