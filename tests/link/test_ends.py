"""Sound and belief from end to end over a line that loses, delays and stalls, in virtual time."""

import numpy as np
import pytest

from tactophone.link import (
    Codec,
    Connected,
    DecodedAudio,
    PredictionReceived,
    ReceiveEvent,
    ReceiveSession,
    RedundancyRule,
    SendSession,
)
from tactophone.simulation.network.impairments import ImpairedLine, NetworkProfile
from tactophone.simulation.network.virtual_link import VirtualLine
from tactophone.types import AudioBlock, FloatArray, Prediction, Touch

from .lines import answering, calling

RATE = 48_000
PCM = Codec("pcm16", packet_size=120)


class Call:
    """Robot and operator, a line each way, and the time."""

    def __init__(
        self, codec: Codec = PCM, *, profile: NetworkProfile | None = None, rule: RedundancyRule | None = None
    ) -> None:
        self.line = VirtualLine(SendSession(calling(), codec, rule=rule), ReceiveSession(answering()))
        self.robot, self.operator = self.line.robot, self.line.operator
        self.now = self.line.connect(100.0)
        self.line.there = ImpairedLine(profile or NetworkProfile(), seed=1)
        self.line.back = ImpairedLine(profile or NetworkProfile(), seed=2)
        self.news: list[tuple[float, ReceiveEvent]] = []
        self.position = 0

    def run(self, seconds: float, *, sound: FloatArray | None = None, beliefs: bool = False) -> None:
        for _ in range(round(seconds / 0.0025)):
            self.position += 120
            if sound is not None:
                self.robot.push(AudioBlock(sound[self.position - 120 : self.position], RATE, self.position - 120))
            if beliefs:
                end = self.position / RATE
                self.robot.tell(Prediction((0.0, 0.25, 0.75), Touch.ROUGH, 0.75, -20.0, max(0.0, end - 0.256), end))
            self.step()

    def step(self) -> None:
        self.now += 0.0025
        self.news += [(self.now, one) for one in self.line.carry(self.now)]

    def heard(self) -> list[DecodedAudio]:
        return [one for _, one in self.news if isinstance(one, DecodedAudio)]


def noise(seconds: float) -> FloatArray:
    return np.random.default_rng(0).integers(-3_000, 3_000, (round(seconds * RATE), 2)).astype(np.float32) / 32_768


def test_sound_arrives_to_the_bit() -> None:
    call, sound = Call(), noise(1)
    call.run(1, sound=sound)
    np.testing.assert_array_equal(np.concatenate([one.block.samples for one in call.heard()]), sound)
    assert call.operator.counters["packets_received"] == call.robot.counters["packets_sent"] == 400


def test_reports_tell_loss_and_the_way_there_and_back() -> None:
    call = Call(profile=NetworkProfile(delay=0.01, loss=0.05))
    call.run(4, sound=noise(4))
    assert call.robot.round_trip == pytest.approx(0.02, abs=0.006)
    assert call.robot.redundancy.depth == 2
    counters = call.operator.counters
    assert counters["packets_lost"] == pytest.approx(80, rel=0.5)
    assert counters["packets_recovered"] > 0.8 * counters["packets_lost"]
    assert call.operator.gauges["redundancy"] > 0


def test_redundancy_is_shed_on_a_clean_line() -> None:
    call = Call()
    call.run(11, sound=noise(11))
    assert call.robot.redundancy.depth == 0
    assert call.operator.gauges["bitrate_bps"] == pytest.approx(8 * 400 * (480 + 12 + 16 + 28), rel=0.03)


def test_fixed_redundancy_stays() -> None:
    call = Call(codec=Codec("opus", packet_size=120), rule=RedundancyRule(least=2, most=2))
    call.run(11, sound=noise(11))
    assert call.robot.redundancy.depth == 2


