"""One handshake alone; whole sessions are in test_session."""

import time
from collections.abc import Iterator
from itertools import product

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from OpenSSL import SSL

from tactophone.net.link.handshake import (
    HANDSHAKE_TIMEOUT,
    Handshake,
    Handshakes,
    hello_random,
    is_hello,
)
from tactophone.net.link.identity import Identity, Peers

from .session_pair import OPERATOR, ROBOT, UNTRUSTED


def run_handshake(
    lost: set[int], *, duration: float = 2.0
) -> tuple[Handshake, Handshake | None]:
    """Let robot and operator connect, but lose the datagrams with these numbers."""
    calling = Handshakes(ROBOT, Peers({OPERATOR.fingerprint: "operator"}))
    answering = Handshakes(OPERATOR, Peers({ROBOT.fingerprint: "robot"}))
    robot = calling.call(now=0.0)
    operator = None
    number = 0
    for step in range(round(duration / 0.01)):
        now = step * 0.01
        robot.poll(now)
        for datagram in robot.outgoing():
            number += 1
            if number in lost:
                continue
            if operator is not None and not is_hello(datagram):
                operator.receive(datagram, now=now)
            elif operator is None:
                operator, replies = answering.answer(datagram, source="robot", now=now)
                for reply in replies:
                    robot.receive(reply, now=now)
        if operator is not None:
            operator.poll(now)
            for datagram in operator.outgoing():
                number += 1
                if number not in lost:
                    robot.receive(datagram, now=now)
    return robot, operator


@pytest.mark.parametrize(
    "lost",
    [
        set(),
        *({k} for k in range(1, 8)),
        *({a, b} for a, b in product((2, 3), (4, 5, 6))),
    ],
)
def test_any_lost_datagram_is_retransmitted(lost: set[int]) -> None:
    robot, operator = run_handshake(lost)
    assert operator is not None
    assert robot.agreement is not None
    assert operator.agreement is not None
    assert robot.agreement.secrets.outbound == operator.agreement.secrets.inbound
    assert robot.agreement.secrets.local_ssrc == operator.agreement.secrets.remote_ssrc
    assert (robot.agreement.peer, operator.agreement.peer) == ("operator", "robot")


def test_every_handshake_makes_fresh_keys() -> None:
    keys = set()
    for _ in range(3):
        robot, _ = run_handshake(set(), duration=0.1)
        assert robot.agreement is not None
        keys |= {robot.agreement.secrets.outbound, robot.agreement.secrets.inbound}
    assert len(keys) == 6


def test_a_handshake_without_an_answer_fails() -> None:
    robot, _ = run_handshake(set(range(1, 1_000)), duration=HANDSHAKE_TIMEOUT + 0.5)
    assert robot.failure == f"no answer within {HANDSHAKE_TIMEOUT:g} s"
    assert robot.outgoing() == []


def test_a_hello_is_recognised_and_keeps_its_random() -> None:
    robot = Handshakes(UNTRUSTED, Peers()).call(now=0.0)
    (hello,) = robot.outgoing()
    robot.poll(0.2)
    (repeated,) = robot.outgoing()
    assert is_hello(hello)
    assert hello_random(hello) == hello_random(repeated)
    assert not is_hello(hello[:40])
    assert not is_hello(b"\x80" + hello[1:])


def steps_of_a_call(sent: list[bytes]) -> Iterator[tuple[Handshake, Handshake | None]]:
    """Carry one flight at a time, and note each datagram; time stands still for the
    handshakes, not for OpenSSL."""
    calling = Handshakes(ROBOT, Peers({OPERATOR.fingerprint: "operator"}))
    answering = Handshakes(OPERATOR, Peers({ROBOT.fingerprint: "robot"}))
    robot, operator = calling.call(now=0.0), None
    for _ in range(10):
        yield robot, operator
        for datagram in robot.outgoing():
            sent.append(datagram)
            if operator is not None:
                operator.receive(datagram, now=0.0)
                continue
            operator, replies = answering.answer(datagram, source="robot", now=0.0)
            yield robot, operator
            for reply in replies:
                robot.receive(reply, now=0.0)
        yield robot, operator
        for datagram in operator.outgoing() if operator else ():
            sent.append(datagram)
            robot.receive(datagram, now=0.0)


@pytest.mark.slow
def test_a_stall_of_a_second_neither_ends_a_handshake_nor_repeats_a_flight() -> None:
    """OpenSSL's own timer reads the wall clock; what it repeated made an answerer take
    the caller for a new one."""
    calls = []
    for stalled_at in range(8):
        sent: list[bytes] = []
        call = steps_of_a_call(sent)
        for _ in range(stalled_at + 1):
            ends = next(call)
        calls.append((call, sent, ends))
    time.sleep(1.1)
    for call, sent, ends in calls:
        robot, operator = [ends, *call][-1]
        assert robot.agreement is not None
        assert operator is not None
        assert operator.agreement is not None
        # Two hellos and three more flights; the cookie's flight is not counted.
        assert len(sent) == 5
        # One datagram begins with the change of the cipher.
        assert sum(datagram[0] == 20 for datagram in sent) == 1


