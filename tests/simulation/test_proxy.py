"""The proxy between real sockets."""

import pytest

from tactophone.link import UdpSocket
from tactophone.simulation.network import NetworkProfile
from tactophone.simulation.proxy import ImpairmentProxy


@pytest.mark.realtime
def test_datagrams_pass_both_ways_and_some_are_lost() -> None:
    with (
        UdpSocket("127.0.0.1") as operator,
        UdpSocket("127.0.0.1") as robot,
        ImpairmentProxy(operator.address, NetworkProfile(loss=0.5, delay=0.001), seed=3) as proxy,
    ):
        robot.send([(bytes([k]), proxy.address) for k in range(100)])
        received = []
        while batch := operator.receive(0.3):
            received += batch
        assert 20 < len(received) < 80
        operator.send([(datagram, source) for datagram, source in received])
        back = []
        while batch := robot.receive(0.3):
            back += batch
        assert 0 < len(back) < len(received)
        assert {source for _, source in back} == {proxy.address}