def test_every_new_session_begins_its_stream_anew() -> None:
    call, sound = Call(), noise(2)
    call.run(0.5, sound=sound)
    call.line.robot = call.robot = SendSession(calling(), PCM)
    call.run(0.5, sound=sound)
    begun = [one for _, one in call.news if isinstance(one, Connected)]
    assert len(begun) == 1
    assert [one.block.start for one in call.heard()].count(0) == 2
    assert call.operator.counters["handshakes"] == 2
    assert call.operator.counters["packets_received"] == len(call.heard())


def test_after_a_stall_sound_is_fresh_again_at_once() -> None:
    call, sound = Call(), noise(2)
    call.run(1, sound=sound)
    for _ in range(80):  # the line holds everything back for 200 ms
        call.position += 120
        call.robot.push(AudioBlock(sound[call.position - 120 : call.position], RATE, call.position - 120))
        call.now += 0.0025
    call.step()
    resumed = call.now
    call.run(0.2, sound=sound)
    fresh = [
        when for when, one in call.news if isinstance(one, DecodedAudio) and not one.stale and when >= resumed - 1e-9
    ]
    assert fresh[0] - resumed < 0.01
    assert call.operator.counters["packets_skipped"] == pytest.approx(56, abs=2)


def test_belief_crosses_in_tens_of_bytes() -> None:
    call = Call()
    call.run(0.5, beliefs=True)
    believed = [one for _, one in call.news if isinstance(one, PredictionReceived)]
    assert len(believed) == 200
    assert believed[5].prediction.touch is Touch.ROUGH
    assert believed[5].prediction.probabilities == pytest.approx((0, 0.25, 0.75), abs=1e-4)
    assert call.operator.gauges["bitrate_bps"] < 8 * 400 * 80


def test_belief_that_comes_too_late_says_so() -> None:
    call = Call(profile=NetworkProfile(stall=0.2, stall_interval=0.5))
    call.run(3, beliefs=True)
    believed = [one for _, one in call.news if isinstance(one, PredictionReceived)]
    assert any(one.stale for one in believed)
    assert [one.prediction.end for one in believed] == sorted(one.prediction.end for one in believed)


def test_sound_that_is_no_number_is_counted_and_sent_as_silence() -> None:
    call, sound = Call(), noise(0.1)
    sound[500:510] = np.nan
    call.run(0.1, sound=sound)
    assert np.isfinite(np.concatenate([one.block.samples for one in call.heard()])).all()
    assert call.robot.counters["sound_faults"] == 1


def test_nothing_is_sent_while_nobody_is_connected() -> None:
    robot = SendSession(calling(), PCM)
    robot.push(AudioBlock(noise(0.01), RATE))
    assert robot.outgoing() == []


def test_the_clocked_buffer_gives_the_sound_in_step_with_the_listener() -> None:
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
    call.line.robot = call.robot = SendSession(calling(), Codec("opus", packet_size=120), follow=follow)
    call.operator.bandwidth = 7_600
    tone = 0.3 * np.sin(2 * np.pi * 6_000 * np.arange(2 * RATE) / RATE)
    call.run(1.5, sound=np.stack([tone, tone], axis=1).astype(np.float32))
    level = np.concatenate([one.block.samples for one in call.heard()])[-RATE // 2 :].std()
    assert bool(level > 0.15) is passed
    assert call.robot.codec.bitrate_bps == (256_000 if follow else 128_000)


def test_foreign_datagrams_are_counted() -> None:
    call = Call()
    call.operator.receive([(b"hello", ("203.0.113.9", 1)), (b"\x80" + bytes(30), ("203.0.113.9", 1))], now=call.now)
    assert call.operator.counters["packets_rejected"] == 2


def test_counters_only_ever_grow() -> None:
    call = Call(profile=NetworkProfile(loss=0.05, spread=0.02, duplicates=0.05, overtaking=True))
    before = call.operator.counters
    for _ in range(200):
        call.run(0.01, sound=noise(3))
        after = call.operator.counters
        assert all(after[name] >= total for name, total in before.items())
        before = after
