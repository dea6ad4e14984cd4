"""Sessions start, end and restart, and forged datagrams have no effect."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.net.link.events import Connected, Disconnected, PacketReceived, Renewed
from tactophone.net.link.handshake import HANDSHAKE_TIMEOUT, MAX_HANDSHAKES
from tactophone.net.link.identity import Peers
from tactophone.net.link.packet import is_dtls, is_srtp
from tactophone.net.link.rtcp import ReceiverReport
from tactophone.net.link.session import RECALL_AFTER, SESSION_TIMEOUT, Session

from .session_pair import (
    AT_OPERATOR,
    AT_ROBOT,
    OPERATOR,
    ROBOT,
    UNTRUSTED,
    SessionPair,
    answering,
    calling,
)


def connected() -> SessionPair:
    pair = SessionPair()
    pair.wait(0.1)
    assert pair.robot.peer == "operator"
    assert pair.operator.peer == "robot"
    return pair


def rtp(pair: SessionPair, sequence: int = 1) -> bytes:
    ssrc = next(
        event.local_ssrc
        for event in reversed(pair.at_robot)
        if isinstance(event, Connected | Renewed)
    )
    return b"\x80\x62" + sequence.to_bytes(2) + bytes(4) + ssrc.to_bytes(4) + b"sound"


def test_both_ends_agree_on_peers_and_streams() -> None:
    pair = connected()
    at_robot, at_operator = pair.at_robot[-1], pair.at_operator[-1]
    assert isinstance(at_robot, Connected)
    assert isinstance(at_operator, Connected)
    assert (at_robot.local_ssrc, at_robot.remote_ssrc) == (
        at_operator.remote_ssrc,
        at_operator.local_ssrc,
    )


def test_packets_pass_both_ways_encrypted() -> None:
    pair = connected()
    pair.robot.send(rtp(pair))
    pair.exchange()
    assert pair.at_operator[-1] == PacketReceived(rtp(pair), report=False)
    assert b"sound" not in pair.passed[-1]
    ssrc = next(
        event.local_ssrc for event in pair.at_operator if isinstance(event, Connected)
    )
    report = bytes(ReceiverReport(ssrc, 1, 0.5, 3, 9, 0.001))
    pair.operator.send(report)
    pair.exchange()
    assert pair.at_robot[-1] == PacketReceived(report, report=True)


def introduced(robot: str, operator: str) -> SessionPair:
    """Connect ends of these versions."""
    caller = Session(
        ROBOT,
        Peers({OPERATOR.fingerprint: "operator"}),
        call=AT_OPERATOR,
        version=robot,
    )
    pair = SessionPair(
        caller, Session(OPERATOR, Peers({ROBOT.fingerprint: "robot"}), version=operator)
    )
    pair.wait(0.2)
    return pair


def test_ends_of_different_versions_say_so_in_one_sentence() -> None:
    pair = introduced("0.1.0", "0.2.0")
    assert pair.robot.version_conflict.startswith(
        "operator runs tactophone 0.2.0, this machine 0.1.0: update the"
    )
    assert pair.operator.version_conflict.startswith(
        "robot runs tactophone 0.1.0, this machine 0.2.0: update the"
    )
    pair.operator.hang_up()
    assert pair.operator.version_conflict == ""


def test_an_end_that_comes_back_as_another_version_is_named() -> None:
    pair = SessionPair()
    for session in (pair.robot, pair.operator):
        session._version = "1.0"
    pair.wait(1.0)
    assert pair.operator.version_conflict == ""
    pair.robot.hang_up()
    pair.robot = calling()
    pair.robot._version = "1.1"
    pair.wait(1.0)
    assert "robot runs tactophone 1.1, this machine 1.0" in (
        pair.operator.version_conflict
    )


def test_an_operator_with_another_address_is_called_there() -> None:
    pair = SessionPair()
    pair.robot.call_at([("192.0.2.9", 6_000)])
    pair.wait(4.0)
    assert pair.robot.peer is None
    pair.robot.call_at([AT_OPERATOR])
    pair.wait(4.0)
    assert pair.robot.peer == "operator"


def test_an_end_that_is_trusted_no_longer_loses_its_session() -> None:
    pair = SessionPair()
    pair.wait(1.0)
    assert pair.robot.peer == "operator"
    pair.operator.trust(Peers())
    pair.wait(1.0)
    assert (pair.operator.peer, pair.robot.peer) == (None, None)
    pair.wait(10.0)
    assert "it refused this machine's certificate" in (pair.robot.failure or "")
    pair.operator.trust(Peers({ROBOT.fingerprint: "robot"}))
    pair.wait(10.0)
    assert pair.robot.peer == "operator"


def test_ends_of_one_version_introduce_themselves_and_show_nothing() -> None:
    pair = introduced("0.1.0", "0.1.0")
    begun = len(pair.passed)
    ssrc = next(
        event.local_ssrc for event in pair.at_operator if isinstance(event, Connected)
    )
    for number in range(100):
        pair.robot.send(rtp(pair, number))
        pair.operator.send(bytes(ReceiverReport(ssrc, 1, 0.0, 0, 0, 0.0)))
        pair.wait(0.2)
    assert pair.robot.version_conflict == pair.operator.version_conflict == ""
    assert 200 < len(pair.passed) - begun < 220


@pytest.mark.parametrize("seed", range(20))
def test_a_lossy_link_connects(seed: int) -> None:
    rng = random.Random(seed)
    pair = SessionPair(lost=[rng.random() < 0.3 for _ in range(200)])
    while pair.robot.peer is None and pair.now < 10:
        pair.wait(0.05)
    pair.lose(())
    pair.robot.send(rtp(pair))
    pair.exchange()
    assert isinstance(pair.at_operator[-1], PacketReceived)


def test_an_untrusted_caller_is_refused() -> None:
    pair = SessionPair(robot=calling(UNTRUSTED))
    pair.wait(4)
    assert pair.robot.peer is None
    assert pair.operator.peer is None
    assert pair.operator.failure == "certificate verify failed"


def test_an_untrusted_answerer_is_refused() -> None:
    pair = SessionPair(operator=answering(UNTRUSTED))
    pair.wait(4)
    assert pair.robot.peer is None
    assert pair.operator.peer is None
    assert pair.robot.failure is not None


def test_the_robot_may_start_first() -> None:
    pair = SessionPair(lost=[True] * 12)
    pair.wait(5)
    assert pair.robot.peer == "operator"


def test_a_robot_tries_each_address_of_its_operator() -> None:
    nowhere = ("2001:db8::1", 6_000)
    pair = SessionPair(
        Session(
            ROBOT,
            Peers({OPERATOR.fingerprint: "operator"}),
            call=[nowhere, AT_OPERATOR],
        )
    )
    while pair.robot.peer is None and pair.now < 2 * HANDSHAKE_TIMEOUT:
        pair.wait(0.05)
    assert pair.operator.peer == "robot"


def test_a_robot_that_returns_is_connected_at_once_with_fresh_keys() -> None:
    pair = connected()
    pair.robot.send(rtp(pair))
    pair.exchange()
    recorded = pair.passed[-1]
    pair.robot = calling()
    pair.wait(0.2)
    assert pair.robot.peer == "operator"
    pair.robot.send(rtp(pair))
    pair.exchange()
    assert isinstance(pair.at_operator[-1], PacketReceived)
    received = len(pair.at_operator)
    assert pair.operator.receive(recorded, source=AT_ROBOT, now=pair.now) == []
    assert len(pair.at_operator) == received


def test_a_restarted_operator_is_called_again_within_the_recall_time() -> None:
    pair = connected()
    pair.operator = answering()
    pair.wait(RECALL_AFTER + 0.2)
    assert pair.operator.peer == "robot"
    pair.robot.send(rtp(pair))
    pair.exchange()
    assert isinstance(pair.at_operator[-1], PacketReceived)


def test_silence_ends_a_session() -> None:
    pair = connected()
    pair.lose([True] * 10_000)
    pair.wait(SESSION_TIMEOUT + 0.2)
    assert pair.at_operator[-1] == Disconnected("nothing received for 5 s")
    assert pair.at_robot[-1] == Disconnected("nothing received for 5 s")


def test_goodbye_ends_a_session_at_once() -> None:
    pair = connected()
    pair.robot.hang_up()
    pair.exchange()
    assert pair.at_operator[-1] == Disconnected("robot hung up")
    assert pair.robot.hang_up() == []


def test_a_forged_hello_does_not_disturb_a_session() -> None:
    pair = connected()
    forger = calling(UNTRUSTED)
    forger.poll(0)
    for datagram, _ in forger.outgoing():
        pair.operator.receive(datagram, source=AT_ROBOT, now=pair.now)
    pair.wait(0.5)
    assert pair.operator.peer == "robot"
    pair.robot.send(rtp(pair))
    pair.exchange()
    assert isinstance(pair.at_operator[-1], PacketReceived)


def test_hellos_from_forged_addresses_cost_no_memory() -> None:
    operator = answering()
    for port in range(1_000):
        robot = calling()
        robot.poll(0)
        for datagram, _ in robot.outgoing():
            operator.receive(datagram, source=("198.51.100.1", port), now=0)
    assert not operator._pending


@pytest.mark.parametrize(("trusted", "rate"), [(False, 50), (True, 200)])
def test_hellos_from_forged_addresses_get_so_many_answers_a_second(
    trusted: bool, rate: int
) -> None:
    operator, answers = answering(), 0
    robot = calling() if trusted else Session(UNTRUSTED, Peers(), call=AT_OPERATOR)
    robot.poll(0)
    ((hello, _),) = robot.outgoing()
    for number in range(2_000):
        operator.receive(hello, source=("198.51.100.1", number), now=number / 1_000)
        answers += len(operator.outgoing())
    # Two seconds at the rate, and half a second's worth at once.
    assert 2 * rate <= answers <= 2.5 * rate + 1


def test_callers_that_never_finish_are_limited_and_time_out() -> None:
    operator, robots = answering(), [calling() for _ in range(MAX_HANDSHAKES + 3)]
    for port, robot in enumerate(robots):
        robot.poll(0)
        for _ in range(2):  # hello, and hello with the cookie; then silence
            for datagram, _target in robot.outgoing():
                operator.receive(datagram, source=("192.0.2.9", port), now=0)
            for datagram, target in operator.outgoing():
                if target == ("192.0.2.9", port) and len(datagram) < 100:
                    robot.receive(datagram, source=AT_OPERATOR, now=0)
    assert len(operator._pending) == MAX_HANDSHAKES
    operator.poll(10.0)
    assert not operator._pending


def test_a_forged_alert_does_not_end_a_handshake() -> None:
    robot, operator = calling(), answering()
    robot.poll(0)
    alert = bytes.fromhex("15fefd00000000000000010002 0228")
    robot.receive(alert, source=AT_OPERATOR, now=0)
    pair = SessionPair(robot, operator)
    pair.wait(0.5)
    assert robot.peer == "operator"
    assert not robot.faults  # the first handshake, not one after it


@given(
    st.binary(max_size=200),
    st.sampled_from(
        [b"", b"\x80\x62", b"\x80\xc9", b"\x16\xfe\xfd", b"\x16\xfe\xff", b"\x15"]
    ),
)
def test_no_bytes_change_a_session(rest: bytes, start: bytes) -> None:
    pair = SHARED
    assert pair.operator.receive(start + rest, source=AT_ROBOT, now=pair.now) == []
    assert pair.robot.receive(start + rest, source=AT_OPERATOR, now=pair.now) == []
    pair.operator.outgoing()
    pair.robot.outgoing()
    assert (pair.robot.peer, pair.operator.peer) == ("operator", "robot")


def test_what_was_changed_cut_or_sent_twice_is_refused() -> None:
    pair = connected()
    pair.robot.send(rtp(pair))
    (datagram, _), *_ = pair.robot.outgoing()
    wrong = [datagram[:k] for k in range(len(datagram))]
    wrong += [
        datagram[:k] + bytes([datagram[k] ^ 1 << bit]) + datagram[k + 1 :]
        for k in range(len(datagram))
        for bit in range(8)
    ]
    for forged in wrong:
        assert pair.operator.receive(forged, source=AT_ROBOT, now=pair.now) == []
    assert len(pair.operator.receive(datagram, source=AT_ROBOT, now=pair.now)) == 1
    assert pair.operator.receive(datagram, source=AT_ROBOT, now=pair.now) == []


def test_encrypted_packets_are_accepted_from_any_address_of_the_robot() -> None:
    pair = connected()
    pair.robot.send(rtp(pair))
    (datagram, _), *_ = pair.robot.outgoing()
    assert (
        len(pair.operator.receive(datagram, source=("203.0.113.7", 1), now=pair.now))
        == 1
    )


@pytest.mark.parametrize(
    ("first", "dtls", "srtp"),
    [
        (22, 1, 0),
        (63, 1, 0),
        (64, 0, 0),
        (128, 0, 1),
        (191, 0, 1),
        (0, 0, 0),
        (255, 0, 0),
    ],
)
def test_the_first_byte_gives_the_kind_of_a_datagram(
    first: int, dtls: int, srtp: int
) -> None:
    assert (is_dtls(bytes([first])), is_srtp(bytes([first]))) == (dtls, srtp)


def test_nothing_secret_is_shown() -> None:
    pair = connected()
    shown = repr(ROBOT) + repr(pair.robot._keys.current.agreement)  # type: ignore[union-attr]
    assert "hidden" in shown
    assert OPERATOR.fingerprint not in repr(ROBOT)
    assert isinstance(pair.robot, Session)


SHARED = connected()


def test_forged_packets_of_the_right_stream_are_no_sign_of_life() -> None:
    pair = connected()
    pair.robot.send(rtp(pair))
    (datagram, _), *_ = pair.robot.outgoing()
    forged = datagram[:-1] + bytes([datagram[-1] ^ 1])
    # The robot is dead; a stranger repeats its header, which anybody can read.
    events = []
    for _ in range(round(2 * SESSION_TIMEOUT / 0.1)):
        pair.now += 0.1
        events += pair.operator.receive(forged, source=AT_ROBOT, now=pair.now)
        events += pair.operator.poll(pair.now)
    assert events == [Disconnected("nothing received for 5 s")]
