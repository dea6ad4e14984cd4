"""The live side's end of a call, and the process that passes its datagrams on."""

import asyncio
import socket
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from tactophone.core.errors import DeviceError
from tactophone.net.call.passage import Passage
from tactophone.net.link.call_socket import (
    DATAGRAM,
    PEER,
    WORDS,
    CallPeer,
    CallSocket,
    write_peer,
    write_words,
)

STREAM = 0x01020304
SRTP = b"\x80\x60" + bytes(6) + STREAM.to_bytes(4) + b"sound"
OTHER = CallPeer("other", "0A")


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here, there:
        there.settimeout(5.0)
        yield here, there


def test_the_session_sends_to_and_hears_one_peer_whichever_way_leads_there(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    there.send(write_peer(OTHER))
    with CallSocket(here) as own:
        assert own.peer == OTHER
        there.send(DATAGRAM + SRTP)
        there.send(write_peer(OTHER))
        there.send(DATAGRAM + b"\x16")
        assert own.receive(1.0) == [(SRTP, PEER), (b"\x16", PEER)]
        assert own.send([(SRTP, PEER)]) == 0
        assert there.recv(100) == DATAGRAM + SRTP
        own.follow((PEER, frozenset({STREAM})))
        own.follow((PEER, frozenset({STREAM})))
        own.follow(None)
        assert there.recv(100) == write_words({"streams": [STREAM]})
        assert there.recv(100) == write_words({"streams": []})


def test_a_process_of_a_call_that_is_late_or_gone_holds_up_nothing(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    there.send(write_peer(OTHER))
    with CallSocket(here) as own:
        refused = own.send([(bytes(1_200), PEER)] * 10_000)
        assert refused > 0
        there.close()
        assert own.receive(0.0) == []
        assert own.receive(0.0) == []
        assert own.send([(SRTP, PEER)]) == 1


def test_a_successor_asks_for_the_way_and_hears_nothing_meant_for_its_predecessor(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    there.send(DATAGRAM + b"old")
    there.send(write_peer(OTHER))
    there.send(DATAGRAM + SRTP)
    with CallSocket(here, ask=True) as own:
        assert there.recv(100) == write_words({"wanted": True})
        assert own.peer == OTHER
        assert own.receive(1.0) == [(SRTP, PEER)]


def test_a_live_side_whose_call_has_ended_before_there_was_a_way_says_so(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    there.close()
    with pytest.raises(DeviceError, match="the call has ended"):
        CallSocket(here)


class Line:
    """A path in memory, in place of an `IceAgent`."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.deliver: Any = None

    async def send(self, datagram: bytes) -> None:
        self.sent.append(datagram)


def test_the_process_passes_datagrams_both_ways_and_over_a_new_way_once_there_is_one(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair

    async def run() -> tuple[Any, ...]:
        followed: list[list[int]] = []
        prepared: list[bool] = []
        passage = Passage(there, followed.append, lambda: prepared.append(True))
        running = asyncio.ensure_future(passage.run())
        first: Any = Line()
        second: Any = Line()
        assert prepared == []
        passage.use(first, OTHER)
        with CallSocket(here) as own:
            own.follow((PEER, frozenset({STREAM})))
            own.send([(b"first", PEER)])
            while not first.sent:
                await asyncio.sleep(0)
            first.deliver(SRTP)
            heard = own.receive(1.0)
            passage.use(second, OTHER)
            own.send([(b"second", PEER)])
            while not second.sent:
                await asyncio.sleep(0)
            second.deliver(SRTP)
            heard += own.receive(1.0)
        assert prepared == [True]
        running.cancel()
        return first.sent, second.sent, heard, followed

    assert asyncio.run(run()) == (
        [b"first"],
        [b"second"],
        [(SRTP, PEER)] * 2,
        [[STREAM]],
    )


@asynccontextmanager
async def watched(
    there: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[tuple[Passage, Any]]:
    """Yield a passage that looks for silence a hundred times as often, and the way that
    it uses."""
    monkeypatch.setattr("tactophone.net.call.passage.SILENCE_TICK", 0.001)
    monkeypatch.setattr("tactophone.net.call.passage.PATH_SILENCE", 0.01)
    passage = Passage(there, lambda streams: None)
    running = asyncio.ensure_future(passage.run())
    line: Any = Line()
    passage.use(line, OTHER)
    yield passage, line
    running.cancel()


def test_a_way_that_falls_silent_is_told_each_second_but_not_before_the_first_datagram(
    pair: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def run() -> None:
        async with watched(pair[1], monkeypatch) as (passage, line):
            await asyncio.sleep(0.1)
            assert not passage.silent.is_set(), "the other end may still be starting"
            line.deliver(SRTP)
            for _ in range(2):
                await asyncio.wait_for(passage.silent.wait(), 5.0)
                passage.silent.clear()

    asyncio.run(run())


def test_a_way_on_which_sound_flows_is_not_silent(
    pair: tuple[socket.socket, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def run() -> None:
        async with watched(pair[1], monkeypatch) as (passage, line):
            for _ in range(50):
                line.deliver(SRTP)
                await asyncio.sleep(0.001)  # at most two looks
            assert not passage.silent.is_set()

    asyncio.run(run())


@pytest.mark.parametrize("ended", [False, True], ids=["session", "session ended"])
@pytest.mark.parametrize(
    "datagram",
    [b"\x16\xfe\xfd calls", SRTP.replace(STREAM.to_bytes(4), b"else")],
    ids=["a call", "another stream"],
)
def test_a_way_on_which_nothing_of_the_session_comes_is_silent(
    pair: tuple[socket.socket, socket.socket],
    monkeypatch: pytest.MonkeyPatch,
    datagram: bytes,
    ended: bool,
) -> None:
    """An end that is not heard, or a stranger, calls as often as it likes."""

    async def run() -> None:
        async with watched(pair[1], monkeypatch) as (passage, line):
            pair[0].send(WORDS + b'{"streams": [%d]}' % STREAM)
            if ended:
                pair[0].send(WORDS + b'{"streams": []}')
            await asyncio.sleep(0.05)
            line.deliver(SRTP)
            async with asyncio.timeout(5.0):
                while not passage.silent.is_set():
                    line.deliver(datagram)
                    await asyncio.sleep(0.001)

    asyncio.run(run())


def test_sound_waits_for_a_live_side_that_is_late(
    pair: tuple[socket.socket, socket.socket],
) -> None:
    here, there = pair
    passage = Passage(there, lambda streams: None)
    line: Any = Line()
    passage.use(line, OTHER)
    sound = [SRTP + bytes(1_000) + number.to_bytes() for number in range(64)]
    for each in sound:
        line.deliver(each)
    with CallSocket(here) as own:
        heard: list[bytes] = []
        while found := own.receive(0.0):
            heard += [datagram for datagram, _ in found]
    assert heard == sound
