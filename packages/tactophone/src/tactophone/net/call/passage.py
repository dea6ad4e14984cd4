"""Passes the datagrams of a call on, between the live side and the path in force."""

import asyncio
import contextlib
import json
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from tactophone.core.types import ignore
from tactophone.net.link.call_socket import (
    DATAGRAM,
    LARGEST_DATAGRAM,
    WORDS,
    CallPeer,
    write_peer,
)
from tactophone.net.link.packet import is_report, is_srtp, stream_of

if TYPE_CHECKING:
    from tactophone.net.call.ice import IceAgent

PATH_SILENCE = 1.0
"""Seconds without a packet of the session from the other end, which sends several a
second, after which a new path is asked for. The question is repeated after as long
again."""

SILENCE_TICK = 0.1
"""Seconds from one look for datagrams to the next. Silence is counted in looks and not
measured as a difference of times: a machine that was suspended has heard nothing, but
for another reason."""

QUEUE = 1 << 20
"""Bytes that may wait in the socket to the live side; the system may grant less."""


class Passage:
    """Between the live side's socket and the path in force, whichever that is.

    ``silent`` is set when nothing of the session comes over the path. Calls to begin
    one do not count: an end that hears nothing repeats them, and so may a stranger.
    ``follow`` is told the SSRCs that the live side wants to hear, none of them for all.
    ``prepare`` is called once there is a path, before the first datagram is passed on.
    """

    def __init__(
        self,
        live: socket.socket,
        follow: Callable[[list[int]], None],
        prepare: Callable[[], object] = ignore,
    ) -> None:
        self.silent = asyncio.Event()
        self._live = live
        self._follow = follow
        self._prepare = prepare
        self._agent: IceAgent | None = None
        self._peer = b""
        self._streams: frozenset[int] = frozenset()
        """SSRCs of the session, or of the last one; none before the first."""
        self._heard = False
        self._silence = 0.0
        live.setblocking(False)
        live.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, QUEUE)

    def use(self, agent: "IceAgent", peer: CallPeer) -> None:
        """Send over this path from now on."""
        first = self._agent is None
        self._agent = agent
        self._heard = not first
        # The other end runs already if this is not the first path, but may change to it
        # a little later.
        self._silence = 0.0 if first else -PATH_SILENCE
        agent.deliver = self._deliver
        self._peer = write_peer(peer)
        if first:
            self._prepare()
            self._to_live(self._peer)

    async def run(self) -> None:
        """Pass on what the live side sends, until it and its parent have closed their
        sockets."""
        silence = asyncio.ensure_future(self._watch_silence())
        loop = asyncio.get_running_loop()
        try:
            with contextlib.suppress(OSError):
                while message := await loop.sock_recv(self._live, LARGEST_DATAGRAM + 1):
                    if message[:1] == DATAGRAM:
                        if self._agent:
                            await self._agent.send(message[1:])
                    elif message[:1] == WORDS:
                        self._heed(json.loads(message[1:]))
        finally:
            silence.cancel()

    def _heed(self, words: dict[str, Any]) -> None:
        if "streams" in words:
            self._follow(words["streams"])
            self._streams = frozenset(words["streams"]) or self._streams
        # A live side that starts again has not seen the words for the one before it. It
        # has no session yet, so everybody may begin one.
        if "wanted" in words and self._peer:
            self._follow([])
            self._streams = frozenset()
            self._to_live(self._peer)

    def _deliver(self, datagram: bytes) -> None:
        if not self._streams or self._is_of_session(datagram):
            self._heard = True
            self._silence = 0.0
        self._to_live(DATAGRAM + datagram)

    def _is_of_session(self, datagram: bytes) -> bool:
        stream = stream_of(datagram, report=is_report(datagram))
        return is_srtp(datagram) and stream in self._streams

    def _to_live(self, message: bytes) -> None:
        # The live side may be late, or start again: what does not fit is lost, as in
        # any network.
        with contextlib.suppress(OSError):
            self._live.send(message)

    async def _watch_silence(self) -> None:
        while True:
            await asyncio.sleep(SILENCE_TICK)
            # Not before the first datagram: the other end may still be starting.
            if not self._heard:
                continue
            self._silence += SILENCE_TICK
            if self._silence > PATH_SILENCE:
                self._silence -= PATH_SILENCE
                self.silent.set()
