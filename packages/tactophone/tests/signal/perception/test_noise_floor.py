import numpy as np
import pytest

from tactophone.signal.perception.noise_floor import (
    HIGHEST_DBFS,
    LOWEST_DBFS,
    RISE_TOUCHED,
    NoiseFloor,
    margin_db,
)

SPREAD_DB = 0.4
NO_BANDS = np.zeros(0, np.float32)


def noise(
    level_dbfs: float, seconds: float, *, slope: float = 0.0, seed: int = 0
) -> np.ndarray:
    count = round(200 * seconds)
    return (
        level_dbfs
        + slope * np.arange(count) / 200
        + np.random.default_rng(seed).normal(0, SPREAD_DB, count)
    )


def stroke(level_dbfs: float, seconds: float) -> np.ndarray:
    time = np.arange(round(200 * seconds)) / 200
    return (
        level_dbfs
        + 6 * np.sin(2 * np.pi * 1.3 * time)
        + np.random.default_rng(1).normal(0, 2, len(time))
    )


def follow(floor: NoiseFloor, levels: np.ndarray) -> np.ndarray:
    contact = np.zeros(len(levels), bool)
    for at, level in enumerate(levels.tolist()):
        contact[at] = level >= floor.threshold_dbfs
        floor.push(level, NO_BANDS, touching=bool(contact[at]), loud=bool(contact[at]))
    return contact


@pytest.mark.parametrize("level_dbfs", [-75.0, -55.0, -38.0, -25.0])
def test_silence_is_silence_and_a_stroke_10_db_over_it_is_a_touch_at_any_gain(
    level_dbfs: float,
) -> None:
    floor = NoiseFloor(-38.0)
    follow(floor, noise(level_dbfs, 2))
    assert level_dbfs < floor.threshold_dbfs < level_dbfs + 3
    assert follow(floor, noise(level_dbfs, 60, seed=2)).mean() < 0.02
    assert follow(floor, stroke(level_dbfs + 14, 5)).mean() > 0.9


def test_noise_that_creeps_up_is_followed_and_does_not_deafen() -> None:
    floor = NoiseFloor(-38.0)
    contact = follow(floor, noise(-60, 60, slope=0.3))
    assert contact[200:].mean() < 0.05
    assert follow(floor, stroke(-42 + 14, 5)).mean() > 0.9


def test_noise_that_creeps_down_does_not_buzz_when_it_returns() -> None:
    floor = NoiseFloor(-38.0)
    follow(floor, noise(-45, 5))
    assert not follow(floor, noise(-45, 20, slope=-1.0)).any()
    assert follow(floor, noise(-45, 10)).mean() < 0.2


def test_faint_strokes_under_the_threshold_do_not_creep_the_floor_up() -> None:
    floor = NoiseFloor(-38.0)
    follow(floor, noise(-60, 3))
    before = floor.threshold_dbfs
    for level in stroke(-60, 30).tolist():
        floor.push(level, NO_BANDS, touching=False, loud=False)
    assert floor.threshold_dbfs < before + 4


def test_a_touch_hardly_moves_the_floor_and_a_stroke_is_never_noise() -> None:
    floor = NoiseFloor(-38.0)
    follow(floor, noise(-60, 3))
    before = floor.threshold_dbfs
    assert follow(floor, stroke(-35, 60)).mean() > 0.99
    assert floor.threshold_dbfs <= before + 60 * RISE_TOUCHED


def test_noise_that_jumps_up_and_stays_is_noise_after_ten_seconds() -> None:
    floor = NoiseFloor(-38.0)
    follow(floor, noise(-60, 3))
    assert follow(floor, noise(-45, 9)).all()
    assert follow(floor, noise(-45, 10))[600:].mean() < 0.02


def test_a_source_that_pauses_or_a_dead_microphone_leaves_the_floor_alone() -> None:
    floor = NoiseFloor(-38.0)
    follow(floor, noise(-60, 3))
    before = floor.threshold_dbfs
    follow(floor, np.full(1000, -200.0))
    follow(floor, np.full(200, np.nan))
    assert floor.threshold_dbfs == before
    assert follow(floor, noise(-60, 5, seed=3)).mean() < 0.02


def test_the_threshold_is_bounded() -> None:
    quiet, loud = NoiseFloor(-38.0), NoiseFloor(-38.0)
    follow(quiet, noise(-110, 10))
    follow(loud, noise(-5, 10))
    assert (quiet.threshold_dbfs, loud.threshold_dbfs) == (LOWEST_DBFS, HIGHEST_DBFS)


def test_the_margin_grows_with_the_spread_of_noise_and_rarity_of_false_alarms() -> None:
    assert margin_db(0.4, 0.01) < margin_db(0.4, 0.001) < margin_db(1.0, 0.001)


def test_adopting_gives_the_same_threshold_and_reset_equals_new() -> None:
    floor, other = NoiseFloor(-38.0), NoiseFloor(-38.0)
    follow(floor, noise(-60, 3))
    other.adopt(floor)
    assert (other.threshold_dbfs, other.known) == (floor.threshold_dbfs, True)
    other.reset()
    assert (other.threshold_dbfs, other.known) == (-38.0, False)
