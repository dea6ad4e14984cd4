import numpy as np
import pytest

from tactophone.simulation.participants.fingertip_model import (
    FULL_DRIVE_DB,
    Percepts,
    blur,
    feel_waveform,
    threshold_db,
)

RATE = 48_000


def sine(frequency: float, level_dbfs: float = 0.0) -> np.ndarray:
    time = np.arange(RATE) / RATE
    return (10 ** (level_dbfs / 20) * np.sin(2 * np.pi * frequency * time)).astype(np.float32)


@pytest.mark.parametrize("frequency", [60.0, 120.0, 250.0])
def test_a_sine_is_felt_at_its_level_and_pitch(frequency: float) -> None:
    felt = feel_waveform(sine(frequency, -25), RATE)
    assert felt.level_db[5] == pytest.approx(FULL_DRIVE_DB - 25 - float(threshold_db(frequency)), abs=2.5)
    assert np.exp(felt.pitch[5]) == pytest.approx(frequency, rel=0.03)


def test_silence_is_not_felt() -> None:
    felt = feel_waveform(np.zeros(RATE, np.float32), RATE)
    assert not felt.level_db.any()
    assert not felt.pitch.any()


def test_what_is_just_noticeable_is_told_three_times_in_four() -> None:
    rng = np.random.default_rng(1)
    low = Percepts(np.full(10, 30.0), np.full(10, np.log(100.0)))
    high = Percepts(np.full(10, 30.0), np.full(10, np.log(118.0)))
    told = [blur(high, rng).pitch.mean() > blur(low, rng).pitch.mean() for _ in range(2000)]
    # Told a little worse than three in four: the memory's noise comes on top of the glance's.
    assert np.mean(told) == pytest.approx(0.68, abs=0.04)


def test_what_is_not_felt_is_not_blurred() -> None:
    nothing = Percepts(np.zeros(20), np.zeros(20))
    assert not blur(nothing, np.random.default_rng(0)).level_db.any()
