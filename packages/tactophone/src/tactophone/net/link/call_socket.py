"""The live side's end of a call: a socket of datagrams to the process that keeps the
path to the other end open.

The process of the call (`net.call`) finds the path through two routers, perhaps over a
TURN relay, and passes the session's datagrams on in both directions. Which path that
is, and that it was replaced by another one, the session does not notice.

The live side is started while the path is still searched for, and waits for it.
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

AgentSocket: TypeAlias = socket
"""The live side's end of a pair of sockets, to the process that finds the path and
keeps it open."""

PEER: Address = "100::1", 9
"""The other end's address for the session, whichever path leads there; nobody sends
from it (RFC 6666)."""

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
class CallPeer:
    """What the live side learns of a path that was found: the name of the other end,
    and the fingerprint of its key."""

    name: str
    fingerprint: str


class CallSocket(contextlib.AbstractContextManager["CallSocket", None]):
    """As `UdpSocket`, over the path that the agent has found; closing it leaves the
    path open for a successor.

    The first path is waited for. ``ask`` for it where a process before this one has
    taken it already.
    """

    def __init__(self, agent: AgentSocket, *, ask: bool = False) -> None:
        self._agent = agent
        self._ended = False
        self._followed: tuple[Address, frozenset[int]] | None = None
        if ask:
            self._say({"wanted": True})
        agent.setblocking(True)
        self.peer = self._await_peer()
        agent.setblocking(False)
        self._poll = select.poll()
        self._poll.register(agent, select.POLLIN)

    def __exit__(self, *_: object) -> None:
        self.close()

    def fileno(self) -> int:
        return self._agent.fileno()

    def follow(self, remote: tuple[Address, frozenset[int]] | None) -> None:
        """Let the agent pass on the sound of these SSRCs alone; of everybody with
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
                message = self._agent.recv(LARGEST_DATAGRAM + 1)
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
        """Send each to the other end without waiting; return how many the agent did
        not take."""
        refused = 0
        for datagram, _ in datagrams:
            try:
                self._agent.send(DATAGRAM + datagram)
            except OSError:  # it is late, or gone: neither must hold up the sound
                refused += 1
        return refused

    def close(self) -> None:
        """Do nothing: the socket is the parent's, for a successor."""

    def _await_peer(self) -> CallPeer:
        # Datagrams for a process before this one may still be in the queue.
        while message := self._agent.recv(1 << 16):
            if message[:1] == WORDS:
                return CallPeer(**json.loads(message[1:]))
        raise DeviceError("the call has ended")

    def _say(self, words: dict[str, Any]) -> None:
        with contextlib.suppress(OSError):
            self._agent.send(write_words(words))


def write_words(words: dict[str, Any]) -> bytes:
    return WORDS + json.dumps(words).encode()


def write_peer(peer: CallPeer) -> bytes:
    """Encode what the live side learns of a path; `CallSocket` decodes it."""
    return write_words(asdict(peer))
