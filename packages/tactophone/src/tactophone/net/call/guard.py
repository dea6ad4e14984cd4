"""Keeps strangers' datagrams from a call: what may reach aioice and the session.

An event loop may be told how it opens sockets: this one notes each UDP socket that is
opened in it, whoever opens it, and stands between the socket and its reader.
"""

import asyncio
from collections import Counter
from collections.abc import Callable, Collection
from typing import Any

from tactophone.net.link.packet import is_dtls
from tactophone.net.link.udp import END_OF_STUN, STUN_COOKIE, prepare, set_filter

CALL_WORD = b"\x03\0\0\0" + STUN_COOKIE.to_bytes(4)
"""How every word begins that the two ends' `IceAgent` say to each other over a path. It
has STUN's first byte and cookie, so that it passes every filter, but a length and a
type that no STUN message has."""

PERIOD = 1.0
"""Seconds for which datagrams are counted."""

MOST_STUN = 64
"""Maximum STUN messages of a period during a session, from the other end, and as many
from everybody else. Two ends exchange four in five seconds, and a relay's are not
counted."""

MOST_HANDSHAKES = 128
"""Maximum DTLS datagrams of a period during a session, from the other end's address,
which anybody can forge, and as many from everybody else: a handshake and its
retransmissions are fewer."""

MOST_WORDS = 64
"""Maximum number of words whose source is remembered."""


class GuardedLoop(asyncio.SelectorEventLoop):
    """An event loop whose UDP sockets drop what belongs to no session, once there is
    one."""

    def __init__(self) -> None:
        super().__init__()
        self._streams: frozenset[int] = frozenset()
        self._opened: set[asyncio.DatagramTransport] = set()
        self._sources: dict[bytes, str] = {}

    async def create_datagram_endpoint(
        self, protocol_factory: Callable[[], Any], *arguments: Any, **options: Any
    ) -> tuple[asyncio.DatagramTransport, Any]:
        transport, guard = await super().create_datagram_endpoint(
            lambda: _Guard(self, protocol_factory()), *arguments, **options
        )
        opened = transport.get_extra_info("socket")
        prepare(opened)
        # Nobody but the relay reaches a socket that is connected to it.
        if transport.get_extra_info("peername") is None:
            self._opened.add(transport)
            _filter(transport, self._streams)
        return transport, guard.reader

    @property
    def in_session(self) -> bool:
        return bool(self._streams)

    def follow(self, streams: Collection[int]) -> None:
        """Let the sound of these SSRCs alone pass; everybody's if there are none."""
        self._streams = frozenset(streams)
        for transport in list(self._opened):
            if transport.is_closing():
                self._opened.discard(transport)
            else:
                _filter(transport, self._streams)

    def note_source(self, word: bytes, source: str) -> None:
        while len(self._sources) >= MOST_WORDS:
            del self._sources[next(iter(self._sources))]
        self._sources[word] = source

    def source_of(self, word: bytes) -> str:
        """Return the address from which a word of the other end came; empty if it came
        through a relay of this end."""
        return self._sources.get(word, "")


class _Guard(asyncio.DatagramProtocol):
    """Stands between one socket and its reader."""

    def __init__(self, loop: GuardedLoop, reader: Any) -> None:
        self.reader = reader
        self._loop = loop
        self._trusts_all = False
        self._peer: tuple[Any, ...] = ()
        self._counts: Counter[tuple[bool, bool]] = Counter()
        self._counted_from = loop.time()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._trusts_all = transport.get_extra_info("peername") is not None
        self.reader.connection_made(transport)

    def connection_lost(self, error: Exception | None) -> None:
        self.reader.connection_lost(error)

    def error_received(self, error: Exception) -> None:
        self.reader.error_received(error)

    def datagram_received(self, data: bytes, source: tuple[Any, ...]) -> None:
        if self._trusts_all or self._passes(data, source):
            self.reader.datagram_received(data, source)

    def _passes(self, data: bytes, source: tuple[Any, ...]) -> bool:
        if data.startswith(CALL_WORD):
            self._loop.note_source(data, str(source[0]))
        if not self._loop.in_session:
            return True
        is_stun = bool(data) and data[0] < END_OF_STUN
        if not (is_stun or is_dtls(data)):
            # The kernel's filter has let pass the other end's streams alone, so this
            # is its address.
            self._peer = source
            return True
        now = self._loop.time()
        if now - self._counted_from >= PERIOD:
            self._counts.clear()
            self._counted_from = now
        kind = is_stun, source == self._peer
        self._counts[kind] += 1
        return self._counts[kind] <= (MOST_STUN if is_stun else MOST_HANDSHAKES)


def _filter(transport: asyncio.DatagramTransport, streams: Collection[int]) -> None:
    set_filter(transport.get_extra_info("socket"), streams, stun=True)
