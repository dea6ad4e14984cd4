"""The UDP socket."""

from collections.abc import Iterator

import pytest

from tactophone.errors import DeviceError
from tactophone.link import DatagramSocket, UdpSocket, resolve


@pytest.fixture
def pair() -> Iterator[tuple[DatagramSocket, DatagramSocket]]:
    with UdpSocket("127.0.0.1") as first, UdpSocket("127.0.0.1") as second:
        yield first, second


def test_datagrams_arrive_whole_with_their_source(pair: tuple[DatagramSocket, DatagramSocket]) -> None:
    first, second = pair
    assert first.send([(b"one", second.address), (b"two", second.address)]) == 0
    received = second.receive(1.0)
    while len(received) < 2:
        received += second.receive(1.0)
    assert received == [(b"one", first.address), (b"two", first.address)]


def test_receive_waits_no_longer_than_its_timeout(pair: tuple[DatagramSocket, DatagramSocket]) -> None:
    assert pair[0].receive(0) == []
    assert pair[0].receive(0.01) == []


def test_a_closed_port_is_not_an_error(pair: tuple[DatagramSocket, DatagramSocket]) -> None:
    first, second = pair
    target = second.address
    second.close()
    assert first.send([(b"hello?", target)] * 3) == 0
    assert first.receive(0.01) == []


def test_what_the_system_refuses_is_counted(pair: tuple[DatagramSocket, DatagramSocket]) -> None:
    assert pair[0].send([(bytes(70_000), pair[1].address)]) == 1


def test_a_taken_port_is_named() -> None:
    with UdpSocket("127.0.0.1") as first, pytest.raises(DeviceError, match=str(first.address[1])):
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
    assert resolve("127.0.0.1", 5) == ("127.0.0.1", 5)
