"""The UDP socket."""

import contextlib
import socket
import sys
from collections.abc import Iterator

import pytest

from tactophone.core.errors import DeviceError
from tactophone.net.link import udp
from tactophone.net.link.packet import Address
from tactophone.net.link.udp import (
    CLOSED_READS,
    FOREIGN_TURNS,
    MAX_FOREIGN,
    MAX_PEER_HANDSHAKES,
    UdpSocket,
    host_towards,
    resolve,
)


@pytest.fixture
def pair() -> Iterator[tuple[UdpSocket, UdpSocket]]:
    with UdpSocket("127.0.0.1") as first, UdpSocket("127.0.0.1") as second:
        yield first, second


def test_datagrams_arrive_whole_with_their_source(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    first, second = pair
    assert first.send([(b"one", second.address), (b"two", second.address)]) == 0
    received = second.receive(1.0)
    while len(received) < 2:
        received += second.receive(1.0)
    assert received == [(b"one", first.address), (b"two", first.address)]


def test_receive_waits_no_longer_than_its_timeout(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    assert pair[0].receive(0) == []
    assert pair[0].receive(0.01) == []


def test_a_closed_port_is_not_an_error(pair: tuple[UdpSocket, UdpSocket]) -> None:
    first, second = pair
    target = second.address
    second.close()
    assert first.send([(b"hello?", target)] * 3) == 0
    assert first.receive(0.01) == []


def test_what_the_system_refuses_is_counted(pair: tuple[UdpSocket, UdpSocket]) -> None:
    assert pair[0].send([(bytes(70_000), pair[1].address)]) == 1


def test_a_taken_port_is_named() -> None:
    with (
        UdpSocket("127.0.0.1") as first,
        pytest.raises(DeviceError, match=str(first.address[1])),
    ):
        UdpSocket(*first.address)


def test_ipv6_has_a_socket_too() -> None:
    try:
        first, second = UdpSocket("::1"), UdpSocket("::1")
    except DeviceError:
        pytest.skip("this machine has no IPv6")
    with first, second:
        first.send([(b"six", second.address)])
        assert second.receive(1.0) == [(b"six", first.address)]


def test_an_unknown_host_is_named() -> None:
    with pytest.raises(DeviceError, match=r"nowhere\.invalid"):
        resolve("nowhere.invalid", 1)
    assert resolve("127.0.0.1", 5) == [("127.0.0.1", 5)]


HOSTS = ["127.0.0.1", "::1"]
SSRC = 0xDEADBEEF
SOUND = b"\x80\x62" + bytes(6) + SSRC.to_bytes(4, "big") + b"sound"
REPORT = b"\x80\xc9" + bytes(2) + SSRC.to_bytes(4, "big") + b"report"
HANDSHAKE = b"\x16\xfe\xfd" + bytes(20)
FOREIGN = [
    b"\x80\x62" + bytes(6) + b"\1\2\3\4" + b"sound",
    b"\x80\xc9" + bytes(2) + b"\1\2\3\4" + b"report",
    b"\x80",
    b"\x7f" + SOUND[1:],
    b"\x13" + SOUND[1:],
    b"\x16garbage",
    b"\x16",
    b"\xc0" + SOUND[1:],
]


def has_ipv6() -> bool:
    """Whether the machine has it; asked without the socket that is tested, which may be
    what lacks it."""
    with (
        contextlib.suppress(OSError),
        socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe,
    ):
        probe.bind(("::1", 0))
        return True
    return False


def everything(receiver: UdpSocket) -> list[tuple[bytes, Address]]:
    """Return all that has arrived; on one machine, what was sent has arrived."""
    received: list[tuple[bytes, Address]] = []
    while batch := receiver.receive(0):
        received += batch
    return received


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_a_socket_for_all_addresses_takes_both_families(host: str) -> None:
    if ":" in host and not has_ipv6():
        pytest.skip("this machine has no IPv6")
    with UdpSocket() as operator, UdpSocket() as robot:
        target = next(iter(resolve(host, operator.address[1])))
        assert robot.send([(b"hello", target)]) == 0
        ((datagram, source),) = operator.receive(1.0)
        assert datagram == b"hello"
        assert operator.send([(b"answer", source)]) == 0
        assert robot.receive(1.0) == [(b"answer", target)]


@pytest.mark.parametrize("host", [*HOSTS, ""])
def test_strangers_cannot_crowd_out_the_peer_that_is_followed(host: str) -> None:
    with (
        UdpSocket(host) as operator,
        UdpSocket(host or "127.0.0.1") as peer,
        UdpSocket(host or "127.0.0.1") as stranger,
    ):
        target = (host or "127.0.0.1", operator.address[1])
        operator.follow((peer.address, frozenset({SSRC})))
        for _ in range(5_000):
            stranger.send([(HANDSHAKE, target)])
        assert peer.send([(SOUND, target), (REPORT, target), (HANDSHAKE, target)]) == 0
        received = operator.receive(1.0)
        assert [
            (SOUND, peer.address),
            (REPORT, peer.address),
            (HANDSHAKE, peer.address),
        ] == received[:3]
        later = [len(operator.receive(0.0)) for _ in range(2 * FOREIGN_TURNS)]
        assert len(received) <= 3 + MAX_FOREIGN
        assert 0 < max(later) <= MAX_FOREIGN


def test_the_kernel_drops_what_belongs_to_no_stream_of_the_peer_whoever_sent_it(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    operator, peer = pair
    with UdpSocket("127.0.0.1") as stranger:
        operator.follow((peer.address, frozenset({5, SSRC})))
        for sender in (peer, stranger):
            sender.send([(datagram, operator.address) for datagram in FOREIGN])
            sender.send(
                [
                    (datagram, operator.address)
                    for datagram in (SOUND, REPORT, HANDSHAKE)
                ]
            )
        passed = everything(operator)
        # The robot itself may have a new address: its stream passes from anywhere.
        assert sorted(passed) == sorted(
            (datagram, sender.address)
            for sender in (peer, stranger)
            for datagram in (SOUND, REPORT, HANDSHAKE)
        )


def test_a_flood_of_handshakes_from_the_peers_address_leaves_its_sound_alone(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    """Anybody can forge the address: a few handshakes are taken, then none for a while,
    and then again some."""
    operator, peer = pair
    operator.follow((peer.address, frozenset({SSRC})))
    peer.send([(HANDSHAKE, operator.address)] * 200 + [(SOUND, operator.address)] * 20)
    passed = [datagram for datagram, _ in everything(operator)]
    assert passed.count(SOUND) == 20
    assert passed.count(HANDSHAKE) <= MAX_PEER_HANDSHAKES
    if sys.platform == "linux":
        peer.send([(HANDSHAKE, operator.address)] * 2000 + [(SOUND, operator.address)])
        assert [datagram for datagram, _ in everything(operator)] == [SOUND]
    for _ in range(CLOSED_READS):
        operator.receive(0)
    peer.send([(HANDSHAKE, operator.address)] * 3)
    assert [datagram for datagram, _ in everything(operator)] == [HANDSHAKE] * 3


def test_a_robot_takes_handshakes_again_a_second_after_a_flood_of_them(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    """Its reads wait 50 ms, ten times as long as an operator's: 20 of them are a
    second, 200 would be ten."""
    robot, peer = pair
    robot.follow((peer.address, frozenset({SSRC})))
    peer.send([(HANDSHAKE, robot.address)] * 200)
    everything(robot)
    for _ in range(20):
        peer.send([(REPORT, robot.address)])  # so that no read of the test has to wait
        assert [datagram for datagram, _ in robot.receive(0.05)] == [REPORT]
    peer.send([(HANDSHAKE, robot.address)] * 3)
    assert [datagram for datagram, _ in everything(robot)] == [HANDSHAKE] * 3


def test_without_a_session_everything_passes_again(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    operator, peer = pair
    operator.follow((peer.address, frozenset({SSRC})))
    peer.send([(SOUND, operator.address)])
    operator.follow(None)
    peer.send([(FOREIGN[0], operator.address)])
    assert everything(operator) == [(SOUND, peer.address), (FOREIGN[0], peer.address)]


def test_a_port_that_a_peer_shares_can_be_taken_by_nobody_else(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    operator, peer = pair
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as thief:
        thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        thief.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        for peers in ((peer.address, frozenset({SSRC})), None):
            operator.follow(peers)
            with pytest.raises(OSError, match="in use"):
                thief.bind(operator.address)


def test_a_peer_with_a_new_address_is_followed_there(
    pair: tuple[UdpSocket, UdpSocket],
) -> None:
    operator, before = pair
    with UdpSocket("127.0.0.1") as after:
        operator.follow((before.address, frozenset({SSRC})))
        after.send([(SOUND, operator.address)])
        assert everything(operator) == [(SOUND, after.address)]
        operator.follow((after.address, frozenset({SSRC})))
        after.send([(SOUND, operator.address)] * 100)
        assert len(operator.receive(1.0)) == 100


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what was called")
@pytest.mark.parametrize("host", ["", "0.0.0.0"])
def test_an_answer_leaves_from_the_address_that_was_called(host: str) -> None:
    """A robot takes it from nowhere else, and the route prefers another one."""
    with (
        UdpSocket(host, answers=True) as operator,
        UdpSocket("127.0.0.1") as robot,
        UdpSocket("127.0.0.1") as stranger,
    ):
        port = operator.address[1]
        called, other = ("127.0.0.2", port), ("127.0.0.3", port)

        def answered() -> Address:
            assert operator.send([(HANDSHAKE, robot.address)]) == 0
            ((_, source),) = robot.receive(1.0)
            return source

        for target in other, called:
            robot.send([(HANDSHAKE, target)])
            operator.receive(1.0)
            assert answered() == target
        operator.follow((robot.address, frozenset({SSRC})))
        # Anybody may say in its name that it called elsewhere.
        robot.send([(HANDSHAKE, other)])
        assert operator.receive(0.0) == [(HANDSHAKE, robot.address)]
        assert answered() == called
        for _ in range(2_000):
            stranger.send([(HANDSHAKE, called)])
        robot.send([(SOUND, called)])
        assert (SOUND, robot.address) in operator.receive(1.0)
        assert answered() == called
        operator.follow(None)
        robot.send([(HANDSHAKE, other)])
        everything(operator)
        assert answered() == other


def test_all_addresses_of_a_name_are_found() -> None:
    assert resolve("::1", 7) == [("::1", 7)]
    assert resolve("127.0.0.1", 7) == [("127.0.0.1", 7)]


@pytest.mark.parametrize(
    ("found", "host"),
    [
        (["::1", "127.0.0.1"], "127.0.0.1"),
        (["127.0.1.1", "::1"], "127.0.0.1"),
        (["::1"], "::1"),
        (["::1", "192.0.2.1"], ""),
    ],
)
def test_a_name_of_this_machine_in_both_families_opens_no_port_to_a_network(
    found: list[str], host: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As ``localhost`` does on most systems."""
    answers = [(0, 0, 0, "", (address, 7)) for address in found]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: answers)
    targets = resolve("localhost", 7)
    assert host_towards(targets) == host
    # The socket can send to every one of them.
    assert not host or {":" in each for each, _ in targets} == {":" in host}


@pytest.mark.parametrize(
    ("targets", "host"),
    [
        ([("127.0.0.1", 1)], "127.0.0.1"),
        ([("127.0.0.1", 1), ("127.0.0.2", 1)], "127.0.0.1"),
        ([("::1", 1)], "::1"),
        ([("192.0.2.1", 1)], ""),
        ([("127.0.0.1", 1), ("192.0.2.1", 1)], ""),
        ([("fe80::1%eth0", 1)], ""),
        ([], ""),
    ],
)
def test_what_is_sent_on_this_machine_leaves_no_port_open_to_a_network(
    targets: list[Address], host: str
) -> None:
    assert host_towards(targets) == host


def test_a_link_local_address_keeps_its_interface() -> None:
    """Of two interfaces the wrong one was taken, and the operator was never reached."""
    name = socket.if_indextoname(1)
    assert resolve(f"fe80::1%{name}", 7) == [(f"fe80::1%{name}", 7)]
    for target in ((f"fe80::1%{name}", 7), ("fe80::1%1", 7)):
        assert udp._socket_address(target, socket.AF_INET6) == ("fe80::1", 7, 0, 1)
    assert udp._address(("fe80::1", 7, 0, 1)) == (f"fe80::1%{name}", 7)
    assert udp._address(("fe80::1", 7, 0, 99_999)) == ("fe80::1%99999", 7)
    assert udp._address(("2001:db8::1", 7, 0, 0)) == ("2001:db8::1", 7)


@pytest.mark.skipif(not has_ipv6(), reason="this machine has no IPv6")
def test_an_interface_that_was_plugged_in_again_is_found_under_its_new_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    numbers = [99_999, 1]
    monkeypatch.setattr(socket, "if_nametoindex", lambda _: numbers.pop(0))
    target = "fe80::1%usb0", 7
    with UdpSocket() as robot:
        assert robot.send([(HANDSHAKE, target)]) == 1
        robot.send([(HANDSHAKE, target)])
    assert numbers == []
