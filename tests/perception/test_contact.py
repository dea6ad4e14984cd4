import numpy as np
import pytest

from tactophone.perception.contact import HOLD, Contact, ContactGate
from tactophone.perception.loudness import LoudnessRule
from tactophone.types import AudioBlock
from tests.sounds import UGLY_SIZES, blocks, noise


def watch(samples: np.ndarray, size: int = 480) -> list[Contact]:
    gate = ContactGate(-40, sample_rate=48_000)
    return [change for block in blocks(samples, size) for change in gate.push(block)]


def stroke(start: float, end: float) -> np.ndarray:
    samples = noise(level_dbfs=-80, duration=1.0, channels=1)
    samples[round(start * 48_000) : round(end * 48_000)] += noise(duration=end - start, channels=1)
    return samples


@pytest.mark.parametrize(("level_dbfs", "touching"), [(-38.5, True), (-41.5, False)])
@pytest.mark.parametrize("rule", ["rms", "mean_absolute"])
def test_the_level_is_of_the_rule_at_hand(rule: LoudnessRule, level_dbfs: float, touching: bool) -> None:
    gate = ContactGate(-40, sample_rate=48_000, rule=rule)
    # A square wave is as loud by either rule; both say 2 dB less or more of other sound.
    square = np.full((4800, 1), 10 ** (level_dbfs / 20), np.float32)
    assert gate.push(AudioBlock(square, 48_000))[-1].touching == touching


@pytest.mark.parametrize("size", UGLY_SIZES)
def test_any_block_size_gives_the_same_changes(size: int) -> None:
    samples = stroke(0.3, 0.6)
    assert watch(samples, size) == watch(samples, len(samples))


def test_a_touch_is_known_in_two_milliseconds_and_its_end_after_the_hold() -> None:
    touching = [change.time for change in watch(stroke(0.3, 0.6)) if change.touching]
    assert 0.3 < touching[0] <= 0.302
    assert touching[-1] <= 0.6 + HOLD + 0.005


def test_a_turning_stroke_is_one_touch() -> None:
    samples = stroke(0.3, 0.6)
    samples[round(0.45 * 48_000) : round(0.47 * 48_000)] = 0
    assert all(change.touching for change in watch(samples) if 0.31 < change.time < 0.6)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_garbage_closes_the_gate_at_once(value: float) -> None:
    samples = stroke(0.3, 0.6)
    samples[round(0.4 * 48_000) :] = value
    assert not any(change.touching for change in watch(samples) if change.time > 0.401)


def test_a_sign_of_life_comes_every_ten_milliseconds() -> None:
    times = [change.time for change in watch(np.zeros((48_000, 1), np.float32))]
    assert np.diff(times) == pytest.approx(0.01)
