"""The proxy between real sockets."""

import time

import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone.net.impairment import (
    ImpairmentProxy,
    NetworkProfile,
    network_profile,
)
from tactophone.net.link.codec import Codec
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import Session
from tactophone.net.link.stream import DecodedAudio
from tactophone.net.link.udp import UdpSocket


@pytest.mark.realtime
def test_datagrams_pass_both_ways_and_some_are_lost() -> None:
    with (
        UdpSocket("127.0.0.1") as operator,
        UdpSocket("127.0.0.1") as robot,
        ImpairmentProxy(
            operator.address, NetworkProfile(loss=0.5, delay=0.001), seed=3
        ) as proxy,
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


@pytest.mark.realtime
def test_a_session_over_real_sockets_and_a_bad_link_survives_a_restart() -> None:
    robot_identity, operator_identity = (
        Identity.create("robot"),
        Identity.create("operator"),
    )
    operator = ReceiveSession(
        Session(operator_identity, Peers({robot_identity.fingerprint: "robot"}))
    )
    with (
        UdpSocket("127.0.0.1") as operators,
        UdpSocket("127.0.0.1") as robots,
        ImpairmentProxy(
            operators.address, network_profile("wifi,loss=0.05"), seed=1
        ) as proxy,
    ):
        for start in range(1, 3):
            session = Session(
                robot_identity,
                Peers({operator_identity.fingerprint: "operator"}),
                call=proxy.address,
            )
            robot = SendGroup([session], Codec("opus", packet_size=240))
            assert call(robot, robots, operator, operators, seconds=1.5) > 150
            assert operator.counters["handshakes"] == start


def call(
    robot: SendGroup,
    robots: UdpSocket,
    operator: ReceiveSession,
    operators: UdpSocket,
    *,
    seconds: float,
) -> int:
    """Send silence for a while; return the number of packets decoded."""
    decoded, begun = 0, time.monotonic()
    for step in range(round(seconds / 0.005)):
        now = time.monotonic()
        robot.push(AudioBlock(np.zeros((240, 2), np.float32), 48_000, step * 240))
        robot.receive(robots.receive(0), now=now)
        robot.poll(now)
        robots.send(robot.members[0].session.outgoing())
        events = operator.receive(operators.receive(0), now=now) + operator.poll(now)
        decoded += sum(isinstance(event, DecodedAudio) for event in events)
        operators.send(operator.session.outgoing())
        time.sleep(max(0.0, begun + 0.005 * (step + 1) - time.monotonic()))
    return decoded
