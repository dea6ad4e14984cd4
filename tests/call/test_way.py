"""The socket of a call: what reaches the session, what the keeper of the way, and what nobody."""

import socket
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from tactophone.link.udp import Address
from tactophone.link.way import Way, WaySocket, read_kept

CHANNEL, STREAM = 0x4001, 0x01020304
SRTP = b"\x80\x60" + bytes(6) + STREAM.to_bytes(4) + b"sound"
FOREIGN = b"\x80\x60" + bytes(6) + b"\xff\xff\xff\xff" + b"sound"
STUN, HELLO = b"\x01\x01 answer", b"\x16\xfe\xfd hello"


@dataclass
class Ends:
    own: WaySocket
    other: socket.socket
    keeper: socket.socket
    peer: Address

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
        with WaySocket(Way(bound, peer, here, request.param)) as own:
            found = Ends(own, other, there, peer)
            assert found.kept() == [b""], "it says that it reads from now on"
            yield found


def wrap(ends: Ends, datagram: bytes) -> bytes:
    """Return a datagram as the relay sends it, where there is one."""
    if not ends.own.channel:
        return datagram
    return CHANNEL.to_bytes(2) + len(datagram).to_bytes(2) + datagram


@pytest.mark.parametrize("connected", [False, True])
def test_sound_reaches_the_session_and_stun_the_keeper(ends: Ends, connected: bool) -> None:
    if connected:
        ends.own.follow((ends.peer, frozenset({STREAM})))
    wrapped = wrap(ends, STUN)
    assert ends.arrives(STUN, wrapped, wrap(ends, SRTP), wrap(ends, HELLO)) == [(SRTP, ends.peer), (HELLO, ends.peer)]
    assert ends.kept() == [STUN, wrapped]
    ends.own.send([(SRTP, ends.peer)])
    assert ends.other.recv(2048) == wrap(ends, SRTP)


def test_the_kernel_drops_foreign_sound_while_connected(ends: Ends) -> None:
    assert ends.arrives(wrap(ends, FOREIGN)) == [(FOREIGN, ends.peer)]
    ends.own.follow((ends.peer, frozenset({STREAM})))
    assert ends.arrives(wrap(ends, FOREIGN), wrap(ends, SRTP)) == [(SRTP, ends.peer)]


def test_a_stranger_who_floods_the_port_delays_no_sound(ends: Ends) -> None:
    ends.own.follow((ends.peer, frozenset({STREAM})))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for number in range(2_000):
            stranger.sendto((STUN, HELLO, SRTP, FOREIGN)[number % 4], ends.own.address)
    received = ends.arrives(wrap(ends, SRTP))
    assert (SRTP, ends.peer) in received
    # Not one datagram of the stranger bears the peer's address.
    assert [source for _, source in received].count(ends.peer) == 1


def test_what_a_relay_sends_in_another_channel_or_cut_is_dropped(ends: Ends) -> None:
    if ends.own.channel:
        cut = CHANNEL.to_bytes(2) + (len(SRTP) + 1).to_bytes(2) + SRTP
        assert ends.arrives(b"\x40\x02" + wrap(ends, SRTP)[2:], cut, b"\x40", SRTP, wrap(ends, b"")) == []
        assert ends.kept() == []


def test_a_keeper_that_is_gone_holds_up_nothing(ends: Ends) -> None:
    ends.keeper.close()
    assert ends.arrives(STUN, wrap(ends, SRTP)) == [(SRTP, ends.peer)]
