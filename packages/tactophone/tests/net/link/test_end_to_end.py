"""Sound and predictions from end to end over a link that loses, delays and stalls, in
virtual time."""

import numpy as np
import pytest

from benchmarks.virtual_link import VirtualLink
from tactophone.core.types import AudioBlock, FloatArray, Prediction, Touch
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.events import Connected
from tactophone.net.link.receive import PredictionReceived, ReceiveEvent, ReceiveSession
from tactophone.net.link.send import SendGroup
from tactophone.net.link.stream import DecodedAudio, RedundancyRule

from .session_pair import answering, calling

RATE = 48_000
PCM = Codec("pcm16", packet_size=120)


class Call:
    """Robot and operator, a link each way, and the time."""

    def __init__(
        self,
        codec: Codec = PCM,
        *,
        profile: NetworkProfile | None = None,
        rule: RedundancyRule | None = None,
    ) -> None:
        self.link = VirtualLink(
            SendGroup([calling()], codec, rule=rule), ReceiveSession(answering())
        )
        self.robot, self.operator = self.link.robot, self.link.operator
        self.now = self.link.connect(100.0)
        self.link.to_operator = ImpairedLink(profile or NetworkProfile(), seed=1)
        self.link.to_robot = ImpairedLink(profile or NetworkProfile(), seed=2)
        self.events: list[tuple[float, ReceiveEvent]] = []
        self.position = 0

    def run(
        self,
        seconds: float,
        *,
        sound: FloatArray | None = None,
        predictions: bool = False,
    ) -> None:
        for _ in range(round(seconds / 0.0025)):
            self.position += 120
            if sound is not None:
                self.robot.push(
                    AudioBlock(
                        sound[self.position - 120 : self.position],
                        RATE,
                        self.position - 120,
                    )
                )
            if predictions:
                end = self.position / RATE
                prediction = Prediction(
                    (0.0, 0.25, 0.75),
                    Touch.ROUGH,
                    0.75,
                    -20.0,
                    max(0.0, end - 0.256),
                    end,
                )
                self.robot.send_predictions({0: prediction})
            self.step()

    def step(self) -> None:
        self.now += 0.0025
        self.events += [(self.now, event) for event in self.link.carry(self.now)]

    def decoded(self) -> list[DecodedAudio]:
        return [event for _, event in self.events if isinstance(event, DecodedAudio)]


def noise(seconds: float) -> FloatArray:
    return (
        np.random.default_rng(0)
        .integers(-3_000, 3_000, (round(seconds * RATE), 2))
        .astype(np.float32)
        / 32_768
    )


def test_sound_arrives_exactly() -> None:
    call, sound = Call(), noise(1)
    call.run(1, sound=sound)
    np.testing.assert_array_equal(
        np.concatenate([event.block.samples for event in call.decoded()]), sound
    )
    assert (
        call.operator.counters["packets_received"]
        == call.robot.counters["packets_sent"]
        == 400
    )


def test_reports_contain_loss_and_round_trip_time() -> None:
    call = Call(profile=NetworkProfile(delay=0.01, loss=0.05))
    call.run(4, sound=noise(4))
    assert call.robot.round_trip == pytest.approx(0.02, abs=0.006)
    assert call.robot.members[0].redundancy.depth == 2
    counters = call.operator.counters
    assert counters["packets_lost"] == pytest.approx(80, rel=0.5)
    assert counters["packets_recovered"] > 0.8 * counters["packets_lost"]
    assert call.operator.gauges["redundancy"] > 0


def test_redundancy_is_dropped_on_a_clean_link() -> None:
    call = Call()
    call.run(11, sound=noise(11))
    assert call.robot.members[0].redundancy.depth == 0
    assert call.operator.gauges["bitrate_bps"] == pytest.approx(
        8 * 400 * (480 + 12 + 16 + 28), rel=0.03
    )


@pytest.mark.slow
def test_fixed_redundancy_stays() -> None:
    call = Call(
        codec=Codec("opus", packet_size=120), rule=RedundancyRule(least=2, most=2)
    )
    call.run(11, sound=noise(11))
    assert call.robot.members[0].redundancy.depth == 2


def test_every_new_session_begins_a_new_stream() -> None:
    call, sound = Call(), noise(2)
    call.run(0.5, sound=sound)
    call.link.robot = call.robot = SendGroup([calling()], PCM)
    call.run(0.5, sound=sound)
    begun = [event for _, event in call.events if isinstance(event, Connected)]
    assert len(begun) == 1
    starts = [event.block.start for event in call.decoded()]
    assert starts == sorted(starts)
    assert starts.count(0) == 1
    # The times go on by the operator's clock; what was before the new stream is no
    # loss.
    assert starts[-1] == pytest.approx(1.0 * RATE, abs=0.05 * RATE)
    assert not any(event.block.concealed for event in call.decoded())
    assert call.operator.stats.samples_skipped == 0
    assert call.operator.counters["handshakes"] == 2
    assert call.operator.counters["packets_received"] == len(call.decoded())


