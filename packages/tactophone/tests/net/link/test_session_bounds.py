"""The bounds of a session: ages of keys, pauses, and what each refused datagram counts
as."""

import re
from pathlib import Path

import pytest

from tactophone.net.link import session as session_module
from tactophone.net.link.events import Connected, Disconnected, PacketReceived
from tactophone.net.link.handshake import HANDSHAKE_TIMEOUT
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.rtcp import Goodbye, Introduction, ReceiverReport
from tactophone.net.link.session import (
    BUSY_PAUSE,
    CONFIRM_TIMEOUT,
    KEY_OVERLAP,
    MAX_KEY_AGE,
    RECALL_AFTER,
    RENEW_AFTER,
    SESSION_TIMEOUT,
    Connection,
    Session,
)

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

DOCS = Path(__file__).parents[5] / "docs" / "reference"

EVE = ("203.0.113.66", 666)


def connected(*, now: float = 0.0, version: str = "") -> SessionPair:
    caller = Session(
        ROBOT,
        Peers({OPERATOR.fingerprint: "operator"}),
        call=AT_OPERATOR,
        version=version,
    )
    pair = SessionPair(caller, now=now)
    pair.wait(0.1)
    assert pair.operator.peer == "robot"
    return pair


def keys(session: Session) -> Connection:
    assert session._keys.current is not None
    return session._keys.current


def packet(session: Session, sequence: int = 1) -> bytes:
    return (
        b"\x80\x62"
        + sequence.to_bytes(2)
        + bytes(4)
        + keys(session).agreement.secrets.local_ssrc.to_bytes(4)
        + b"x"
    )


def test_keys_live_as_long_as_the_threat_model_says() -> None:
    page = (DOCS / "threat-model.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| keys that live too long \|.*$", page, re.MULTILINE)
    hours = [float(figure) for figure in re.findall(r"(\d+) h\b", row)]
    assert hours == [RENEW_AFTER / 3600, MAX_KEY_AGE / 3600]


def test_keys_need_renewal_once_they_are_older_than_asked() -> None:
    current = keys(connected(now=100.0).robot)
    current.begun = 128.0
    assert not current.needs_renewal(128.0 + 64.0, after=64.0)
    assert current.needs_renewal(128.0 + 64.5, after=64.0)


def test_keys_need_renewal_once_they_were_used_for_more_packets_than_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(session_module, "RENEW_PACKETS", 5)
    robot = connected().robot
    for number in range(1, 6):
        robot.send(packet(robot, number))
    current = keys(robot)
    assert not current.needs_renewal(current.begun, after=64.0)
    robot.send(packet(robot, 6))
    assert current.needs_renewal(current.begun, after=64.0)


@pytest.mark.parametrize(
    ("sequence", "renewed"),
    [(0xBFFF, True), (0xC000, False), (0xFFFF, False), (0, True)],
)
def test_keys_are_renewed_only_where_the_sequence_number_is_far_from_its_wrap(
    sequence: int, renewed: bool
) -> None:
    robot = connected().robot
    robot.send(packet(robot, sequence))
    robot.send(
        bytes(
            ReceiverReport(keys(robot).agreement.secrets.local_ssrc, 1, 0.0, 0, 0, 0.0)
        )
    )
    assert keys(robot).needs_renewal(1e6, after=64.0) is renewed


def test_keys_and_a_silent_session_each_end_just_after_their_own_time() -> None:
    operator = connected().operator
    current = keys(operator)
    current.last_received = current.until
    assert operator.poll(current.until) == []
    current.last_received = current.until + 1
    assert operator.poll(current.until + 0.001) == [
        Disconnected("the keys were not renewed in time")
    ]
    operator = connected().operator
    current = keys(operator)
    assert operator.poll(current.last_received + SESSION_TIMEOUT) == []
    assert operator.poll(current.last_received + SESSION_TIMEOUT + 0.001) != []


def renewed_pair() -> SessionPair:
    """A pair whose keys were just renewed; the caller has used them."""
    caller = Session(
        ROBOT,
        Peers({OPERATOR.fingerprint: "operator"}),
        call=AT_OPERATOR,
        renew_after=0.5,
    )
    pair = SessionPair(caller)
    pair.wait(0.1)
    first = keys(pair.operator)
    for number in range(1, 100):
        pair.robot.send(packet(pair.robot, number))
        pair.operator.send(packet(pair.operator, number))
        pair.wait(0.05)
        if keys(pair.operator) is not first:
            break
    return pair


def test_renewed_keys_have_their_full_age_and_those_before_the_overlap() -> None:
    pair = renewed_pair()
    current, before = keys(pair.operator), pair.operator._keys.beside
    assert before is not None
    assert current.until == pytest.approx(current.begun + MAX_KEY_AGE)
    assert before.until == pytest.approx(pair.now + KEY_OVERLAP)
    pair.operator.poll(before.until)
    assert pair.operator._keys.beside is before
    current.last_received = before.until
    pair.operator.poll(before.until + 0.001)
    assert pair.operator._keys.beside is None


