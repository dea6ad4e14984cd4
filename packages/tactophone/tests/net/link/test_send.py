"""One robot and several operators, in virtual time: each gets what it would get alone,
whatever the others do."""

import random
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.virtual_link import OPERATOR_ADDRESS, VirtualLink
from tactophone.core.types import MOST_OPERATORS, AudioBlock, Prediction, Touch
from tactophone.net.endpoints import OperatorEndpoint, RobotEndpoint
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.events import Connected, Disconnected, PacketReceived
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.packet import Packet, Payload, PayloadType, is_report
from tactophone.net.link.receive import PredictionReceived, ReceiveSession
from tactophone.net.link.rtcp import (
    Goodbye,
    Introduction,
    ReceiverReport,
    ReceiverRequest,
    SenderReport,
)
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import Session
from tactophone.net.link.stream import DecodedAudio
from tactophone.signal.pipeline import Hand, open_pipeline

OPUS = Codec("opus", packet_size=120)
PACKET = 0.0025


class GroupCall:
    """A robot and its operators, each with a link of its own."""

    def __init__(
        self,
        operators: int,
        codec: Codec = OPUS,
        *,
        trusting: int = MOST_OPERATORS,
        renew_after: float = 1e9,
    ) -> None:
        self.robot = Identity.create("robot")
        identities = [
            Identity.create(f"operator {number}") for number in range(operators)
        ]
        trusted = Peers({each.fingerprint: each.name for each in identities})
        callers = [
            Session(self.robot, trusted, call=OPERATOR_ADDRESS, renew_after=renew_after)
            for number in range(operators)
        ]
        self.group = SendGroup(callers, codec, follow=True)
        answerers = [
            ReceiveSession(
                Session(
                    each,
                    Peers(
                        {self.robot.fingerprint: "robot"} if number < trusting else {}
                    ),
                )
            )
            for number, each in enumerate(identities)
        ]
        self.links = [
            VirtualLink(self.group, each, number=number)
            for number, each in enumerate(answerers)
        ]
        self.events = [[] for _ in range(operators)]
        self.now, self.start = 0.0, 0

    def carry(self, *, without: tuple[int, ...] = ()) -> None:
        for number, link in enumerate(self.links):
            if number not in without:
                self.events[number] += link.carry(self.now)

    def connect(self, operators: int) -> None:
        without = tuple(range(operators, len(self.links)))
        while len(self.group.connected) < operators and self.now < 2.0:
            self.carry(without=without)
            self.now += 0.005
        assert len(self.group.connected) == operators

    def run(
        self,
        duration: float,
        each: Callable[["GroupCall"], None] = lambda _: None,
        *,
        without=(),
    ) -> None:
        for _ in range(round(duration / PACKET)):
            self.group.push(
                AudioBlock(
                    SOUND[
                        self.start : self.start + 120,
                        : self.group.encoder.codec.channels,
                    ],
                    48_000,
                    self.start,
                )
            )
            self.start, self.now = self.start + 120, self.now + PACKET
            each(self)
            self.carry(without=without)

    def decoded(self, operator: int) -> bytes:
        return b"".join(
            event.block.samples.tobytes()
            for event in self.events[operator]
            if isinstance(event, DecodedAudio)
        )

    def send_as(self, operator: int, message: bytes) -> None:
        """Send a message under the operator's own keys, as an operator that obeys
        nobody could."""
        (stream,) = self.group.members[operator].session.remote[1]
        packet = bytearray(message)
        at = 4 if is_report(packet) else 8
        packet[at : at + 4] = stream.to_bytes(4)
        self.links[operator].operator.session.send(bytes(packet))


SOUND = np.random.default_rng(0).normal(0, 0.05, (48_000, 4)).astype(np.float32)


def alone(duration: float) -> bytes:
    call = GroupCall(1)
    call.connect(1)
    call.run(duration)
    return call.decoded(0)


@pytest.mark.parametrize("fingers", [1, 2])
def test_two_operators_feel_the_same_to_the_bit(fingers: int) -> None:
    call = GroupCall(2, Codec("opus", channels=2 * fingers, packet_size=120))
    for link in call.links:
        pipelines = [
            open_pipeline(sample_rate=48_000, channels=2) for _ in range(fingers)
        ]
        link.operator = OperatorEndpoint(link.operator, Hand(pipelines))
    call.connect(2)
    robot, felt = RobotEndpoint(call.group), [[], []]
    for start in range(0, 24_000, 120):
        robot.push(AudioBlock(SOUND[start : start + 120, : 2 * fingers], 48_000, start))
        call.now += PACKET
        for link, steps in zip(call.links, felt, strict=True):
            steps += [
                (s.finger, s.predictions, s.commands)
                for _, s in link.carry(call.now)
                if s is not None
            ]
    assert felt[0] == felt[1]
    assert any(command.amplitude for _, _, commands in felt[0] for command in commands)


