import numpy as np
import pytest

from tactophone.perception.sensor_health.signal_statistics import LOWEST_DBFS, ChannelStatistics, SignalStatistics
from tactophone.types import AudioBlock

RATE = 48_000


def measure(samples: np.ndarray, rate: int = RATE) -> list[ChannelStatistics]:
    return SignalStatistics(rate).push(AudioBlock(samples.astype(np.float32), rate))


def noise(seconds: float = 1.0, level: float = 0.05) -> np.ndarray:
    return np.random.default_rng(0).normal(0, level, (int(seconds * RATE), 2))


def tone(frequency: float, amplitude: float, seconds: float = 1.0, rate: int = RATE) -> np.ndarray:
    wave = amplitude * np.sin(2 * np.pi * frequency * np.arange(int(seconds * rate)) / rate)
    return np.stack([wave, wave], axis=1)


@pytest.mark.parametrize("size", [1, 17, 480, 509])
def test_blocks_of_any_size_give_equal_measures(size: int) -> None:
    sound = noise(0.8).astype(np.float32)
    signs, measured = SignalStatistics(RATE), []
    for start in range(0, len(sound), size):
        measured += signs.push(AudioBlock(sound[start : start + size], RATE, start))
    assert measured == measure(sound)


def test_reset_equals_new() -> None:
    signs = SignalStatistics(RATE)
    signs.push(AudioBlock(noise(0.7).astype(np.float32), RATE))
    signs.reset()
    assert signs.push(AudioBlock(noise().astype(np.float32), RATE)) == measure(noise())


@pytest.mark.parametrize("rate", [8_000, 16_000, 44_100, 48_000])
@pytest.mark.parametrize("mains", [50, 60])
def test_hum_is_measured_and_told_apart_at_any_rate(rate: int, mains: int) -> None:
    hum = measure(tone(mains, 0.1, rate=rate), rate)[-1]
    assert hum.mains == mains
    assert hum.hum_dbfs[0] == pytest.approx(-23.0, abs=0.3)


def test_noise_is_no_hum_and_says_how_much_it_hides() -> None:
    vitals = measure(noise())[-1]
    assert vitals.hum_dbfs[0] < vitals.masking_dbfs[0] + 3


def test_level_leaves_the_offset_out() -> None:
    vitals = measure(tone(200, 0.1) + 0.25)[-1]
    assert vitals.offset == pytest.approx((0.25, 0.25), abs=1e-3)
    assert vitals.level_dbfs[0] == pytest.approx(-23.0, abs=0.1)


def test_clipping_is_seen_at_full_scale_and_against_a_rail() -> None:
    for rail in (1.0, 0.5):
        assert measure((tone(200, 4 * rail)).clip(-rail, rail))[-1].clipped[0] > 0.5
    assert measure(tone(200, 0.9))[-1].clipped[0] < 0.01


def test_likeness_of_copies_is_one_and_of_strangers_none() -> None:
    strangers = noise()
    assert abs(measure(strangers)[-1].likeness) < 0.1
    strangers[:, 1] = -0.1 * strangers[:, 0]
    assert measure(strangers)[-1].likeness == pytest.approx(-1.0, abs=1e-6)


def test_garbage_is_measured_as_numbers() -> None:
    sound = noise()
    sound[::7] = np.nan
    sound[::11] = np.inf
    vitals = measure(sound)[-1]
    assert np.isfinite([*vitals.level_dbfs, *vitals.hum_dbfs, vitals.likeness]).all()


def test_silence_and_one_channel_have_measures_too() -> None:
    vitals = measure(np.zeros((RATE, 1)))[-1]
    assert vitals.level_dbfs == (pytest.approx(LOWEST_DBFS),)
    assert vitals.likeness == 0.0
