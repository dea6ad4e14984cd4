import numpy as np
import pytest

from simulated_operator import (
    FULL_DRIVE_DB,
    Percepts,
    add_internal_noise,
    perceive,
    threshold_db,
)

RATE = 48_000


def sine(frequency: float, level_dbfs: float = 0.0) -> np.ndarray:
    time = np.arange(RATE) / RATE
    return (10 ** (level_dbfs / 20) * np.sin(2 * np.pi * frequency * time)).astype(
        np.float32
    )


@pytest.mark.parametrize("frequency", [60.0, 120.0, 250.0])
def test_a_sine_is_perceived_at_its_level_and_pitch(frequency: float) -> None:
    percepts = perceive(sine(frequency, -25), RATE)
    assert percepts.level_db[5] == pytest.approx(
        FULL_DRIVE_DB - 25 - float(threshold_db(frequency)), abs=2.5
    )
    assert np.exp(percepts.pitch[5]) == pytest.approx(frequency, rel=0.03)


def test_silence_is_not_perceived() -> None:
    percepts = perceive(np.zeros(RATE, np.float32), RATE)
    assert not percepts.level_db.any()
    assert not percepts.pitch.any()


def test_a_just_noticeable_difference_is_recognised_three_times_in_four() -> None:
    rng = np.random.default_rng(1)
    low = Percepts(np.full(10, 30.0), np.full(10, np.log(100.0)))
    high = Percepts(np.full(10, 30.0), np.full(10, np.log(118.0)))
    recognised = [
        add_internal_noise(high, rng).pitch.mean()
        > add_internal_noise(low, rng).pitch.mean()
        for _ in range(2000)
    ]
    # A little less than three in four: remembering adds noise to the noise of the
    # glance.
    assert np.mean(recognised) == pytest.approx(0.68, abs=0.04)


def test_silence_gets_no_internal_noise() -> None:
    nothing = Percepts(np.zeros(20), np.zeros(20))
    assert not add_internal_noise(nothing, np.random.default_rng(0)).level_db.any()