def test_an_operator_that_leaves_or_comes_later_changes_nothing_for_the_other() -> None:
    call = GroupCall(2)
    call.connect(1)
    call.run(0.1, without=(1,))
    call.run(0.3)
    assert call.group.peers == ["operator 0", "operator 1"]
    assert any(isinstance(event, DecodedAudio) for event in call.events[1])
    call.links[1].operator.session.hang_up()
    call.run(PACKET)  # with the goodbye; then its process is gone
    call.run(0.1 - PACKET, without=(1,))
    assert call.group.peers == ["operator 0"]
    assert [
        type(event) for event in call.events[0] if not isinstance(event, DecodedAudio)
    ] == [Connected]
    assert call.decoded(0) == alone(0.5)


def test_whoever_comes_later_soon_decodes_the_same() -> None:
    call = GroupCall(2)
    call.connect(1)
    call.run(0.1, without=(1,))
    call.run(0.6)
    first, second = (
        np.frombuffer(call.decoded(number), np.float32)[-9600:] for number in (0, 1)
    )
    assert np.abs(first - second).max() < 1e-3


def test_a_link_that_loses_packets_costs_only_its_own_operator() -> None:
    call = GroupCall(2)
    call.connect(2)
    call.links[1].to_operator = ImpairedLink(NetworkProfile(loss=0.3), seed=1)
    call.run(0.8)
    assert [member.redundancy.depth for member in call.group.members] == [1, 2]
    assert call.group.loss > 0.1
    assert call.decoded(0) == alone(0.8)


def test_a_hostile_operator_changes_nothing_for_the_other() -> None:
    call, generator = GroupCall(2), random.Random(0)
    call.connect(2)
    seen: list[bytes] = []
    push = call.links[1].to_robot.push
    call.links[1].to_robot.push = lambda datagram, *, now: (
        seen.append(datagram),
        push(datagram, now=now),
    )

    def attack(call: GroupCall) -> None:
        for _ in range(5):
            forged = generator.randbytes(generator.randrange(200))
            changed = bytearray(generator.choice(seen) if seen else b"\x80")
            changed[generator.randrange(len(changed))] ^= 1
            for datagram in (forged, bytes(changed), *seen[-1:]):
                push(datagram, now=call.now)

    call.run(0.5, attack)
    assert call.group.members[1].session.faults["rejected"] > 100
    assert call.group.members[0].session.refused == 0
    assert call.decoded(0) == alone(0.5)


def test_an_operator_without_trust_gets_nothing_and_the_other_gets_all() -> None:
    call = GroupCall(2, trusting=1)
    call.connect(1)
    call.run(0.5)
    assert call.group.peers == ["operator 0"]
    assert "refused this machine's certificate" in str(
        call.group.members[1].session.failure
    )
    assert not call.events[1]
    assert call.decoded(0) == alone(0.5)


def test_each_operator_renews_its_keys_without_a_gap_at_any() -> None:
    call = GroupCall(2, renew_after=0.2)
    call.connect(2)
    call.run(0.5)
    assert min(member.counters["handshakes"] for member in call.group.members) > 1
    keys = {member.session.remote[1] for member in call.group.members}
    assert len(keys) == 2
    assert call.decoded(0) == call.decoded(1) == alone(0.5)


MOTOR = (
    0.016
    * np.sin(2 * np.pi * 220 * np.arange(48_000) / 48_000)[:, np.newaxis]
    * np.ones((1, 2))
).astype(np.float32)
"""A motor that runs steadily, at -36 dBFS: a step in it would be felt."""

INAUDIBLE = 10 ** (-60 / 20)
"""Greatest difference, as an rms value over any 20 ms, that one operator may make for
another; the error of the codec itself is as large."""

WORDS = st.integers(0, 2**32 - 1)

