"""What strangers send to the punched port of a call."""

import asyncio
import socket
import struct
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from tactophone.net.call.guard import (
    CALL_WORD,
    MOST_EARLY,
    MOST_HANDSHAKES,
    MOST_REPEATS,
    MOST_SOURCES,
    MOST_STUN,
    GuardedLoop,
)
from tactophone.net.link.udp import STUN_COOKIE

STREAM = 0x01020304
SRTP = b"\x80\x60" + bytes(6) + STREAM.to_bytes(4) + b"sound"
FOREIGN = b"\x80\x60" + bytes(6) + b"\xff\xff\xff\xff" + b"sound"
STUN = b"\x01\x01\0\0" + STUN_COOKIE.to_bytes(4) + bytes(12)
HELLO = b"\x16\xfe\xfd hello"


class Reader(asyncio.DatagramProtocol):
    def __init__(self) -> None:
        self.heard: list[bytes] = []

    def datagram_received(self, data: bytes, source: tuple[Any, ...]) -> None:
        self.heard.append(data)


class Port:
    """A guarded port, its reader, and two that send there."""

    def __init__(self, loop: GuardedLoop, reader: Reader, address: Any) -> None:
        self.loop = loop
        self.reader = reader
        self.address = address
        self.peer, self.stranger = (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)
        )

    async def hears(self, source: socket.socket, *datagrams: bytes) -> list[bytes]:
        """Return what reaches the reader; the last datagram is one that does."""
        self.reader.heard.clear()
        for number, each in enumerate(datagrams):
            source.sendto(each, self.address)
            # A queue of the system holds a few hundred.
            if number % 64 == 0:
                await asyncio.sleep(0)
        while not self.reader.heard or self.reader.heard[-1] != datagrams[-1]:
            await asyncio.sleep(0.001)
        return list(self.reader.heard)


def at_a_port(run: Callable[[Port], Coroutine[Any, Any, None]]) -> None:
    loop = GuardedLoop()

    async def main() -> None:
        transport, reader = await loop.create_datagram_endpoint(
            Reader, local_addr=("127.0.0.1", 0)
        )
        port = Port(loop, reader, transport.get_extra_info("sockname"))
        with port.peer, port.stranger:
            await asyncio.wait_for(run(port), 30.0)
        transport.close()

    try:
        loop.run_until_complete(main())
    finally:
        loop.close()


def test_anybody_may_begin_a_session_then_foreign_sound_stays_in_the_kernel() -> None:
    async def run(port: Port) -> None:
        assert await port.hears(port.stranger, FOREIGN) == [FOREIGN]
        port.loop.follow({STREAM})
        assert await port.hears(port.stranger, FOREIGN, b"\0" * 60, SRTP) == [SRTP]
        port.loop.follow(())
        assert await port.hears(port.stranger, FOREIGN) == [FOREIGN]

    at_a_port(run)


@pytest.mark.parametrize(
    ("datagram", "most"), [(STUN, MOST_STUN), (HELLO, MOST_HANDSHAKES)]
)
def test_strangers_who_flood_use_up_their_own_share_and_not_the_peers(
    monkeypatch: pytest.MonkeyPatch, datagram: bytes, most: int
) -> None:
    monkeypatch.setattr("tactophone.net.call.guard.PERIOD", 1_000.0)

    async def run(port: Port) -> None:
        port.loop.follow({STREAM})
        await port.hears(port.peer, SRTP)
        # The stranger's last is sound that only a forger could send; it ends the count.
        heard = await port.hears(port.peer, *[datagram] * (2 * most), SRTP)
        assert heard.count(datagram) == most
        stranger = [datagram] * (2 * most)
        for each in stranger:
            port.stranger.sendto(each, port.address)
        heard = await port.hears(port.peer, SRTP)
        assert heard.count(datagram) <= most
        assert heard[-1] == SRTP

    at_a_port(run)


def test_a_flood_is_bounded_in_every_period_of_a_long_call(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tactophone.net.call.guard.PERIOD", 10.0)

    async def run(port: Port) -> None:
        port.loop.follow({STREAM})
        await port.hears(port.peer, SRTP)
        time = port.loop.time
        monkeypatch.setattr(port.loop, "time", lambda: time() + 15.0)
        heard = await port.hears(port.peer, *[STUN] * (2 * MOST_STUN), SRTP)
        assert heard.count(STUN) == MOST_STUN

    at_a_port(run)


def check(number: int) -> bytes:
    """A check of a path, which the tests' other end has authenticated."""
    name = number.to_bytes(12)
    return b"\0\x01\0\0" + STUN_COOKIE.to_bytes(4) + name + b"authentic"


def is_authentic(message: bytes) -> bool:
    return message.endswith(b"authentic")


def test_what_the_other_end_authenticates_passes_a_flood_from_its_forged_address(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tactophone.net.call.guard.PERIOD", 1_000.0)

    async def run(port: Port) -> None:
        port.loop.trust(is_authentic)
        port.loop.follow({STREAM})
        await port.hears(port.peer, SRTP)
        heard = await port.hears(port.peer, *[STUN] * (3 * MOST_STUN), check(1))
        assert heard.count(STUN) == MOST_STUN
        repeated = await port.hears(port.peer, *[check(2)] * 3 * MOST_STUN, check(3))
        assert repeated.count(check(2)) == MOST_REPEATS
        many = [check(number) for number in range(10, 10 + 2 * MOST_STUN)]
        heard = await port.hears(port.peer, *many, SRTP)
        assert MOST_STUN / 2 < len(heard) <= MOST_STUN
        port.loop.distrust(is_authentic)
        assert await port.hears(port.peer, check(4), SRTP) == [SRTP]

    at_a_port(run)


def test_the_other_end_checks_paths_from_few_addresses() -> None:
    async def run(port: Port) -> None:
        port.loop.trust(is_authentic)
        for number in range(MOST_SOURCES):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as source:
                assert await port.hears(source, check(number)) == [check(number)]
        assert await port.hears(port.peer, check(100), STUN) == [STUN]

    at_a_port(run)


def test_little_waits_for_a_session_that_has_not_begun(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tactophone.net.call.guard.PERIOD", 1_000.0)

    async def run(port: Port) -> None:
        early = [FOREIGN, HELLO] * MOST_EARLY
        heard = await port.hears(port.stranger, *early, STUN)
        assert MOST_EARLY / 2 < len(heard) <= MOST_EARLY + 1
        # What comes from where the other end has checked a path has its own share.
        assert await port.hears(port.peer, HELLO, STUN) == [STUN]
        port.loop.trust(is_authentic)
        await port.hears(port.peer, check(1))
        assert await port.hears(port.peer, HELLO) == [HELLO]

    at_a_port(run)


def test_a_message_that_the_library_cannot_parse_prints_nothing(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    usual = Reader.datagram_received

    def fail(reader: Reader, data: bytes, source: tuple[Any, ...]) -> None:
        if data == STUN:
            raise struct.error("unpack requires a buffer of 4 bytes")
        usual(reader, data, source)

    monkeypatch.setattr(Reader, "datagram_received", fail)

    async def run(port: Port) -> None:
        assert await port.hears(port.stranger, STUN, HELLO) == [HELLO]

    at_a_port(run)
    assert caplog.text == ""


def test_the_source_of_the_other_ends_words_is_known() -> None:
    async def run(port: Port) -> None:
        word = CALL_WORD + bytes(25)
        port.loop.follow({STREAM})
        await port.hears(port.peer, word)
        assert port.loop.source_of(word) == "127.0.0.1"
        assert port.loop.source_of(word + b"0") == ""

    at_a_port(run)
