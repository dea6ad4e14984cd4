import numpy as np
import pytest

from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock
from tactophone.live.telemetry.layout import MARK, MARKS
from tactophone.signal.perception.health import FaultDetector
from tactophone_lab.measurement.impulses import ImpulsePlayer, analyse
from tactophone_lab.measurement.port_sounds import PortPlayer, PortSound

PERIOD = 128
LAGS = {
    "captured": 0.0001,
    "sent": 0.0003,
    "received": 0.0004,
    "released": 0.0005,
    "decoded": 0.0007,
    "detected": 0.0009,
}
"""Seconds after the period of the impulse."""


@pytest.fixture
def player(monkeypatch: pytest.MonkeyPatch) -> ImpulsePlayer:
    """A run of ten impulses, each with vibration three periods after its own, on an
    exact clock."""
    player = ImpulsePlayer(10, seed=3)
    monkeypatch.setattr(
        "tactophone_lab.measurement.impulses.time.monotonic",
        lambda: 100.0 + player.position / LIVE_SAMPLE_RATE,
    )
    vibration = np.zeros_like(player.vibration)
    for impulse in player.impulses:
        vibration[_period(impulse) + 3 * PERIOD + 5 :][:480] = 0.1
    outputs = [np.zeros(PERIOD, np.float32) for _ in range(2)]
    while not player.done:
        now = slice(player.position, player.position + PERIOD)
        player.process([vibration[now]], outputs)
    return player


def _period(sample: int) -> int:
    return int(sample) // PERIOD * PERIOD


def _marks(player: ImpulsePlayer) -> dict[str, np.ndarray]:
    marks = {name: [] for name in MARKS}
    for impulse in player.impulses:
        begun = 100.0 + _period(impulse) / LIVE_SAMPLE_RATE
        for name, lag in LAGS.items():
            marks[name].append((_period(impulse) + PERIOD, begun + lag))
        marks["rendered"].append(
            (_period(impulse) + PERIOD, begun + 3 * PERIOD / LIVE_SAMPLE_RATE - 0.0001)
        )
    return {name: np.array(rows, MARK) for name, rows in marks.items()}


def test_the_stages_add_up_to_the_end_to_end_latency(player: ImpulsePlayer) -> None:
    measured = analyse(player, _marks(player), period=PERIOD)
    assert measured.missed == 0
    offsets = np.array([impulse - _period(impulse) for impulse in player.impulses])
    np.testing.assert_allclose(
        measured.end_to_end, (3 * PERIOD + 5 - offsets) / LIVE_SAMPLE_RATE
    )
    np.testing.assert_allclose(
        np.sum(list(measured.stages.values()), axis=0), measured.end_to_end, atol=1e-9
    )
    assert measured.disagreement < 1e-9
    np.testing.assert_allclose(measured.stages["network"], 0.0001, atol=1e-9)
    np.testing.assert_allclose(measured.stages["playout"], 0.0001, atol=1e-9)


def test_impulses_without_vibration_are_missed(player: ImpulsePlayer) -> None:
    player.vibration[player.impulses[4] :][: LIVE_SAMPLE_RATE // 5] = 0.0
    measured = analyse(player, _marks(player), period=PERIOD)
    assert measured.missed_at == (player.impulses[4] / LIVE_SAMPLE_RATE,)
    assert f"1 missed (at {measured.missed_at[0]:.2f} s)" in measured.incidents


def test_an_impulse_that_comes_before_rest_is_not_judged_and_not_missed(
    player: ImpulsePlayer,
) -> None:
    player.vibration[player.impulses[4] - 200 :][:100] = 1.5e-4
    measured = analyse(player, _marks(player), period=PERIOD)
    assert (measured.missed, len(measured.end_to_end)) == (0, 9)
    assert measured.late_to_rest_at == (player.impulses[4] / LIVE_SAMPLE_RATE,)


@pytest.mark.parametrize("fingers", [1, 3])
def test_the_check_of_the_microphones_finds_nothing_in_what_is_played(
    fingers: int,
) -> None:
    player = ImpulsePlayer(6, background=True)
    outputs = [np.zeros(480, np.float32) for _ in range(2 * fingers)]
    detectors = [FaultDetector(LIVE_SAMPLE_RATE) for _ in range(fingers)]
    nothing = [np.zeros(480, np.float32)]
    while not player.done:
        start = player.position
        player.process(nothing, outputs)
        for finger, detector in enumerate(detectors):
            own = np.stack(outputs[2 * finger : 2 * finger + 2], axis=1)
            detector.push(AudioBlock(own, LIVE_SAMPLE_RATE, start))
            assert detector.faults == ()


@pytest.mark.parametrize("sound", ["air", "strokes"])
def test_the_check_finds_nothing_in_the_sound_of_ports(sound: PortSound) -> None:
    player = PortPlayer(sound, 4)
    outputs = [np.zeros(480, np.float32) for _ in range(4)]
    detector = FaultDetector(LIVE_SAMPLE_RATE)
    for period in range(1_000):
        player.process([], outputs)
        own = np.stack(outputs[2:], axis=1)
        detector.push(AudioBlock(own, LIVE_SAMPLE_RATE, 480 * period))
        assert detector.faults == ()
    assert not np.array_equal(outputs[0], outputs[2])


def test_every_phase_of_the_period_occurs() -> None:
    assert len({int(impulse) % PERIOD for impulse in ImpulsePlayer(300).impulses}) > 100