def test_a_finished_handshake_ends_even_where_each_flight_is_repeated() -> None:
    """Over a long path both ends retransmit their last flights; they must not answer
    each other for ever."""
    robot, operator = run_handshake(set())
    assert operator is not None
    last = robot._newest_flight
    for _ in range(3):
        for datagram in last:
            operator.receive(datagram, now=10.0)
        for datagram in operator.outgoing():
            robot.receive(datagram, now=10.0)
        assert robot.outgoing() == []


def test_no_signature_with_sha1_is_offered() -> None:
    robot = Handshakes(ROBOT, Peers({OPERATOR.fingerprint: "operator"})).call(now=0.0)
    robot.poll(0.0)
    (hello,) = robot.outgoing()
    # The extension signature_algorithms (RFC 5246, 7.4.1.4.1), after its length.
    at = hello.index(b"\x00\x0d", 60) + 4
    size = int.from_bytes(hello[at : at + 2])
    offered = [hello[at + 2 + place : at + 4 + place] for place in range(0, size, 2)]
    assert b"\x04\x03" in offered  # ECDSA with SHA-256
    assert not [each.hex() for each in offered if each[0] == 2]


def test_a_cookie_serves_the_port_that_it_was_sent_to_alone() -> None:
    """Whoever forges another's address would otherwise use a cookie of its own, from
    another port of a shared host."""
    answering = Handshakes(OPERATOR, Peers({ROBOT.fingerprint: "robot"}))
    robot = Handshakes(ROBOT, Peers({OPERATOR.fingerprint: "operator"})).call(now=0.0)
    own, other = ("192.0.2.1", 5_000), ("192.0.2.1", 5_001)
    (hello,) = robot.outgoing()
    begun, (verify,) = answering.answer(hello, source=own, now=0.0)
    assert begun is None
    robot.receive(verify, now=0.0)
    (second,) = robot.outgoing()
    begun, replies = answering.answer(second, source=other, now=0.0)
    assert begun is None
    assert len(replies) == 1  # a cookie for that port
    begun, _ = answering.answer(second, source=own, now=0.0)
    assert begun is not None


def carry(robot: Handshake, answering: Handshakes) -> Handshake | None:
    """Carry flights without loss until nobody has more to say; return the answerer's
    handshake."""
    operator: Handshake | None = None
    while flight := [*robot.outgoing(), *(operator.outgoing() if operator else ())]:
        for datagram in flight:
            if operator is None:
                operator, replies = answering.answer(datagram, source="robot", now=0.0)
                for reply in replies:
                    robot.receive(reply, now=0.0)
            else:
                operator.receive(datagram, now=0.0)
        for datagram in operator.outgoing() if operator else ():
            robot.receive(datagram, now=0.0)
    return operator


def issued_by(issuer: Identity) -> Identity:
    """Return an identity whose certificate claims an issuer that never signed it."""
    stranger = Identity.create("stranger")
    builder = (
        x509.CertificateBuilder()
        .subject_name(stranger.certificate.subject)
        .issuer_name(issuer.certificate.subject)
        .public_key(stranger.key.public_key())
        .serial_number(1)
        .not_valid_before(issuer.certificate.not_valid_before_utc)
        .not_valid_after(issuer.certificate.not_valid_after_utc)
    )
    return Identity(stranger.key, builder.sign(stranger.key, hashes.SHA256()))


def test_a_trusted_certificate_above_ones_own_is_worth_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Certificates travel in plain text: anybody may send a trusted one along."""
    answering = Handshakes(OPERATOR, Peers({ROBOT.fingerprint: "robot"}))
    use = SSL.Context.use_certificate

    def use_two(context: SSL.Context, certificate: x509.Certificate) -> None:
        use(context, certificate)
        context.add_extra_chain_cert(ROBOT.certificate)

    monkeypatch.setattr(SSL.Context, "use_certificate", use_two)
    stranger = Handshakes(issued_by(ROBOT), Peers({OPERATOR.fingerprint: "operator"}))
    operator = carry(stranger.call(now=0.0), answering)
    assert operator is not None
    assert operator.failure
    assert operator.agreement is None
    # Else a stranger could claim the robot's place, which another session has.
    assert answering.taken == ""


def test_a_peer_without_the_agreed_cipher_of_the_sound_gets_no_session(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answering = Handshakes(OPERATOR, Peers({ROBOT.fingerprint: "robot"}))
    monkeypatch.setattr(
        "tactophone.net.link.handshake.PROFILE", b"SRTP_AES128_CM_SHA1_80"
    )
    calling = Handshakes(ROBOT, Peers({OPERATOR.fingerprint: "operator"}))
    monkeypatch.undo()
    operator = carry(calling.call(now=0.0), answering)
    assert operator is not None
    assert "AES-256-GCM" in (operator.failure or "")
    assert operator.agreement is None
