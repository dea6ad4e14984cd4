"""Sessions begin, end, begin anew, and are disturbed by nobody."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.link import Connected, Disconnected, PacketReceived, Session
from tactophone.link.rtcp import ReceiverReport
from tactophone.link.session import MOST_HANDSHAKES, PATIENCE, RESTLESS, DatagramKind

from .lines import AT_OPERATOR, AT_ROBOT, OPERATOR, ROBOT, STRANGER, Line, answering, calling


def connected() -> Line:
    line = Line()
    line.wait(0.1)
    assert line.robot.peer == "operator"
    assert line.operator.peer == "robot"
    return line


def rtp(line: Line, sequence: int = 1) -> bytes:
    ssrc = next(event.local_ssrc for event in reversed(line.at_robot) if isinstance(event, Connected))
    return b"\x80\x62" + sequence.to_bytes(2) + bytes(4) + ssrc.to_bytes(4) + b"sound"


def test_both_ends_learn_of_each_other_and_of_the_streams() -> None:
    line = connected()
    at_robot, at_operator = line.at_robot[-1], line.at_operator[-1]
    assert isinstance(at_robot, Connected)
    assert isinstance(at_operator, Connected)
    assert (at_robot.local_ssrc, at_robot.remote_ssrc) == (at_operator.remote_ssrc, at_operator.local_ssrc)


def test_packets_pass_both_ways_and_are_sealed() -> None:
    line = connected()
    line.robot.send(rtp(line))
    line.exchange()
    assert line.at_operator[-1] == PacketReceived(rtp(line), report=False)
    assert b"sound" not in line.passed[-1]
    ssrc = next(event.local_ssrc for event in line.at_operator if isinstance(event, Connected))
    report = bytes(ReceiverReport(ssrc, 1, 0.5, 3, 9, 0.001))
    line.operator.send(report)
    line.exchange()
    assert line.at_robot[-1] == PacketReceived(report, report=True)


@pytest.mark.parametrize("seed", range(20))
def test_a_lossy_line_connects_all_the_same(seed: int) -> None:
    fate = random.Random(seed)
    line = Line(lost=[fate.random() < 0.3 for _ in range(200)])
    while line.robot.peer is None and line.now < 10:
        line.wait(0.05)
    line.lose(())
    line.robot.send(rtp(line))
    line.exchange()
    assert isinstance(line.at_operator[-1], PacketReceived)


def test_a_stranger_who_calls_is_refused() -> None:
    line = Line(robot=calling(STRANGER))
    line.wait(4)
    assert line.robot.peer is None
    assert line.operator.peer is None
    assert line.operator.failure == "certificate verify failed"


def test_a_stranger_who_answers_is_refused() -> None:
    line = Line(operator=answering(STRANGER))
    line.wait(4)
    assert line.robot.peer is None
    assert line.operator.peer is None
    assert line.robot.failure is not None


def test_the_robot_may_start_first() -> None:
    line = Line(lost=[True] * 12)
    line.wait(5)
    assert line.robot.peer == "operator"


def test_a_robot_that_returns_is_connected_at_once_with_fresh_keys() -> None:
    line = connected()
    line.robot.send(rtp(line))
    line.exchange()
    recorded = line.passed[-1]
    line.robot = calling()
    line.wait(0.2)
    assert line.robot.peer == "operator"
    heard = len(line.at_operator)
    assert line.operator.receive(recorded, source=AT_ROBOT, now=line.now) == []
    assert len(line.at_operator) == heard


def test_an_operator_who_returns_is_called_again_within_the_restless_time() -> None:
    line = connected()
    line.operator = answering()
    line.wait(RESTLESS + 0.2)
    assert line.operator.peer == "robot"
    line.robot.send(rtp(line))
    line.exchange()
    assert isinstance(line.at_operator[-1], PacketReceived)


def test_silence_ends_a_session() -> None:
    line = connected()
    line.lose([True] * 10_000)
    line.wait(PATIENCE + 0.2)
    assert line.at_operator[-1] == Disconnected("nothing heard for 5 s")
    assert line.at_robot[-1] == Disconnected("nothing heard for 5 s")


def test_goodbye_ends_a_session_at_once() -> None:
    line = connected()
    line.robot.hang_up()
    line.exchange()
    assert line.at_operator[-1] == Disconnected("robot hung up")
    assert line.robot.hang_up() == []


def test_a_forged_hello_does_not_disturb_a_session() -> None:
    line = connected()
    forger = calling(STRANGER)
    forger.poll(0)
    for datagram, _ in forger.outgoing():
        line.operator.receive(datagram, source=AT_ROBOT, now=line.now)
    line.wait(0.5)
    assert line.operator.peer == "robot"
    line.robot.send(rtp(line))
    line.exchange()
    assert isinstance(line.at_operator[-1], PacketReceived)


def test_hellos_from_forged_addresses_cost_no_memory() -> None:
    operator = answering()
    for port in range(1_000):
        robot = calling()
        robot.poll(0)
        for datagram, _ in robot.outgoing():
            operator.receive(datagram, source=("198.51.100.1", port), now=0)
    assert not operator._pending


def test_callers_who_never_finish_are_few_and_then_forgotten() -> None:
    operator, robots = answering(), [calling() for _ in range(MOST_HANDSHAKES + 3)]
    for port, robot in enumerate(robots):
        robot.poll(0)
        for _ in range(2):  # hello, and hello with the cookie; then silence
            for datagram, _target in robot.outgoing():
                operator.receive(datagram, source=("192.0.2.9", port), now=0)
            for datagram, target in operator.outgoing():
                if target == ("192.0.2.9", port) and len(datagram) < 100:
                    robot.receive(datagram, source=AT_OPERATOR, now=0)
    assert len(operator._pending) == MOST_HANDSHAKES
    operator.poll(10.0)
    assert not operator._pending


def test_a_forged_alert_does_not_end_a_handshake() -> None:
    robot, operator = calling(), answering()
    robot.poll(0)
    alert = bytes.fromhex("15fefd00000000000000010002 0228")
    robot.receive(alert, source=AT_OPERATOR, now=0)
    line = Line(robot, operator)
    line.wait(0.5)
    assert robot.peer == "operator"


@given(
    st.binary(max_size=200), st.sampled_from([b"", b"\x80\x62", b"\x80\xc9", b"\x16\xfe\xfd", b"\x16\xfe\xff", b"\x15"])
)
def test_no_bytes_change_a_session(rest: bytes, start: bytes) -> None:
    line = SHARED
    assert line.operator.receive(start + rest, source=AT_ROBOT, now=line.now) == []
    assert line.robot.receive(start + rest, source=AT_OPERATOR, now=line.now) == []
    line.operator.outgoing()
    line.robot.outgoing()
    assert (line.robot.peer, line.operator.peer) == ("operator", "robot")


def test_what_was_changed_cut_or_sent_twice_is_refused() -> None:
    line = connected()
    line.robot.send(rtp(line))
    (datagram, _), *_ = line.robot.outgoing()
    wrong = [datagram[:k] for k in range(len(datagram))]
    wrong += [
        datagram[:k] + bytes([datagram[k] ^ 1 << bit]) + datagram[k + 1 :]
        for k in range(len(datagram))
        for bit in range(8)
    ]
    for forged in wrong:
        assert line.operator.receive(forged, source=AT_ROBOT, now=line.now) == []
    assert len(line.operator.receive(datagram, source=AT_ROBOT, now=line.now)) == 1
    assert line.operator.receive(datagram, source=AT_ROBOT, now=line.now) == []


def test_sealed_packets_are_taken_from_wherever_the_robot_now_is() -> None:
    line = connected()
    line.robot.send(rtp(line))
    (datagram, _), *_ = line.robot.outgoing()
    assert len(line.operator.receive(datagram, source=("203.0.113.7", 1), now=line.now)) == 1


@pytest.mark.parametrize(
    ("first", "kind"), [(22, "DTLS"), (63, "DTLS"), (128, "SEALED"), (0, "NEITHER"), (255, "NEITHER")]
)
def test_a_datagram_is_told_by_its_first_byte(first: int, kind: str) -> None:
    assert DatagramKind.of(bytes([first])).name == kind


def test_nothing_secret_is_shown() -> None:
    line = connected()
    shown = repr(ROBOT) + repr(line.robot._current.agreement)  # type: ignore[union-attr]
    assert "hidden" in shown
    assert OPERATOR.fingerprint not in repr(ROBOT)
    assert isinstance(line.robot, Session)


SHARED = connected()
