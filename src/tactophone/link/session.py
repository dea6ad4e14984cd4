"""A sealed session as values: datagrams and the time go in, events and datagrams come out; no socket, no clock.

One end *calls* (the robot), the other *answers* (the operator). Every start of either makes fresh keys::

              call / hear a proven caller             peers proved
    idle  ─────────────────────────────▶ handshaking ─────────────▶ connected
      ▲                                                                 │
      └──────────────── nothing authentic for `PATIENCE`, or goodbye ───┘

A connected session goes on undisturbed while another handshake runs beside it, and is replaced only by a peer who has
proved who it is: a forged ClientHello disturbs nothing. A caller who hears nothing for `RESTLESS` calls again in
parallel, which is how an operator's restart heals. Each datagram is told by its first byte (RFC 7983).
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

RESTLESS = 1.0
"""Seconds without a word from the peer until a caller calls again; reports come five times a second."""

PATIENCE = 5.0
"""Seconds without a word from the peer until the session is over."""

MOST_HANDSHAKES = 4
"""Handshakes that an answerer keeps at once; each caller among them has shown that it hears us."""

AFTERCARE = 10.0
"""Seconds for which a finished handshake still repeats its last flight to a peer that missed it."""


class DatagramKind(enum.Enum):
    """What a datagram claims to be, by its first byte (RFC 7983 section 7)."""

    DTLS = range(20, 64)
    SEALED = range(128, 192)
    NEITHER = range(0)

    @classmethod
    def of(cls, datagram: bytes) -> "DatagramKind":
        """Tell by the first byte."""
        first = datagram[0] if datagram else -1
        return next((kind for kind in (cls.SEALED, cls.DTLS) if first in kind.value), cls.NEITHER)


@dataclass(frozen=True, slots=True)
class Connected:
    """Both ends have proved who they are; keys are fresh, and so are the streams' names."""

    peer: str
    local_ssrc: int
    remote_ssrc: int


@dataclass(frozen=True, slots=True)
class Disconnected:
    """The session is over."""

    reason: str


@dataclass(frozen=True, slots=True)
class PacketReceived:
    """An authentic packet, opened: RTP, or RTCP where ``report`` is true."""

    packet: bytes
    report: bool


Event: TypeAlias = Connected | Disconnected | PacketReceived


