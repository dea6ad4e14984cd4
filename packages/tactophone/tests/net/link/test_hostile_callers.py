"""Strangers, second robots and faulty peers harm nothing but their own calls; each case
once ended the process."""

import itertools
import time

import pytest
from cryptography.hazmat.primitives.serialization import Encoding

from tactophone.core.errors import PacketError
from tactophone.net.link.events import Connected, Disconnected, PacketReceived
from tactophone.net.link.handshake import (
    MAX_FLIGHT_DATAGRAMS,
    MAX_HANDSHAKES,
    _records,
    is_encrypted,
)
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.packet import PayloadType, parse_packet
from tactophone.net.link.rtcp import Goodbye, ReceiverReport, parse_report
from tactophone.net.link.session import BUSY, BUSY_PAUSE, Session
from tests.support.hostile_callers import (
    CERTIFICATE_FAULTS,
    DelayedLine,
    call_with_certificate,
    overlong_hello,
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

EVE = ("203.0.113.66", 666)


def replies(session: Session, datagram: bytes, *, now: float = 0.0) -> list[bytes]:
    session.receive(datagram, source=EVE, now=now)
    return [reply for reply, target in session.outgoing() if target == EVE]


def keep_alive(session: Session) -> None:
    if session._keys.current:
        session.send(
            bytes(
                ReceiverReport(
                    session._keys.current.agreement.secrets.local_ssrc,
                    1,
                    0.0,
                    0,
                    0,
                    0.0,
                )
            )
        )


def connected() -> SessionPair:
    pair = SessionPair()
    pair.wait(0.1)
    assert pair.operator.peer == "robot"
    return pair


@pytest.mark.parametrize("fault", CERTIFICATE_FAULTS)
def test_a_certificate_that_only_openssl_parses_ends_its_own_handshake(
    fault: str,
) -> None:
    pair = connected()
    call_with_certificate(
        fault, lambda datagram: replies(pair.operator, datagram, now=pair.now)
    )
    assert pair.operator.failure == "certificate verify failed"
    assert pair.operator.peer == "robot"
    assert not pair.operator._pending


@pytest.mark.parametrize("high", [0x00, 0x01, 0x02, 0x17, 0xFF])
def test_a_hello_longer_than_its_record_ends_its_own_handshake(high: int) -> None:
    pair = connected()
    hello = overlong_hello(
        lambda datagram: replies(pair.operator, datagram, now=pair.now), high
    )
    pair.operator.receive(hello, source=EVE, now=pair.now)
    pair.wait(4)
    assert pair.operator.peer == "robot"
    assert not pair.operator._pending


def test_an_exception_in_a_library_ends_one_handshake_and_is_counted(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pair = SessionPair(robot=calling(UNTRUSTED))
    pair.robot.poll(0)

    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("a fault of the library")

    monkeypatch.setattr("tactophone.net.link.handshake.Handshakes.answer", fail)
    pair.exchange()
    assert pair.operator.faults["contained"] == 1
    assert "a fault of the library" in caplog.text


OPENSSL_TIMER = 0.9
"""Seconds of the wall clock after which OpenSSL repeats a flight by itself; its timer
does not follow virtual time."""


@pytest.mark.slow
@pytest.mark.parametrize("round_trip", [0.002, 0.02, 0.1])
def test_a_robot_connects_within_a_second_among_a_thousand_hellos_a_second(
    round_trip: float,
) -> None:
    for _ in range(5):
        begun = time.monotonic()
        connected_after, line = _connect_among_strangers(round_trip)
        # On a machine that is too slow for the case, OpenSSL's own timer has disturbed
        # it: it says nothing.
        if connected_after is not None or time.monotonic() - begun < OPENSSL_TIMER:
            break
    else:
        pytest.skip(
            "this machine is too busy: OpenSSL's timer, which reads the wall clock, "
            "ran out five times"
        )
    assert connected_after is not None
    assert len(line.answerer._pending) <= 2 * MAX_HANDSHAKES


def _connect_among_strangers(round_trip: float) -> tuple[float | None, DelayedLine]:
    line = DelayedLine(answering(), address=AT_OPERATOR, delay=round_trip / 2)
    strangers = (
        (("198.51.100.1", port), calling(UNTRUSTED)) for port in itertools.count(1)
    )
    # Strangers come first, so that they hold all the places that they can get.
    while line.now < 0.2:
        line.callers.update([next(strangers)])
        line.step(0.001)
    begun, robot = line.now, calling()
    while robot.peer is None and line.now < begun + 1.0:
        newest = list(line.callers.items())[-119:]
        line.callers = {AT_ROBOT: robot} | {
            key: caller for key, caller in newest if caller is not robot
        }
        line.callers.update([next(strangers)])
        line.step(0.001)
    return (line.now - begun if robot.peer else None), line


def test_an_untrusted_robot_learns_that_it_was_refused_and_what_to_do() -> None:
    pair = SessionPair(robot=calling(UNTRUSTED))
    pair.wait(0.2)
    assert pair.robot.failure is not None
    assert "refused this machine's certificate" in pair.robot.failure
    assert (
        f"tactophone pair trust untrusted {UNTRUSTED.fingerprint}" in pair.robot.failure
    )
    pair.wait(4)
    assert "refused" in pair.robot.failure


def test_the_first_of_two_trusted_robots_stays_and_the_second_learns_why() -> None:
    second = Identity.create("second")
    operator = Session(
        OPERATOR, Peers({ROBOT.fingerprint: "robot", second.fingerprint: "second"})
    )
    line = DelayedLine(operator, address=AT_OPERATOR, delay=0.005)
    first, other = calling(), calling(second)
    line.callers = {AT_ROBOT: first}
    while line.now < 0.2:
        line.step(0.01)
    line.callers["second"] = other
    before = operator.faults.copy()
    while line.now < 1.0:
        keep_alive(first)
        keep_alive(operator)
        line.step(0.01)
    assert operator.peer == "robot"
    assert (other.peer, other.failure) == (None, BUSY)
    assert operator.sent_away is not None
    assert operator.sent_away[0] == "second"
    assert operator.faults == before
    first.hang_up()
    line.step(0.01)
    del line.callers[AT_ROBOT]
    while line.now < 1.0 + BUSY_PAUSE + 0.5:
        line.step(0.01)
    assert operator.peer == "second"


def test_a_goodbye_carries_its_reason_without_control_characters() -> None:
    goodbye = bytes(Goodbye(5, "in \x1b[2J use"))
    assert parse_report(goodbye) == Goodbye(5, "in [2J use")
    assert parse_report(bytes(Goodbye(5))) == Goodbye(5, "")
    for cut in (goodbye[:9], b"\x80\xc8"):
        with pytest.raises(PacketError):
            parse_report(cut)


def test_records_from_the_peers_address_are_not_stored_after_the_handshake() -> None:
    pair = connected()
    (current,) = pair.operator._keys
    written: list[bytes] = []
    current.handshake._connection = type(
        "Sink", (), {"bio_write": lambda _, data: written.append(data)}
    )()  # type: ignore[assignment]
    for kind in (b"\x16", b"\x14", b"\x17"):
        pair.operator.receive(
            kind + b"\xfe\xfd" + bytes(1_200), source=AT_ROBOT, now=pair.now
        )
    assert not written


def test_a_handshake_processes_a_bounded_number_of_datagrams() -> None:
    robot = calling()
    robot.poll(0)
    (handshake,) = robot._pending.values()
    written: list[bytes] = []
    handshake._connection = type(
        "Sink",
        (),
        {
            "bio_write": lambda _, data: written.append(data),
            "do_handshake": lambda _: 1 / 0,
        },
    )()  # type: ignore[assignment]
    handshake.step = lambda now: None  # type: ignore[method-assign]
    for _ in range(3 * MAX_FLIGHT_DATAGRAMS):
        robot.receive(b"\x16\xfe\xfd" + bytes(60), source=AT_OPERATOR, now=0)
    assert len(written) == MAX_FLIGHT_DATAGRAMS


def test_more_earlier_payloads_than_a_sender_makes_are_refused() -> None:
    head = (1 << 31 | PayloadType.L16_MONO << 24 | 240 << 10 | 2).to_bytes(4, "big")
    for number in (3, 170):
        body = head * number + bytes([PayloadType.L16_MONO]) + bytes(2 * number + 40)
        with pytest.raises(PacketError, match="more than 2 earlier payloads"):
            parse_packet(b"\x80\x65" + bytes(10) + body)


def test_a_handshake_that_is_sent_twice_connects_once() -> None:
    pair = connected()
    connections = [event for event in pair.at_operator if isinstance(event, Connected)]
    for datagram in list(pair.passed):
        pair.operator.receive(datagram, source=AT_ROBOT, now=pair.now)
        pair.robot.receive(datagram, source=AT_OPERATOR, now=pair.now)
    pair.wait(0.5)
    assert [
        event for event in pair.at_operator if isinstance(event, Connected)
    ] == connections
    assert not any(
        isinstance(event, Disconnected | PacketReceived) for event in pair.at_operator
    )


def with_certificate_of(victim: Identity, datagram: bytes) -> bytes:
    """Return an answerer's flight with another certificate, and nothing that proves
    that it has the key."""
    der = victim.certificate.public_bytes(Encoding.DER)
    body = (len(der) + 3).to_bytes(3) + len(der).to_bytes(3) + der
    changed = b""
    for record in _records(datagram):
        kind, plain = record[13], record[0] == 22 and not is_encrypted(record)
        if plain and kind in (2, 3):  # ServerHello, HelloVerifyRequest
            changed += record
        elif plain and kind == 11:  # Certificate
            size = len(body).to_bytes(3)
            message = bytes([11]) + size + record[17:19] + bytes(3) + size + body
            changed += record[:11] + len(message).to_bytes(2) + message
    return changed


def test_a_certificate_without_its_key_keeps_nobody_out() -> None:
    """Certificates travel in plain text: whoever answers at one operator's address may
    show the certificate of another operator."""
    at_first, at_second = ("192.0.2.11", 1), ("192.0.2.12", 1)
    peers = Peers({OPERATOR.fingerprint: "first", UNTRUSTED.fingerprint: "second"})
    to_first, to_second = (
        Session(ROBOT, peers, call=address) for address in (at_first, at_second)
    )
    to_first.leave_to_others([to_second])
    first, thief = answering(), answering(Identity.create("thief"))
    for step in range(100):
        now = step / 50
        to_second.poll(now)
        for datagram, _ in to_second.outgoing():
            thief.receive(datagram, source=AT_ROBOT, now=now)
        for datagram, _ in thief.outgoing():
            if forged := with_certificate_of(OPERATOR, datagram):
                to_second.receive(forged, source=at_second, now=now)
        if step < 25:  # the thief comes first
            continue
        to_first.poll(now)
        for datagram, _ in to_first.outgoing():
            first.receive(datagram, source=AT_ROBOT, now=now)
        first.poll(now)
        for datagram, _ in first.outgoing():
            to_first.receive(datagram, source=at_first, now=now)
    assert to_second.state == "handshaking"
    assert to_first.peer == "first"


def test_forged_answers_cost_a_caller_ten_handshakes_a_second() -> None:
    """Nobody can tell them from the answer before the handshake ends."""
    hello = b"\xfe\xfd" + bytes(32) + b"\0\x00\x05\0"  # a cipher that nobody offered
    message = (
        b"\x02" + len(hello).to_bytes(3) + bytes(5) + len(hello).to_bytes(3) + hello
    )
    size = len(message).to_bytes(2)
    robot, hellos = calling(), 0
    for step in range(1000):
        now = step / 1000
        robot.poll(now)
        for _ in robot.outgoing():
            hellos += 1
            forged = b"\x16\xfe\xfd" + hellos.to_bytes(8) + size + message
            robot.receive(forged, source=AT_OPERATOR, now=now)
    assert robot.faults["handshakes"] <= 10
    assert robot.failure == "unknown cipher returned"
