"""The socket of a call: what reaches the session, what the keeper of the way, and what
nobody."""

import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import pytest

from tactophone.core.errors import DeviceError
from tactophone.net.link.udp import CLOSED_READS, MAX_STUN, STUN_COOKIE, Address
from tactophone.net.link.way import (
    PEER,
    READING,
    SILENT,
    WANTED,
    Way,
    WaySocket,
    read_kept,
)

CHANNEL, STREAM = 0x4001, 0x01020304
SRTP = b"\x80\x60" + bytes(6) + STREAM.to_bytes(4) + b"sound"
FOREIGN = b"\x80\x60" + bytes(6) + b"\xff\xff\xff\xff" + b"sound"
STUN = b"\x01\x01\0\0" + STUN_COOKIE.to_bytes(4) + bytes(12)
HELLO = b"\x16\xfe\xfd hello"


@dataclass
class Ends:
    own: WaySocket
    other: socket.socket
    keeper: socket.socket

    def arrives(self, *datagrams: bytes) -> list[tuple[bytes, Address]]:
        for each in datagrams:
            self.other.sendto(each, self.own.address)
        return self.own.receive(0.2)

    def kept(self) -> list[bytes]:
        found = []
        while True:
            try:
                found.append(read_kept(self.keeper.recv(2048))[0])
            except BlockingIOError:
                return found


@pytest.fixture(params=[0, CHANNEL], ids=["direct", "relayed"])
def ends(request: pytest.FixtureRequest) -> Iterator[Ends]:
    bound, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with bound, other, here, there:
        bound.bind(("127.0.0.1", 0))
        other.bind(("127.0.0.1", 0))
        other.settimeout(1.0)
        there.setblocking(False)
        peer = other.getsockname()
        if request.param:
            bound.connect(peer)
            peer = ("203.0.113.7", 4000)
        Way(bound, peer, request.param, "other", "0A").send(there)
        with WaySocket(here) as own:
            assert there.recv(100) == READING
            yield Ends(own, other, there)


def wrap(ends: Ends, datagram: bytes) -> bytes:
    """Return a datagram as the relay sends it, where there is one."""
    if not ends.own.channel:
        return datagram
    return CHANNEL.to_bytes(2) + len(datagram).to_bytes(2) + datagram


@pytest.mark.parametrize("connected", [False, True])
def test_sound_reaches_the_session_and_stun_the_keeper(
    ends: Ends, connected: bool
) -> None:
    if connected:
        ends.own.follow((PEER, frozenset({STREAM})))
    wrapped = wrap(ends, STUN)
    assert ends.arrives(STUN, wrapped, wrap(ends, SRTP), wrap(ends, HELLO)) == [
        (SRTP, PEER),
        (HELLO, PEER),
    ]
    assert ends.kept() == [STUN, wrapped]
    ends.own.send([(SRTP, PEER)])
    assert ends.other.recv(2048) == wrap(ends, SRTP)


def test_the_kernel_drops_foreign_sound_while_connected(ends: Ends) -> None:
    assert ends.arrives(wrap(ends, FOREIGN)) == [(FOREIGN, PEER)]
    ends.own.follow((PEER, frozenset({STREAM})))
    assert ends.arrives(wrap(ends, FOREIGN), wrap(ends, SRTP)) == [(SRTP, PEER)]


def test_a_stranger_who_floods_the_port_delays_no_sound(ends: Ends) -> None:
    ends.own.follow((PEER, frozenset({STREAM})))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for number in range(2_000):
            stranger.sendto((STUN, HELLO, SRTP, FOREIGN)[number % 4], ends.own.address)
    received = ends.arrives(wrap(ends, SRTP))
    assert (SRTP, PEER) in received
    # Not one datagram of the stranger bears the peer's address.
    assert [source for _, source in received].count(PEER) == 1


def test_stun_without_its_cookie_or_with_a_length_of_its_own_stays_in_the_kernel(
    ends: Ends,
) -> None:
    ends.own.follow((PEER, frozenset({STREAM})))
    odd = b"\0\1\0\3" + STUN_COOKIE.to_bytes(4) + bytes(15)
    chosen = b"\3\0\0\0" + STUN_COOKIE.to_bytes(4) + b"password"
    for forged in (b"\0\1\0\0" + bytes(16), b"\2" + bytes(60), b"\0", odd):
        assert ends.arrives(wrap(ends, forged), wrap(ends, SRTP)) == [(SRTP, PEER)]
    assert ends.arrives(wrap(ends, chosen), wrap(ends, SRTP)) == [(SRTP, PEER)]
    assert ends.kept() == [wrap(ends, chosen)]


