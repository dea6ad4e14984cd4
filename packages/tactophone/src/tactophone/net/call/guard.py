"""Keeps strangers' datagrams from a call: what may reach aioice and the session.

An event loop may be told how it opens sockets: this one notes each UDP socket that is
opened in it, whoever opens it, and stands between the socket and its reader.
"""

import asyncio
import contextlib
from collections import Counter
from collections.abc import Callable, Collection
from typing import Any

from tactophone.net.link.packet import is_dtls
from tactophone.net.link.udp import END_OF_STUN, STUN_COOKIE, prepare, set_filter

CALL_WORD = b"\x03\0\0\0" + STUN_COOKIE.to_bytes(4)
"""How every word begins that the two ends' `IceAgent` say to each other over a path. It
has STUN's first byte and cookie, so that it passes every filter, but a length and a
type that no STUN message has."""

BINDING_REQUEST = b"\0\x01"
"""First two bytes of a check of a path (RFC 8489)."""

PERIOD = 1.0
"""Seconds for which datagrams are counted."""

MOST_STUN = 64
"""Maximum STUN messages of a period during a session that the other end has
authenticated, and as many others from its address, which anybody can forge, and from
everybody else. Two ends exchange four in five seconds, and a relay's are not
counted."""

MOST_REPEATS = 7
"""How often an authenticated message is heard: aioice repeats a check six times, and
anybody on the path could repeat it for ever."""

MOST_REMEMBERED = 100_000
"""Authenticated messages that are known again: a day and a half of a call's."""

MOST_SOURCES = 16
"""Maximum addresses from which the other end may check a path to one socket: aioice
keeps each, and checks back."""

MOST_EARLY = 512
"""Maximum datagrams of a period before a session, STUN aside, from where the other end
has checked a path, and as many from everybody else: they wait in aioice until a path is
chosen. A robot sends 400 a second at most."""

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
        self._checks: list[Callable[[bytes], bool]] = []
        self._heard: dict[bytes, int] = {}  # in order of age

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

    def trust(self, authenticates: Callable[[bytes], bool]) -> None:
        """Let pass what this function knows to be the other end's, however much comes
        from its forged address."""
        self._checks.append(authenticates)

    def distrust(self, authenticates: Callable[[bytes], bool]) -> None:
        if authenticates in self._checks:
            self._checks.remove(authenticates)

    def is_authentic(self, message: bytes) -> bool:
        """Whether the other end made a STUN message or a word, and it was not repeated
        too often."""
        if not any(authenticates(message) for authenticates in self._checks):
            return False
        # A request and its answer have one transaction identifier, so the type counts
        # too.
        name = message[:2] + message[8:20]
        while len(self._heard) >= MOST_REMEMBERED:
            del self._heard[next(iter(self._heard))]
        self._heard[name] = self._heard.get(name, 0) + 1
        return self._heard[name] <= MOST_REPEATS

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
        self._checked_from: set[tuple[Any, ...]] = set()
        self._counts: Counter[str] = Counter()
        self._counted_from = loop.time()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._trusts_all = transport.get_extra_info("peername") is not None
        self.reader.connection_made(transport)

    def connection_lost(self, error: Exception | None) -> None:
        self.reader.connection_lost(error)

    def error_received(self, error: Exception) -> None:
        self.reader.error_received(error)

    def datagram_received(self, data: bytes, source: tuple[Any, ...]) -> None:
        if self._trusts_all:
            self.reader.datagram_received(data, source)
        elif self._passes(data, source):
            # aioice raises whatever a malformed message makes it meet, which asyncio
            # would print.
            with contextlib.suppress(Exception):
                self.reader.datagram_received(data, source)

    def _passes(self, data: bytes, source: tuple[Any, ...]) -> bool:
        if data.startswith(CALL_WORD):
            self._loop.note_source(data, str(source[0]))
        is_stun = bool(data) and data[0] < END_OF_STUN
        authentic = is_stun and self._loop.is_authentic(data)
        if authentic and data.startswith(BINDING_REQUEST):
            if len(self._checked_from) < MOST_SOURCES:
                self._checked_from.add(source)
            if source not in self._checked_from:
                return False
        if not self._loop.in_session:
            whose = "its" if source in self._checked_from else "others'"
            return is_stun or self._are_few(f"{whose} early", MOST_EARLY)
        if authentic:
            return self._are_few("authentic", MOST_STUN)
        whose = "its" if source == self._peer else "others'"
        if is_stun:
            return self._are_few(f"{whose} STUN", MOST_STUN)
        if is_dtls(data):
            return self._are_few(f"{whose} handshakes", MOST_HANDSHAKES)
        # The kernel's filter has let pass the other end's streams alone, so this is its
        # address.
        self._peer = source
        return True

    def _are_few(self, kind: str, most: int) -> bool:
        """Count a datagram; false where its period has had ``most`` of its kind."""
        now = self._loop.time()
        if now - self._counted_from >= PERIOD:
            self._counts.clear()
            self._counted_from = now
        self._counts[kind] += 1
        return self._counts[kind] <= most


def _filter(transport: asyncio.DatagramTransport, streams: Collection[int]) -> None:
    set_filter(transport.get_extra_info("socket"), streams, stun=True)
