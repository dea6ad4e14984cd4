"""The way of a call: a socket that another process opened through two routers, and keeps open while this one uses it.

The process of the call (`tactophone.call`) has found the way with STUN, perhaps through a TURN relay, and goes on to
answer checks and to refresh what expires. It reads nothing from the socket any more: the live side does, tells
protocols apart by their first byte (RFC 7983), and passes STUN on. Nothing here understands a STUN message.
"""

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from socket import socket

from tactophone.link.packet import Address
from tactophone.link.udp import CHANNEL_HEADER, END_OF_STUN, UdpSocket, prepare, set_filter


@dataclass(frozen=True)
class Way:
    """A found way; can be passed to a process that is started.

    Attributes
    ----------
    bound
        The socket: bound, and where the way is relayed connected to the relay.
    peer
        The other end's address; where the way is relayed, as the relay has it.
    keeper
        Datagram socket to the process that keeps the way open.
    channel
        Number of the relay's channel to the peer; 0 if the way is direct.
    """

    bound: socket
    peer: Address
    keeper: socket
    channel: int = 0


class WaySocket(UdpSocket):
    """As `UdpSocket`, over a way that was found; closing it leaves the way open for a successor."""

    def __init__(self, way: Way) -> None:
        own = way.bound.dup()
        prepare(own)
        set_filter(own, ())  # that of a process before this one, which the socket keeps
        way.keeper.setblocking(False)
        self._way, self.channel = way, way.channel
        super().__init__(bound=own)
        self._keep(b"", way.peer)  # from now on this process reads

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return the datagrams of the session; STUN goes to the process that keeps the way open."""
        return [
            (content, source if not self.channel else self._way.peer)
            for datagram, source in super().receive(timeout)
            if (content := self._content(datagram, source))
        ]

    def send(self, datagrams: Iterable[tuple[bytes, Address]]) -> int:
        """Send to the peer; through a relay each with the header of the channel."""
        if not self.channel:
            return super().send(datagrams)
        refused, number = 0, self.channel.to_bytes(2)
        for datagram, _ in datagrams:
            try:
                self._socket.send(number + len(datagram).to_bytes(2) + datagram)
            except OSError:
                refused += 1
        return refused

    def _content(self, datagram: bytes, source: Address) -> bytes:
        """Return what a datagram holds for the session; empty if it holds nothing."""
        content = channel_content(datagram, self.channel) if self.channel else datagram
        if is_stun(content) or is_stun(datagram):
            self._keep(datagram, source)
            return b""
        return content

    def _keep(self, datagram: bytes, source: Address) -> None:
        # A keeper that is late or gone must not hold up the sound.
        with contextlib.suppress(OSError):
            self._way.keeper.send(write_kept(datagram, source))

    def _connect(self, peer: Address | None) -> None:
        # The socket to a relay is connected already: nobody but the relay reaches it.
        if not self.channel:
            super()._connect(peer)


def channel_content(datagram: bytes, channel: int) -> bytes:
    """Return what a TURN relay passes on in a channel; empty if the datagram is of another one, or cut.

    >>> channel_content(bytes.fromhex("4000 0002 8001 ff"), 0x4000).hex()
    '8001'
    """
    if int.from_bytes(datagram[:2]) != channel:
        return b""
    end = CHANNEL_HEADER + int.from_bytes(datagram[2:CHANNEL_HEADER])
    return datagram[CHANNEL_HEADER:end] if end <= len(datagram) else b""


def is_stun(datagram: bytes) -> bool:
    """Whether a datagram is for the process that keeps the way open, by its first byte."""
    return bool(datagram) and datagram[0] < END_OF_STUN


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