def test_keys_that_the_caller_never_uses_are_dropped_after_their_time() -> None:
    pair = connected()
    current = keys(pair.operator)
    other = Connection(current.handshake, current.agreement, AT_ROBOT, pair.now)
    pair.operator._keys.add(other, pair.now)
    assert other.until == pair.now + CONFIRM_TIMEOUT
    assert list(pair.operator._keys) == [current, other]


def test_a_last_flight_is_repeated_for_ten_seconds_and_for_its_own_address() -> None:
    pair = connected()
    current, heard = keys(pair.operator), []
    current.handshake.receive = lambda datagram, *, now: heard.append(now)  # type: ignore[method-assign]
    record = b"\x16\xfe\xfd" + bytes(60)
    late = current.begun + CONFIRM_TIMEOUT
    pair.operator.receive(record, source=AT_ROBOT, now=late - 0.001)
    assert heard == [late - 0.001]
    assert pair.operator.faults == {}
    pair.operator.receive(record, source=AT_ROBOT, now=late)
    pair.operator.receive(record, source=EVE, now=current.begun)
    assert len(heard) == 1
    assert pair.operator.faults == {"stray": 2}


def test_each_refused_datagram_is_counted_once_as_what_it_is() -> None:
    pair = connected()
    foreign = b"\x80\x62" + bytes(40)
    pair.operator.receive(foreign, source=EVE, now=pair.now)
    assert pair.operator.faults == {"rejected": 1}
    pair.robot.send(packet(pair.robot))
    ((datagram, _),) = pair.robot.outgoing()
    pair.operator.receive(datagram[:-1], source=AT_ROBOT, now=pair.now)
    pair.operator.receive(b"\xff" * 40, source=EVE, now=pair.now)
    assert pair.operator.faults == {"rejected": 2, "stray": 1}
    assert pair.operator.refused == 3
    alone = answering()
    alone.receive(foreign, source=EVE, now=0.0)
    assert alone.faults == {"stray": 1}


def test_a_hello_beyond_the_places_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    operator, robot = answering(), calling()
    monkeypatch.setattr(operator._admission, "admits", lambda *_, **__: False)
    robot.poll(0.0)
    ((hello, _),) = robot.outgoing()
    operator.receive(hello, source=AT_ROBOT, now=0.0)
    assert operator.faults == {"stray": 1}


def test_the_cookie_for_a_call_that_was_given_up_serves_the_next_one() -> None:
    """An operator that slept answers the calls that waited in its socket, the oldest
    first."""
    pair = SessionPair(calling(), answering())
    late: list[bytes] = []
    for now in (0.0, HANDSHAKE_TIMEOUT + 0.1):
        pair.robot.poll(now)
        pair.robot.poll(now + 0.01)
        for hello, _ in pair.robot.outgoing():
            pair.operator.receive(hello, source=AT_ROBOT, now=now)
        late += [reply for reply, _ in pair.operator.outgoing()]
    pair.now = HANDSHAKE_TIMEOUT + 0.2
    for reply in late:
        pair.robot.receive(reply, source=AT_OPERATOR, now=pair.now)
    pair.wait(0.5)
    assert (pair.robot.peer, pair.operator.peer) == ("operator", "robot")


def test_a_failed_handshake_is_counted_once_and_a_fault_ends_only_its_senders() -> None:
    operator, callers = answering(), {("192.0.2.9", 1): calling(), EVE: calling()}
    for source, robot in callers.items():
        robot.poll(0.0)
        for _ in range(2):  # hello, and hello with the cookie
            for datagram, _target in robot.outgoing():
                operator.receive(datagram, source=source, now=0.0)
            for datagram, target in operator.outgoing():
                if target == source and len(datagram) < 100:
                    robot.receive(datagram, source=AT_OPERATOR, now=0.0)
    assert len(operator._pending) == 2
    operator._contain(RuntimeError("a fault"), EVE)
    assert [source for source, _ in operator._pending] == [("192.0.2.9", 1)]
    assert operator.faults == {"contained": 1, "handshakes": 1}
    assert operator.failure == "the handshake failed (RuntimeError)"


def test_the_log_gets_the_first_second_fourth_and_eighth_contained_fault(
    caplog: pytest.LogCaptureFixture,
) -> None:
    operator = answering()
    for number in range(1, 10):
        operator._contain(RuntimeError(f"number {number}."), EVE)
    assert operator.faults["contained"] == 9
    assert [record.args[1].args[0] for record in caplog.records] == [  # type: ignore[index,union-attr]
        *("number 1.", "number 2.", "number 4.", "number 8.")
    ]


def test_a_session_claims_the_peer_that_it_has_and_no_other() -> None:
    operator = connected().operator
    assert operator.claims(ROBOT.fingerprint)
    assert not operator.claims(UNTRUSTED.fingerprint)
    assert not answering().claims(ROBOT.fingerprint)
    robot = calling()
    robot.poll(0.0)
    assert not robot.claims(OPERATOR.fingerprint)  # it only calls


