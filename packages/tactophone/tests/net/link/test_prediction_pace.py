"""Predictions of a paired robot gone wrong: no more of them are computed than a robot
makes, so that none is felt when it is long silent."""

import pytest

from tactophone.core.types import Prediction, Touch
from tactophone.net.link.events import (
    Connected,
    LoggedSession,
    PacketReceived,
    write_event,
)
from tactophone.net.link.packet import CLOCK_RATE, Packet, Payload, write_predictions
from tactophone.net.link.receive import PredictionReceived, ReceiveSession
from tactophone.net.link.stream import (
    FRESH_AT_ONCE,
    SOUND_AT_ONCE,
    SOUND_PACE,
    SOUND_STALE_AFTER,
)

HOP = 480
"""Samples from one prediction to the next, as the shipped models have it."""

ROUGH = Prediction((0.0, 0.0, 1.0), Touch.ROUGH, 1.0, -20.0, 0.0, 0.256)


class Operator:
    """The receiving end of a link, without network or clock."""

    def __init__(self) -> None:
        self.session = ReceiveSession(LoggedSession())
        self.session.receive([(write_event(Connected("robot", 1, 2)), ("", 0))], now=1)
        self.count = 0

    def take(self, position: int, *, now: float) -> list[PredictionReceived]:
        """Receive a prediction that ends at a position, in samples."""
        kind, content = write_predictions({0: ROUGH}, fingers=1)
        payload = Payload(kind, position % (1 << 32), content)
        packet = bytes(Packet(self.count % (1 << 16), 2, payload))
        self.count += 1
        event = write_event(PacketReceived(packet, report=False))
        return [
            event
            for event in self.session.receive([(event, ("", 0))], now=now)
            if isinstance(event, PredictionReceived)
        ]


@pytest.mark.parametrize("jump", [HOP, 4_800, 2**31 - 1])
def test_a_backlog_of_predictions_that_run_ahead_is_not_felt(jump: int) -> None:
    operator = Operator()
    found = [
        each
        for number in range(2_500)
        for each in operator.take(number * jump, now=100 + number * 1e-4)
    ]
    fresh = [each for each in found if not each.stale]
    lasts = 0.25 * SOUND_PACE + FRESH_AT_ONCE
    assert 0 < len(fresh) <= 1 + lasts * CLOCK_RATE / HOP
    assert operator.session.counters["packets_skipped"] == 2_500 - len(found)


def test_predictions_a_sample_apart_are_computed_in_bounded_number() -> None:
    operator = Operator()
    found = [
        each
        for number in range(20_000)
        for each in operator.take(number, now=100 + number * 1e-4)
    ]
    # Two seconds, and what may come at once after a stall, at 1,000 a second.
    assert len(found) <= 1_000 * (2 * SOUND_PACE + SOUND_AT_ONCE) + 1


@pytest.mark.parametrize("hop", [120, HOP, 1_536])
def test_a_robot_that_keeps_time_is_felt_in_every_prediction(hop: int) -> None:
    operator = Operator()
    for number in range(3_000):
        found = operator.take(number * hop, now=100 + number * hop / CLOCK_RATE)
        assert [each.stale for each in found] == [False]


def test_after_a_stall_of_the_path_the_newest_predictions_are_felt() -> None:
    operator = Operator()
    for number in range(100):
        operator.take(number * HOP, now=100 + number * 0.01)
    # Three seconds of them come at once, and then the path is as it was.
    late = [operator.take(number * HOP, now=104) for number in range(100, 401)]
    assert all(late)
    assert not late[-1][0].stale
    assert late[0][0].stale
    after = [
        operator.take(number * HOP, now=100 + number * 0.01)
        for number in range(401, 600)
    ]
    assert all(not each.stale for found in after for each in found)
    assert all(after)
    assert SOUND_STALE_AFTER < 3