REPORTS = st.one_of(
    st.builds(lambda hertz: ReceiverRequest(1, hertz), WORDS),
    st.builds(lambda hertz: ReceiverRequest(1, hertz), st.integers(0, 30_000)),
    st.builds(
        lambda of, lost, highest, stamp: ReceiverReport(
            1, of, lost / 255, lost, highest, 0.0, stamp, 0.0
        ),
        WORDS,
        st.integers(0, 255),
        WORDS,
        WORDS,
    ),
    st.builds(lambda ntp, at: SenderReport(1, ntp, at, 1, 1), st.floats(0, 1e9), WORDS),
    st.builds(lambda text: Introduction(1, text), st.text(max_size=40)),
    st.builds(lambda text: Goodbye(1, text), st.text(max_size=40)),
)


def decoded_beside(reports: list[bytes]) -> np.ndarray:
    """Decode a steady motor as one operator while another sends ``reports``, one a
    packet, under its own keys."""
    call = GroupCall(2, Codec("opus", packet_size=240))
    call.connect(2)
    sent = iter(reports)
    for start in range(0, 24_000, 240):
        call.group.push(AudioBlock(MOTOR[start : start + 240], 48_000, start))
        call.now += 0.005
        if (
            start > 9_600
            and call.group.members[1].session.peer
            and (report := next(sent, None))
        ):
            call.send_as(1, report)
        call.carry()
    assert call.group.members[0].session.peer == "operator 0"
    return np.frombuffer(call.decoded(0), np.float32).reshape(-1, 2)