def test_an_end_introduces_itself_at_once_and_after_doubling_pauses() -> None:
    pair = connected(now=1000.0, version="1.0")
    begun = keys(pair.robot).begun
    robot = pair.robot
    introduced = []
    robot._introduce_at = begun
    for hundredth in range(200):
        robot.poll(begun + 0.01 * hundredth)
        robot._keys.current.last_received = begun + 2.0  # type: ignore[union-attr]
        if robot.outgoing():
            introduced.append(0.01 * hundredth)
    assert introduced == pytest.approx([0.0, 0.1, 0.2, 0.4, 0.8, 1.6], abs=0.06)


def goodbye(pair: SessionPair, reason: str) -> None:
    pair.operator.send(
        bytes(Goodbye(keys(pair.operator).agreement.secrets.local_ssrc, reason))
    )
    pair.exchange()


def test_a_caller_that_was_sent_away_calls_again_after_the_pause() -> None:
    pair = connected()
    goodbye(pair, "no room")
    assert pair.at_robot[-1] == Disconnected("operator hung up: no room")
    assert (pair.robot.failure, pair.robot.hung_up) == ("no room", "")
    pair.robot.poll(pair.now + BUSY_PAUSE)
    assert not pair.robot.outgoing()
    pair.robot.poll(pair.now + BUSY_PAUSE + 0.001)
    assert pair.robot.outgoing()


def test_a_caller_whose_peer_hangs_up_without_a_reason_knows_who() -> None:
    pair = connected()
    goodbye(pair, "")
    assert (pair.robot.failure, pair.robot.hung_up) == (None, "operator")


def test_a_new_peer_is_not_taken_for_the_version_of_the_one_before() -> None:
    second = Identity.create("second")
    peers = Peers({ROBOT.fingerprint: "robot", second.fingerprint: "second"})
    pair = SessionPair(operator=Session(OPERATOR, peers, version="1.0"))
    pair.wait(0.1)
    pair.robot.send(
        bytes(Introduction(keys(pair.robot).agreement.secrets.local_ssrc, "2.0"))
    )
    pair.exchange()
    assert "2.0" in pair.operator.version_conflict
    assert not any(isinstance(event, PacketReceived) for event in pair.at_operator)
    pair.robot.hang_up()
    pair.exchange()
    pair.robot = calling(second)
    pair.wait(0.2)
    assert pair.operator.peer == "second"
    assert pair.operator.version_conflict == ""


def test_a_caller_begins_at_once_and_a_packet_without_a_session_is_dropped() -> None:
    robot = calling()
    robot.send(b"\x80\x62" + bytes(40))
    assert robot.outgoing() == []
    assert robot.poll(0.0) == []
    assert len(robot.outgoing()) == 1
    robot.poll(0.01)  # the handshake under way is not begun again
    assert robot.outgoing() == []


def test_a_silent_peer_is_called_again_after_the_recall_time_and_not_before() -> None:
    robot = connected().robot
    heard = keys(robot).last_received
    robot.poll(heard + RECALL_AFTER)
    assert not robot.outgoing()
    robot.poll(heard + RECALL_AFTER + 0.001)
    assert robot.outgoing()


def test_a_second_trusted_robot_is_told_at_its_own_address_and_noted() -> None:
    second = Identity.create("second")
    pair = SessionPair(
        operator=Session(
            OPERATOR, Peers({ROBOT.fingerprint: "robot", second.fingerprint: "second"})
        )
    )
    pair.wait(0.1)
    first, pair.robot = pair.robot, calling(second)
    pair.wait(0.1)
    assert pair.operator.sent_away is not None
    name, when = pair.operator.sent_away
    assert (name, 0.1 < when <= pair.now) == ("second", True)
    assert pair.operator.peer == "robot"
    assert first.peer == "operator"
    assert [
        event.peer for event in pair.at_operator if isinstance(event, Connected)
    ] == ["robot"]


def test_a_caller_whose_peer_is_connected_elsewhere_says_so_and_waits() -> None:
    robot = calling()
    robot.poll(0.0)
    robot.outgoing()
    (handshake,) = robot._pending.values()
    handshake.receive = lambda datagram, *, now: None  # type: ignore[method-assign]
    record = b"\x16\xfe\xfd" + bytes(60)
    robot.receive(record, source=AT_OPERATOR, now=1.0)
    assert robot.failure is None  # nothing has gone wrong yet
    handshake.failure, robot._handshakes.taken = "no", "trainer"
    robot.receive(record, source=AT_OPERATOR, now=1.0)
    assert "'trainer', connected already" in str(robot.failure)
    assert robot._handshakes.taken == ""
    robot.poll(1.0 + BUSY_PAUSE)
    assert not robot.outgoing()
    robot.poll(1.0 + BUSY_PAUSE + 0.001)
    assert robot.outgoing()