class Session:
    """One end of the line.

    Parameters
    ----------
    identity, peers
        Who we are and whom we accept.
    call
        Whom to call; without it, we wait to be called.

    Attributes
    ----------
    faults
        What was refused, and how often: ``rejected`` datagrams, ``stray`` ones that nobody expected, ``handshakes``
        that failed.
    failure
        Why the newest handshake failed, in words, or ``None``.
    """

    def __init__(self, identity: Identity, peers: Peers, *, call: Address | None = None) -> None:
        self.faults: Counter[str] = Counter()
        self.failure: str | None = None
        self._handshakes = Handshakes(identity, peers)
        self._callee = call
        self._pending: dict[tuple[Address, bytes], Handshake] = {}
        self._current: _Line | None = None
        self._outgoing: list[tuple[bytes, Address]] = []

    @property
    def peer(self) -> str | None:
        """The name of whom we are connected to, or ``None``."""
        return self._current.agreement.peer if self._current else None

    @property
    def refused(self) -> int:
        """How many datagrams came that were no part of a session: forged, changed, replayed or foreign."""
        return self.faults["rejected"] + self.faults["stray"]

    def receive(self, datagram: bytes, *, source: Address, now: float) -> list[Event]:
        """Take a datagram from the network; nothing that is in it can raise."""
        match DatagramKind.of(datagram):
            case DatagramKind.SEALED:
                return self._open(datagram, now)
            case DatagramKind.DTLS:
                return self._shake(datagram, source, now)
        self.faults["stray"] += 1
        return []

    def send(self, packet: bytes) -> None:
        """SrtpCrypto a packet for the peer; dropped, when there is none."""
        if self._current:
            self._outgoing.append((self._current.seal.close(packet), self._current.address))

    def poll(self, now: float) -> list[Event]:
        """Let time pass: repeat, call again, give up. Call it some twenty times a second."""
        for key, handshake in list(self._pending.items()):
            handshake.poll(now)
            self._collect(handshake, key[0])
            if handshake.failure:
                self._forget(key, handshake)
        if self._current and now - self._current.heard > PATIENCE:
            return self._end(f"nothing heard for {PATIENCE:g} s")
        if self._callee is not None and not self._pending and self._is_restless(now):
            self._call(self._callee, now)
        return []

    def hang_up(self) -> list[Event]:
        """Say goodbye, so that the other end need not wait to know."""
        if self._current is None:
            return []
        self.send(bytes(Goodbye(self._current.agreement.secrets.local_ssrc)))
        return self._end("we hung up")

    def outgoing(self) -> list[tuple[bytes, Address]]:
        """Hand over the datagrams to send, and where to."""
        ready, self._outgoing = self._outgoing, []
        return ready

    def _is_restless(self, now: float) -> bool:
        return self._current is None or now - self._current.heard > RESTLESS

    def _open(self, datagram: bytes, now: float) -> list[Event]:
        if self._current is None:
            self.faults["stray"] += 1
            return []
        try:
            packet = self._current.seal.open(datagram)
        except PacketError:
            self.faults["rejected"] += 1
            return []
        self._current.heard = now
        report = is_report(packet)
        if report and is_goodbye(packet):
            return self._end(f"{self._current.agreement.peer} hung up")
        return [PacketReceived(packet, report)]

    def _shake(self, datagram: bytes, source: Address, now: float) -> list[Event]:
        if is_hello(datagram):
            return self._hear_hello(datagram, source, now)
        for key, handshake in list(self._pending.items()):
            if key[0] == source:
                return self._advance(key, handshake, datagram, now)
        if self._current and source == self._current.address and now - self._current.begun < AFTERCARE:
            self._current.handshake.receive(datagram, now=now)
            self._collect(self._current.handshake, source)
        else:
            self.faults["stray"] += 1
        return []

    def _hear_hello(self, hello: bytes, source: Address, now: float) -> list[Event]:
        if self._callee is not None or (source, hello_random(hello)) in self._pending:
            # Ours is to call; and a hello that is repeated needs nothing new: our answer repeats itself.
            return []
        handshake, replies = self._handshakes.answer(hello, source=source, now=now)
        self._outgoing += [(reply, source) for reply in replies]
        if handshake is None:
            return []
        self._make_room(source)
        self._pending[source, hello_random(hello)] = handshake
        self._collect(handshake, source)
        return []

    def _make_room(self, source: Address) -> None:
        """Let each address have one handshake at a time, and all together `MOST_HANDSHAKES`."""
        given_up = [key for key in self._pending if key[0] == source]
        if not given_up and len(self._pending) >= MOST_HANDSHAKES:
            given_up = [next(iter(self._pending))]
        for key in given_up:
            self._forget(key, self._pending[key])

    def _call(self, callee: Address, now: float) -> None:
        handshake = self._handshakes.call(now=now)
        self._pending[callee, b""] = handshake
        self._collect(handshake, callee)

    def _advance(self, key: tuple[Address, bytes], handshake: Handshake, datagram: bytes, now: float) -> list[Event]:
        handshake.receive(datagram, now=now)
        self._collect(handshake, key[0])
        if handshake.failure:
            self._forget(key, handshake)
        if handshake.agreement is None:
            return []
        del self._pending[key]
        return self._begin(_Line(handshake, handshake.agreement, key[0], now))

    def _begin(self, line: "_Line") -> list[Event]:
        self._current, self.failure = line, None
        secrets = line.agreement.secrets
        return [Connected(line.agreement.peer, secrets.local_ssrc, secrets.remote_ssrc)]

    def _end(self, reason: str) -> list[Event]:
        self._current = None
        return [Disconnected(reason)]

    def _forget(self, key: tuple[Address, bytes], handshake: Handshake) -> None:
        del self._pending[key]
        self.faults["handshakes"] += 1
        self.failure = handshake.failure

    def _collect(self, handshake: Handshake, address: Address) -> None:
        self._outgoing += [(datagram, address) for datagram in handshake.outgoing()]


class _Line:
    """A connected session: its keys, whom it reaches and when that was last heard."""

    __slots__ = ("address", "agreement", "begun", "handshake", "heard", "seal")

    def __init__(self, handshake: Handshake, agreement: Agreement, address: Address, now: float) -> None:
        self.handshake, self.agreement, self.address = handshake, agreement, address
        self.seal = SrtpCrypto(agreement.secrets)
        self.begun = self.heard = now