def test_after_a_stall_sound_is_fresh_again_at_once() -> None:
    call, sound = Call(), noise(2)
    call.run(1, sound=sound)
    for _ in range(80):  # the link holds everything back for 200 ms
        call.position += 120
        call.robot.push(
            AudioBlock(
                sound[call.position - 120 : call.position], RATE, call.position - 120
            )
        )
        call.now += 0.0025
    call.step()
    resumed = call.now
    call.run(0.2, sound=sound)
    fresh = [
        when
        for when, event in call.events
        if isinstance(event, DecodedAudio)
        and not event.stale
        and when >= resumed - 1e-9
    ]
    assert fresh[0] - resumed < 0.01
    assert call.operator.counters["packets_skipped"] == pytest.approx(56, abs=2)


def test_predictions_take_tens_of_bytes() -> None:
    call = Call()
    call.run(0.5, predictions=True)
    received = [
        event for _, event in call.events if isinstance(event, PredictionReceived)
    ]
    assert len(received) == 200
    assert received[5].prediction.touch is Touch.ROUGH
    assert received[5].prediction.probabilities == pytest.approx(
        (0, 0.25, 0.75), abs=1e-4
    )
    assert call.operator.gauges["bitrate_bps"] < 8 * 400 * 80


def test_a_late_prediction_is_stale() -> None:
    call = Call(profile=NetworkProfile(stall=0.2, stall_interval=0.5))
    call.run(3, predictions=True)
    received = [
        event for _, event in call.events if isinstance(event, PredictionReceived)
    ]
    assert any(event.stale for event in received)
    assert [event.prediction.end for event in received] == sorted(
        event.prediction.end for event in received
    )


def test_non_finite_sound_is_counted_and_sent_as_silence() -> None:
    call, sound = Call(), noise(0.1)
    sound[500:510] = np.nan
    call.run(0.1, sound=sound)
    assert np.isfinite(
        np.concatenate([event.block.samples for event in call.decoded()])
    ).all()
    assert call.robot.counters["sound_faults"] == 1


def test_nothing_is_sent_while_nobody_is_connected() -> None:
    robot = SendGroup([calling()], PCM)
    robot.push(AudioBlock(noise(0.01), RATE))
    assert robot.members[0].session.outgoing() == []


def test_the_clocked_buffer_returns_the_sound_at_the_listeners_rate() -> None:
    call, sound = Call(), noise(3)
    call.run(1.5)
    played = []
    for _ in range(600):
        call.run(0.0025, sound=sound)
        played.append(call.operator.pull(120, now=call.now))
    # The interpolator gives up the noise's highest fifth.
    assert np.concatenate(played)[RATE:].std() == pytest.approx(sound.std(), rel=0.15)
    assert 0 < call.operator.gauges["playout_delay"] < 0.03


@pytest.mark.parametrize(("follow", "passed"), [(True, True), (False, False)])
def test_the_bandwidth_follows_the_operators_model(follow: bool, passed: bool) -> None:
    call = Call(Codec("opus", packet_size=120))
    call.link.robot = call.robot = SendGroup(
        [calling()], Codec("opus", packet_size=120), follow=follow
    )
    call.operator.bandwidth = 7_600
    tone = 0.3 * np.sin(2 * np.pi * 6_000 * np.arange(2 * RATE) / RATE)
    call.run(1.5, sound=np.stack([tone, tone], axis=1).astype(np.float32))
    level = np.concatenate([event.block.samples for event in call.decoded()])[
        -RATE // 2 :
    ].std()
    assert bool(level > 0.15) is passed
    assert call.robot.encoder.codec.bitrate_bps == (256_000 if follow else 128_000)


def test_foreign_datagrams_are_counted() -> None:
    call = Call()
    call.operator.receive(
        [(b"hello", ("203.0.113.9", 1)), (b"\x80" + bytes(30), ("203.0.113.9", 1))],
        now=call.now,
    )
    assert call.operator.counters["packets_rejected"] == 2


def test_counters_only_ever_grow() -> None:
    call = Call(
        profile=NetworkProfile(loss=0.05, spread=0.02, duplicates=0.05, overtaking=True)
    )
    before = call.operator.counters
    for _ in range(200):
        call.run(0.01, sound=noise(3))
        after = call.operator.counters
        assert all(after[name] >= total for name, total in before.items())
        before = after
