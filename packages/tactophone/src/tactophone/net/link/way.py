"""The way of a call: a socket that another process opened through two routers, and
keeps open while this one uses it.

The process of the call (`net.call`) has found the way with STUN, perhaps through a TURN
relay, and goes on to answer checks and to refresh what expires. It reads nothing from
the socket any more: the live side does, tells protocols apart by their first byte (RFC
7983), and passes STUN on. Nothing here understands a STUN message.

The live side is started while the way is still searched for, and waits for it. When it
hears nothing any more, it says so; the other process may then find a new way, over
which the session goes on.
"""

import contextlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from socket import recv_fds, send_fds, socket
from typing import Self, TypeAlias

from tactophone.core.errors import DeviceError
from tactophone.net.link.packet import Address
from tactophone.net.link.udp import (
    CHANNEL_HEADER,
    UdpSocket,
    is_stun,
    prepare,
    set_filter,
)

Keeper: TypeAlias = socket
"""The live side's end of a pair of sockets, to the process that finds the way and keeps
it open."""

PEER: Address = "100::1", 9
"""The other end's address for the session, whichever way leads there; nobody sends from
it (RFC 6666)."""

WANTED, READING, SILENT = b"wanted", b"reading", b"silent"
"""What the live side says to the process that keeps the way: a successor needs it, its
datagrams are read here from now on, and it has brought nothing for `WAY_SILENCE`."""

WAY_SILENCE = 1.0
"""Seconds without a datagram of the peer, who sends several a second, until a new way
is asked for, and again."""

_READS = 16
"""Reads from one look for a new way to the next, while the old one still works in one
direction."""


@dataclass(frozen=True, slots=True)
class Way:
    """A found way.

    - ``bound``: the socket: bound, and where the way is relayed connected to the relay.
    - ``peer``: the other end's address; where the way is relayed, as the relay has it.
    - ``channel``: number of the relay's channel to the peer; 0 if the way is direct.
    - ``name``, ``fingerprint``: of the other end.
    """

    bound: socket
    peer: Address
    channel: int
    name: str
    fingerprint: str

    def send(self, live: socket) -> None:
        content = [self.peer, self.channel, self.name, self.fingerprint]
        send_fds(live, [json.dumps(content).encode()], [self.bound.fileno()])

    @classmethod
    def receive(cls, keeper: Keeper) -> Self:
        """Take what `send` has sent; raises `DeviceError` if the other process has
        ended."""
        message, descriptors, *_ = recv_fds(keeper, 1 << 12, 1)
        if not message:
            raise DeviceError("the call has ended")
        (host, port), *content = json.loads(message)
        return cls(socket(fileno=descriptors[0]), (host, port), *content)


class WaySocket(UdpSocket):
    """As `UdpSocket`, over ways that are found; closing it leaves the way open for a
    successor.

    ``keeper`` leads to the process that finds them; the first one is waited for.
    ``ask`` for it where a process before this one has taken it already.
    """

    def __init__(self, keeper: Keeper, *, ask: bool = False) -> None:
        self._keeper, self._silence, self._reads = keeper, -math.inf, 0
        if ask:
            self._say(WANTED)
        keeper.setblocking(True)
        self.way = Way.receive(keeper)
        keeper.setblocking(False)
        self._open()

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return the datagrams of the session; STUN goes to the process that keeps the
        way open."""
        datagrams = super().receive(timeout)
        found = [
            (
                content,
                PEER if self.channel or source in (PEER, self.way.peer) else source,
            )
            for datagram, source in datagrams
            if (content := self._content(datagram, source))
        ]
        self._reads += 1
        if found and found[0][1] == PEER:
            self._silence = 0.0
        elif not datagrams:
            self._silence += timeout  # not before the first datagram: the other end may still be starting
            if self._silence > WAY_SILENCE:
                self._silence -= WAY_SILENCE
                self._say(SILENT)
        if not found or self._reads % _READS == 0:
            with contextlib.suppress(OSError, DeviceError):
                self._change(Way.receive(self._keeper))
        return found

    def send(self, datagrams: Iterable[tuple[bytes, Address]]) -> int:
        """Send to the peer; through a relay each with the header of the channel."""
        if not self.channel:
            return super().send(
                (each, self.way.peer if target == PEER else target)
                for each, target in datagrams
            )
        refused, number = 0, self.channel.to_bytes(2)
        for datagram, _ in datagrams:
            try:
                self._socket.send(number + len(datagram).to_bytes(2) + datagram)
            except OSError:
                refused += 1
        return refused

    def _change(self, way: Way) -> None:
        """Go on over another way; the session notices nothing but what was lost
        meanwhile."""
        followed = self._followed
        self.close()
        self.way = way
        self._open()
        self._silence = (
            -WAY_SILENCE
        )  # the other end runs already: without a word of it, this way has died too
        self.follow(followed)

    def _open(self) -> None:
        prepare(self.way.bound)
        set_filter(
            self.way.bound, ()
        )  # that of a process before this one, which the socket keeps
        self.channel, self._silence = self.way.channel, -math.inf
        super().__init__(bound=self.way.bound)
        self._say(READING)

    def _content(self, datagram: bytes, source: Address) -> bytes:
        """Return what a datagram holds for the session; empty if it holds nothing."""
        content = channel_content(datagram, self.channel) if self.channel else datagram
        if is_stun(content) or is_stun(datagram):
            self._say(write_kept(datagram, self.way.peer if source == PEER else source))
            return b""
        return content

    def _say(self, message: bytes) -> None:
        # A keeper that is late or gone must not hold up the sound.
        with contextlib.suppress(OSError):
            self._keeper.send(message)

    def _connect(self, peer: Address | None) -> None:
        # The socket to a relay is connected already: nobody but the relay reaches it.
        if not self.channel:
            super()._connect(peer and self.way.peer)


def channel_content(datagram: bytes, channel: int) -> bytes:
    """Return what a TURN relay passes on in a channel; empty if the datagram is of
    another one, or cut.

    >>> channel_content(bytes.fromhex("4000 0002 8001 ff"), 0x4000).hex()
    '8001'
    """
    if int.from_bytes(datagram[:2]) != channel:
        return b""
    end = CHANNEL_HEADER + int.from_bytes(datagram[2:CHANNEL_HEADER])
    return datagram[CHANNEL_HEADER:end] if end <= len(datagram) else b""


def write_kept(datagram: bytes, source: Address) -> bytes:
    """Encode a datagram and its source, for the process that keeps the way open."""
    return f"{source[0]} {source[1]}\n".encode() + datagram


def read_kept(message: bytes) -> tuple[bytes, Address]:
    """Decode what `write_kept` encoded; raises `ValueError` if it is something else.

    >>> read_kept(write_kept(b"datagram", ("192.0.2.7", 3478)))
    (b'datagram', ('192.0.2.7', 3478))
    """
    source, _, datagram = message.partition(b"\n")
    host, _, port = source.decode().rpartition(" ")
    return datagram, (host, int(port))
