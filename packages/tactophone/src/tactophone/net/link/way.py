"""The live side's end of a call: a socket of datagrams to the process that keeps the
way to the other end open.

The process of the call (`net.call`) finds the way through two routers, perhaps over a
TURN relay, and passes the session's datagrams on in both directions. Which way that is,
and that it was replaced by another one, the session does not notice.

The live side is started while the way is still searched for, and waits for it.
"""

import contextlib
import json
import select
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from socket import socket
from typing import Any, TypeAlias

from tactophone.core.errors import DeviceError
from tactophone.net.link.packet import Address

Keeper: TypeAlias = socket
"""The live side's end of a pair of sockets, to the process that finds the way and keeps
it open."""

PEER: Address = "100::1", 9
"""The other end's address for the session, whichever way leads there; nobody sends from
it (RFC 6666)."""

DATAGRAM = b"d"
"""First byte of a message between the two processes that holds a datagram."""

WORDS = b"w"
"""First byte of a message between the two processes that holds words for the other one,
as JSON."""

LARGEST_DATAGRAM = 2_048
"""Bytes of a datagram, as in `udp`: a session's have at most 1,200."""

_MOST_AT_ONCE = 256
"""Maximum datagrams of one read: more than half a second of 2.5 ms packets."""


@dataclass(frozen=True, slots=True)
class Way:
    """What the live side learns of a way that was found: the name of the other end, and
    the fingerprint of its key."""

    name: str
    fingerprint: str


class WaySocket(contextlib.AbstractContextManager["WaySocket", None]):
    """As `UdpSocket`, over the way that the keeper has found; closing it leaves the way
    open for a successor.

    The first way is waited for. ``ask`` for it where a process before this one has
    taken it already.
    """

    def __init__(self, keeper: Keeper, *, ask: bool = False) -> None:
        self._keeper = keeper
        self._ended = False
        self._followed: tuple[Address, frozenset[int]] | None = None
        if ask:
            self._say({"wanted": True})
        keeper.setblocking(True)
        self.way = self._await_way()
        keeper.setblocking(False)
        self._poll = select.poll()
        self._poll.register(keeper, select.POLLIN)

    def __exit__(self, *_: object) -> None:
        self.close()

    def fileno(self) -> int:
        return self._keeper.fileno()

    def follow(self, remote: tuple[Address, frozenset[int]] | None) -> None:
        """Let the keeper pass on the sound of these SSRCs alone; of everybody with
        ``None``, when there is no session."""
        if remote == self._followed:
            return
        self._followed = remote
        self._say({"streams": sorted(remote[1]) if remote else []})

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return the datagrams of the other end, oldest first; wait up to ``timeout`` s
        for the first."""
        if self._ended:
            # A closed socket is always ready. The parent learns of the end of the call
            # by itself, and then ends this process too.
            time.sleep(timeout)
            return []
        if timeout > 0:
            self._poll.poll(1000 * timeout)
        datagrams: list[tuple[bytes, Address]] = []
        for _ in range(_MOST_AT_ONCE):
            try:
                message = self._keeper.recv(LARGEST_DATAGRAM + 1)
            except BlockingIOError:
                break
            except OSError:
                message = b""
            if not message:
                self._ended = True
                break
            if message[:1] == DATAGRAM:
                datagrams.append((message[1:], PEER))
        return datagrams

    def send(self, datagrams: Iterable[tuple[bytes, Address]]) -> int:
        """Send each to the other end without waiting; return how many the keeper did
        not take."""
        refused = 0
        for datagram, _ in datagrams:
            try:
                self._keeper.send(DATAGRAM + datagram)
            except OSError:  # it is late, or gone: neither must hold up the sound
                refused += 1
        return refused

    def close(self) -> None:
        """Do nothing: the socket is the parent's, for a successor."""

    def _await_way(self) -> Way:
        # Datagrams for a process before this one may still be in the queue.
        while message := self._keeper.recv(1 << 16):
            if message[:1] == WORDS:
                return Way(**json.loads(message[1:]))
        raise DeviceError("the call has ended")

    def _say(self, words: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            self._keeper.send(write_words(words))


def write_words(words: dict[str, Any]) -> bytes:
    return WORDS + json.dumps(words).encode()


def write_way(way: Way) -> bytes:
    """Encode what the live side learns of a way; `WaySocket` decodes it."""
    return write_words(asdict(way))