def test_a_flood_of_stun_from_the_peers_address_closes_it_for_a_second_and_leaves_the_sound_alone(
    ends: Ends,
) -> None:
    """A keeper gets eight messages of a read, then none for a while, and then again
    some."""
    ends.own.follow((PEER, frozenset({STREAM})))
    found = ends.arrives(*[wrap(ends, STUN)] * 100, *[wrap(ends, SRTP)] * 20)
    found += ends.own.receive(0)
    assert [content for content, _ in found].count(SRTP) == 20
    assert len(ends.kept()) == MAX_STUN
    assert ends.arrives(*[wrap(ends, STUN)] * 500, wrap(ends, SRTP)) == [(SRTP, PEER)]
    assert ends.kept() == []
    for _ in range(CLOSED_READS):
        ends.own.receive(0)
    assert ends.arrives(wrap(ends, STUN), wrap(ends, SRTP)) == [(SRTP, PEER)]
    assert len(ends.kept()) == 1


def test_a_flood_of_stun_from_strangers_reaches_the_keeper_eight_at_a_time(
    ends: Ends,
) -> None:
    if ends.own.channel:
        pytest.skip("nobody but the relay reaches the socket")
    ends.own.follow((PEER, frozenset({STREAM})))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(500):
            stranger.sendto(STUN, ends.own.address)
    for _ in range(8):
        assert (SRTP, PEER) in ends.arrives(SRTP)
    assert 0 < len(ends.kept()) <= MAX_STUN
    assert ends.arrives(STUN, SRTP) == [(SRTP, PEER)]  # the peer's own still passes
    assert ends.kept() == [STUN]


def test_what_a_relay_sends_in_another_channel_or_cut_is_dropped(ends: Ends) -> None:
    if ends.own.channel:
        cut = CHANNEL.to_bytes(2) + (len(SRTP) + 1).to_bytes(2) + SRTP
        assert (
            ends.arrives(
                b"\x40\x02" + wrap(ends, SRTP)[2:], cut, b"\x40", SRTP, wrap(ends, b"")
            )
            == []
        )
        assert ends.kept() == []


def test_a_keeper_that_is_gone_holds_up_nothing(ends: Ends) -> None:
    ends.keeper.close()
    assert ends.arrives(STUN, wrap(ends, SRTP)) == [(SRTP, PEER)]


def test_sound_goes_on_over_a_new_way_and_the_session_sees_the_same_peer(
    ends: Ends,
) -> None:
    ends.own.follow((PEER, frozenset({STREAM})))
    assert ends.arrives(wrap(ends, SRTP)) == [(SRTP, PEER)]
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as bound,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        for each in (bound, other):
            each.bind(("127.0.0.1", 0))
        Way(bound, other.getsockname(), 0, "other", "0A").send(ends.keeper)
        assert ends.own.receive(0.01) == []
        assert ends.keeper.recv(100) == READING
        other.settimeout(1.0)
        ends.own.send([(SRTP, PEER)])
        assert other.recv(2048) == SRTP
        for each in (FOREIGN, SRTP):
            other.sendto(each, ends.own.address)
        assert ends.own.receive(0.2) == [(SRTP, PEER)]


@pytest.mark.slow
def test_a_way_that_falls_silent_is_reported_each_second_until_something_comes(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactophone.net.link.way.WAY_SILENCE", 0.1)

    def silent() -> int:
        for _ in range(25):
            ends.own.receive(0.01)
        said = 0
        with suppress(BlockingIOError):
            while True:
                said += ends.keeper.recv(100) == SILENT
        return said

    assert silent() == 0, "the other end may not have started yet"
    ends.arrives(wrap(ends, SRTP))
    assert silent() == 2
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(SRTP, ends.own.address)  # changes nothing
        assert silent() in (2, 3)


def test_a_successor_asks_for_the_way_that_its_predecessor_had(ends: Ends) -> None:
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with here, there:
        Way(
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM), PEER, 7, "other", "0A"
        ).send(there)
        with WaySocket(here, ask=True) as successor:
            assert there.recv(100) == WANTED
            assert (successor.way.channel, successor.way.name) == (7, "other")
    there, here = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    there.close()
    with here, pytest.raises(DeviceError, match="the call has ended"):
        WaySocket(here)
