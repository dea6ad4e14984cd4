import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone.signal.perception.health import (
    FAINTEST_DBFS,
    ChannelStatistics,
    SignalStatistics,
)

RATE = 48_000


def measure(samples: np.ndarray, rate: int = RATE) -> list[ChannelStatistics]:
    return SignalStatistics(rate).push(AudioBlock(samples.astype(np.float32), rate))


def noise(seconds: float = 1.0, level: float = 0.05) -> np.ndarray:
    return np.random.default_rng(0).normal(0, level, (int(seconds * RATE), 2))


def tone(
    frequency: float, amplitude: float, seconds: float = 1.0, rate: int = RATE
) -> np.ndarray:
    wave = amplitude * np.sin(
        2 * np.pi * frequency * np.arange(int(seconds * rate)) / rate
    )
    return np.stack([wave, wave], axis=1)


@pytest.mark.parametrize("size", [1, 17, 480, 509])
def test_blocks_of_any_size_give_equal_measures(size: int) -> None:
    sound = noise(0.8).astype(np.float32)
    stream, measured = SignalStatistics(RATE), []
    for start in range(0, len(sound), size):
        measured += stream.push(AudioBlock(sound[start : start + size], RATE, start))
    assert measured == measure(sound)


def test_reset_equals_new() -> None:
    stream = SignalStatistics(RATE)
    stream.push(AudioBlock(noise(0.7).astype(np.float32), RATE))
    stream.reset()
    assert stream.push(AudioBlock(noise().astype(np.float32), RATE)) == measure(noise())


@pytest.mark.parametrize("rate", [8_000, 16_000, 44_100, 48_000])
@pytest.mark.parametrize("mains", [50, 60])
def test_hum_is_measured_and_distinguished_at_any_rate(rate: int, mains: int) -> None:
    hum = measure(tone(mains, 0.1, rate=rate), rate)[-1]
    assert hum.mains == mains
    assert hum.hum_dbfs[0] == pytest.approx(-23.0, abs=0.3)


def test_noise_is_no_hum_and_says_how_much_it_hides() -> None:
    statistics = measure(noise())[-1]
    assert statistics.hum_dbfs[0] < statistics.masking_dbfs[0] + 3


def test_level_leaves_the_offset_out() -> None:
    statistics = measure(tone(200, 0.1) + 0.25)[-1]
    assert statistics.offset == pytest.approx((0.25, 0.25), abs=1e-3)
    assert statistics.level_dbfs[0] == pytest.approx(-23.0, abs=0.1)


def test_clipping_is_seen_at_full_scale_and_against_a_rail() -> None:
    for rail in (1.0, 0.5):
        assert measure((tone(200, 4 * rail)).clip(-rail, rail))[-1].clipped[0] > 0.5
    assert measure(tone(200, 0.9))[-1].clipped[0] < 0.01


def test_correlation_of_copies_is_one_and_of_independent_noise_none() -> None:
    independent = noise()
    assert abs(measure(independent)[-1].correlation) < 0.1
    independent[:, 1] = -0.1 * independent[:, 0]
    assert measure(independent)[-1].correlation == pytest.approx(-1.0, abs=1e-6)


def test_invalid_samples_have_finite_statistics() -> None:
    sound = noise()
    sound[::7] = np.nan
    sound[::11] = np.inf
    statistics = measure(sound)[-1]
    assert np.isfinite(
        [*statistics.level_dbfs, *statistics.hum_dbfs, statistics.correlation]
    ).all()


def test_silence_and_one_channel_have_measures_too() -> None:
    statistics = measure(np.zeros((RATE, 1)))[-1]
    assert statistics.level_dbfs == (pytest.approx(FAINTEST_DBFS),)
    assert statistics.correlation == 0.0


def test_the_treble_of_white_noise_is_3_db_over_its_level() -> None:
    """Two samples that know nothing of each other differ by twice the power of one."""
    found = measure(noise())[-1]
    over = np.subtract(found.treble_dbfs, found.level_dbfs)
    assert over == pytest.approx([3.0, 3.0], abs=0.3)