def greatest_difference(first: np.ndarray, second: np.ndarray) -> float:
    difference = (first - second)[: len(first) // 960 * 960].reshape(-1, 960 * 2)
    return float(np.sqrt((difference**2).mean(axis=1)).max())


UNDISTURBED = decoded_beside([])


@settings(max_examples=12, deadline=None)
@given(st.lists(REPORTS, min_size=1, max_size=60))
def test_no_reports_of_one_operator_change_what_another_decodes(reports) -> None:
    decoded = decoded_beside([bytes(report) for report in reports])
    assert greatest_difference(decoded, UNDISTURBED) < INAUDIBLE


def test_a_ladder_of_requests_makes_no_step_in_the_sound_of_others() -> None:
    ladder = [bytes(ReceiverRequest(1, 4_001 + step)) for step in range(60)]
    assert greatest_difference(decoded_beside(ladder), UNDISTURBED) < INAUDIBLE
    jumps = [
        bytes(ReceiverRequest(1, hertz))
        for hertz in (4_001, 9_000, 4_000, 2**32 - 1, 0) * 10
    ]
    assert greatest_difference(decoded_beside(jumps), UNDISTURBED) < INAUDIBLE


def test_a_ladder_of_requests_vibrates_no_other_fingertip() -> None:
    call, commands = GroupCall(2, Codec("opus", packet_size=240)), []
    pipeline = open_pipeline(sample_rate=48_000, channels=2)
    link = call.links[0]
    link.operator.bandwidth = round(pipeline.detector.bandwidth)
    link.operator = OperatorEndpoint(link.operator, Hand([pipeline]))
    call.connect(2)
    noise = np.random.default_rng(1).normal(0, 10 ** (-65 / 20), (48_000, 2))
    sound = (np.tile(MOTOR + noise, (3, 1))).astype(np.float32)
    for number, start in enumerate(range(0, len(sound), 240)):
        call.group.push(AudioBlock(sound[start : start + 240], 48_000, start))
        call.now += 0.005
        # The first two seconds: the detector learns that the motor is no touch.
        if start > 96_000:
            call.send_as(1, bytes(ReceiverRequest(1, 8_001 + number)))
        for _, step in link.carry(call.now):
            if step is not None and start > 96_000:
                commands += step.commands
        call.links[1].carry(call.now)
    assert len(commands) > 50
    assert max(command.amplitude for command in commands) == 0.0


def test_the_band_widens_once_in_ten_seconds_but_at_once_for_who_just_came_in() -> None:
    call = GroupCall(3)
    call.connect(2)
    bands = []
    for operator, hertz in ((1, 4_001), (1, 8_001), (0, 12_001)):
        call.send_as(operator, bytes(ReceiverRequest(1, hertz)))
        call.run(0.05, without=(2,))
        bands.append(call.group.encoder.codec.bandwidth)
    # The second request of the same operator waits; the first one of the other does
    # not, which then has no more to wait for.
    assert bands == [8_000, 8_000, 20_000]
    call = GroupCall(1)
    call.connect(1)
    for hertz in (4_001, 8_001):
        call.send_as(0, bytes(ReceiverRequest(1, hertz)))
        call.run(0.05)
    assert call.group.encoder.codec.bandwidth == 8_000
    for _ in range(100):
        call.now += 0.1
        call.carry()
    call.send_as(0, bytes(ReceiverRequest(1, 8_001)))
    call.carry()
    assert call.group.encoder.codec.bandwidth == 12_000


@pytest.mark.parametrize(
    ("name", "fingers", "size", "band"),
    [
        ("opus", 3, 960, 8_000),
        ("opus", 6, 480, 8_000),
        ("opus", 5, 480, 8_000),
        ("opus", 5, 960, 4_000),
        ("opus", 10, 480, 4_000),
        ("opus", 10, 240, 8_000),
        ("pcm16", 10, 30, 0),
    ],
)
def test_a_hand_runs_with_the_widest_band_that_fits_a_datagram_and_says_which(
    name: str, fingers: int, size: int, band: int
) -> None:
    codec = Codec(name, channels=2 * fingers, packet_size=size)
    call = GroupCall(1, codec)
    call.connect(1)
    for hertz in (8_000, 2**32 - 1):
        call.send_as(0, bytes(ReceiverRequest(1, hertz)))
        call.carry()
        if hertz == 8_000:
            narrowed = call.group.narrowed
    silence = np.zeros((960, codec.channels), np.float32)
    call.group.push(AudioBlock(silence, 48_000, 0))
    call.carry()
    assert any(isinstance(event, DecodedAudio) for event in call.events[0])
    assert not call.group.members[0].session.faults["contained"]
    if band:
        assert call.group.encoder.codec.bandwidth == band
    if band == 4_000:
        assert narrowed == (
            "sound up to 4 kHz is sent, but an operator's model hears up to 8 kHz, "
            f"which packets of {size / 48:g} ms cannot hold with {2 * fingers} "
            "channels; "
            "choose a shorter --packet-duration"
        )
    else:
        assert narrowed == ""


@pytest.mark.parametrize("end", ["robot", "operator"])
def test_an_error_of_our_own_ends_the_session_with_its_cause_and_no_other(
    end: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(packet: bytes) -> None:
        raise ZeroDivisionError

    call = GroupCall(2)
    call.connect(2)
    if end == "robot":
        call.send_as(1, bytes(ReceiverRequest(1, 8_000)))
        monkeypatch.setattr("tactophone.net.link.send.parse_report", fail)
        call.links[1].carry(call.now)
        monkeypatch.undo()
        failed = call.group.members[1].session
        assert call.group.counters["link_losses"] == 1
    else:
        call.now += 0.3
        for number in (0, 1):
            call.group.poll(call.now, operator=number)
        monkeypatch.setattr("tactophone.net.link.receive.parse_report", fail)
        call.events[1] += call.links[1].carry(call.now)
        monkeypatch.undo()
        failed = call.links[1].operator.session
        assert any(isinstance(event, Disconnected) for event in call.events[1])
    assert failed.faults["contained"] == 1
    assert failed.peer is None
    assert call.group.members[0].session.peer == "operator 0"
    for _ in range(120):
        call.now += 0.05
        call.carry()
    assert call.group.peers == ["operator 0", "operator 1"]


def test_a_handshake_that_raises_as_time_passes_ends_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(self: object, now: float) -> None:
        raise ZeroDivisionError

    call = GroupCall(1)
    call.group.poll(call.now)
    monkeypatch.setattr("tactophone.net.link.handshake.Handshake.poll", fail)
    call.group.poll(call.now + 0.05)
    monkeypatch.undo()
    assert call.group.members[0].session.faults["contained"] == 1
    for _ in range(120):
        call.now += 0.05
        call.carry()
    assert call.group.peers == ["operator 0"]


@pytest.mark.parametrize(
    "message",
    [
        ReceiverReport(1, 2, 1.0, 99, 0, 0.0, 7, 0.0),
        SenderReport(1, 0.0, 0, 0, 0),
        Introduction(1, "9.9"),
        Goodbye(1),
        Goodbye(1, "\x1b[2Jgone"),
        Packet(0, 1, Payload(PayloadType.L16_STEREO, 0, bytes(960)), (), False, False),
        Packet(0, 1, Payload(PayloadType.PREDICTION, 0, bytes(9)), (), False, False),
        b"\x80\xcc\x00\x03" + bytes(4) + b"STOP" + bytes(4),
        b"\x80\xcd" + bytes(30),
    ],
    ids=lambda message: type(message).__name__,
)
def test_what_one_operator_says_leaves_the_sound_of_the_other_equal_to_the_bit(
    message,
) -> None:
    call = GroupCall(2)
    call.connect(2)

    def speak(call: GroupCall) -> None:
        if call.group.members[1].session.peer:
            packet = bytearray(bytes(message))
            if not is_report(packet):
                # A new packet each time: libsrtp sends no number twice.
                packet[2:4] = (call.start // 120).to_bytes(2)
            call.send_as(1, bytes(packet))

    call.run(0.5, speak)
    assert call.group.members[0].session.peer == "operator 0"
    assert call.group.members[0].redundancy.depth == 1
    assert call.decoded(0) == alone(0.5)


def test_a_fifth_operator_is_refused() -> None:
    identity = Identity.create("robot")
    sessions = [
        Session(identity, Peers(), call=("192.0.2.1", port)) for port in range(5)
    ]
    with pytest.raises(ValueError, match="5 operators, but a robot has 1 to 4"):
        SendGroup(sessions, OPUS)


def test_predictions_go_to_all() -> None:
    call = GroupCall(2)
    call.connect(2)
    call.group.send_predictions(
        {0: Prediction((0.1, 0.2, 0.7), Touch.ROUGH, 0.8, -20.0, 0.0, 0.1)}
    )
    call.carry()
    first, second = (
        [e for e in events if isinstance(e, PredictionReceived)]
        for events in call.events
    )
    assert len(first) == 1
    assert first == second


def test_the_bandwidth_is_the_greatest_requested_while_others_listen() -> None:
    call = GroupCall(2)
    call.links[0].operator.bandwidth = 8_000
    call.connect(1)
    call.run(0.3, without=(1,))
    assert call.group.encoder.codec.bandwidth == 8_000
    call.links[1].operator.bandwidth = 4_000
    call.run(0.5)
    assert (len(call.group.connected), call.group.encoder.codec.bandwidth) == (2, 8_000)
    call.links[1].operator.bandwidth = 12_000
    call.run(0.3)
    assert call.group.encoder.codec.bandwidth == 12_000


def test_the_log_holds_one_operators_packets_and_goes_on_with_the_next() -> None:
    call, logged = GroupCall(2), []
    call.group.tap = logged.append
    call.connect(2)
    call.run(0.1)
    call.links[0].operator.session.hang_up()
    call.run(0.1)
    kinds = [type(event) for event in logged]
    assert kinds.count(PacketReceived) == 80
    changes = [event for event in logged if not isinstance(event, PacketReceived)]
    assert [(type(event), getattr(event, "peer", "")) for event in changes] == [
        (Connected, "operator 0"),
        (Disconnected, ""),
        (Connected, "operator 1"),
    ]


def test_an_operator_under_two_addresses_is_connected_once_and_refused_once() -> None:
    robot, operator = Identity.create("robot"), Identity.create("trainer")
    trusted, addresses = (
        Peers({operator.fingerprint: "trainer"}),
        [("192.0.2.1", 6000), ("198.51.100.1", 6000)],
    )
    group = SendGroup(
        [Session(robot, trusted, call=address) for address in addresses], OPUS
    )
    answerer = Session(operator, Peers({robot.fingerprint: "robot"}))
    connected = []

    def run(begin: float, end: float, *, unreachable: tuple[int, ...] = ()) -> None:
        for step in range(round(begin * 50), round(end * 50)):
            now = step / 50
            for number, member in enumerate(group.members):
                group.poll(now, operator=number)
                sent = (
                    []
                    if number in unreachable
                    else [datagram for datagram, _ in member.session.outgoing()]
                )
                for datagram in sent:
                    connected.extend(
                        answerer.receive(
                            datagram, source=("192.0.2.2", number), now=now
                        )
                    )
            answerer.poll(now)
            for datagram, (_, number) in answerer.outgoing():
                if number not in unreachable:
                    group.receive(
                        [(datagram, addresses[number])], now=now, operator=number
                    )

    run(0.0, 4.5)
    assert group.peers == ["trainer"]
    (left_out,) = [member for member in group.members if member.session.peer is None]
    assert left_out.session.failure == (
        "it is 'trainer', connected already under another address: name each operator "
        "once, and give each machine its own key"
    )
    # Two handshakes that end together replace each other at the operator; the robot
    # keeps the first, which calls again a second later.
    assert sum(isinstance(event, Connected) for event in connected) <= 3
    # Once the address in use fails, the other one takes over.
    in_use = next(
        number for number, member in enumerate(group.members) if member.session.peer
    )
    run(4.5, 20.0, unreachable=(in_use,))
    assert group.members[1 - in_use].session.peer == "trainer"
    assert group.members[in_use].session.peer is None
