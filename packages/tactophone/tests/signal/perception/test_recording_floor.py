import tracemalloc
from collections.abc import Iterable, Iterator

import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone.signal.perception import noise_floor
from tactophone.signal.perception.noise_floor import (
    LOWEST_DBFS,
    NoiseFloor,
    RecordingFloor,
    measure_floor,
)
from tests.sounds import ODD_SIZES, blocks, noise, tone

RATE = 48_000


def floor_of(samples: np.ndarray, size: int = 4800) -> RecordingFloor:
    return floor_of_parts([samples], size)


def floor_of_parts(parts: Iterable[np.ndarray], size: int = 4800) -> RecordingFloor:
    sound = (block for part in parts for block in blocks(part, size))
    return measure_floor(sound, sample_rate=RATE, rule="banded")


def touched(gain_db: float = 0.0, seed: int = 0) -> np.ndarray:
    samples = noise(level_dbfs=-50, duration=4.0, channels=1, seed=seed)
    swell = 0.1 * np.abs(np.sin(2 * np.pi * 1.2 * np.arange(2 * RATE) / RATE))[
        :, None
    ].astype(np.float32)
    samples[RATE : 3 * RATE] += swell * noise(
        level_dbfs=0, duration=2.0, channels=1, seed=3
    )
    return (samples * 10 ** (gain_db / 20)).astype(np.float32)


@pytest.mark.parametrize("gain_db", [-30.0, 0.0, 10.0])
def test_the_threshold_lies_just_over_the_noise_at_any_gain(gain_db: float) -> None:
    floor = floor_of(touched(gain_db))
    assert floor.known
    assert floor.floor_dbfs + 1 < floor.threshold_dbfs < floor.floor_dbfs + 3
    assert floor.floor_dbfs == pytest.approx(
        floor_of(touched()).floor_dbfs + gain_db, abs=0.01
    )
    assert floor.loudest_dbfs >= floor.threshold_dbfs


def test_a_recording_that_is_all_touch_has_no_floor_and_all_of_it_is_contact() -> None:
    floor = floor_of(touched()[RATE + 4800 : 3 * RATE - 4800])
    assert not floor.known
    assert floor.threshold_dbfs == LOWEST_DBFS


def test_a_recording_that_begins_anew_begins_at_its_own_floor_again() -> None:
    recording = floor_of(touched())
    live = NoiseFloor(-38.0)
    live.begin(recording)
    begun = live.threshold_dbfs
    live.reset()
    assert (live.known, live.threshold_dbfs) == (True, begun)


def test_steady_noise_alone_is_no_touch() -> None:
    floor = floor_of(noise(level_dbfs=-40, duration=3.0, channels=1))
    assert floor.known
    assert floor.loudest_dbfs < floor.threshold_dbfs


def test_digital_silence_is_no_floor() -> None:
    assert not floor_of(np.zeros((RATE, 1), np.float32)).known


def test_hum_and_offset_are_no_noise() -> None:
    plain, hum = touched(), touched() + 0.02 + tone(50, amplitude=0.01, duration=4)
    assert floor_of(hum.astype(np.float32)).floor_dbfs == pytest.approx(
        floor_of(plain).floor_dbfs, abs=1.0
    )


@pytest.mark.slow
@pytest.mark.parametrize("size", ODD_SIZES)
def test_blocks_of_any_size_give_the_same_floor(size: int) -> None:
    assert floor_of(touched()[: 2 * RATE], size) == floor_of(
        touched()[: 2 * RATE], 2 * RATE
    )


def test_a_recording_shorter_than_a_cell_has_no_floor() -> None:
    assert not measure_floor(
        [AudioBlock(np.zeros((10, 1), np.float32), RATE)], sample_rate=RATE, rule="rms"
    ).known


def test_a_stroke_that_is_steady_for_a_moment_is_no_floor() -> None:
    steady = noise(level_dbfs=-24, duration=0.6, channels=1)
    swell = (
        0.02
        + 0.08 * np.abs(np.sin(2 * np.pi * 2.5 * np.arange(3 * RATE) / RATE))[:, None]
    )
    stroke = (swell * noise(level_dbfs=0, duration=3.0, channels=1, seed=3)).astype(
        np.float32
    )
    assert not floor_of(np.concatenate([stroke, steady, stroke])).known


def turned_down(first: np.ndarray) -> np.ndarray:
    """Return ``first`` and a swelling touch, after which automatic gain has turned the
    noise down by 25 dB and up again by 6 dB a second."""
    swell = np.abs(np.sin(2 * np.pi * 2.5 * np.arange(RATE) / RATE))[:, None]
    touch = swell * tone(1000, amplitude=0.05)
    rising = noise(level_dbfs=-65, duration=2.0, channels=1, seed=4)
    rising *= 10 ** (6 * np.arange(2 * RATE) / RATE / 20)[:, None].astype(np.float32)
    return np.concatenate([first, touch, rising]).astype(np.float32)


def test_noise_that_automatic_gain_turns_down_begins_at_its_first_level() -> None:
    first = noise(level_dbfs=-40, channels=1)
    expected = floor_of(np.concatenate([first, first])).floor_dbfs
    floor = floor_of(turned_down(first))
    assert floor.gain_changes
    assert floor.floor_dbfs == pytest.approx(expected, abs=1.0)
    assert floor.bands_dbfs == pytest.approx(floor_of(first).bands_dbfs, abs=3.0)


def test_a_steady_touch_that_is_no_louder_noise_is_no_floor() -> None:
    changes = np.diff(noise(level_dbfs=-40, channels=1), axis=0, append=0)
    quiet = noise(level_dbfs=-70, duration=2.0, channels=1, seed=4)
    expected = floor_of(quiet).floor_dbfs
    found = floor_of(np.concatenate([changes, quiet]).astype(np.float32))
    assert not found.gain_changes
    assert found.floor_dbfs == pytest.approx(expected, abs=0.5)


def test_a_fade_at_the_end_leaves_the_floor_known() -> None:
    samples = touched()
    samples[-4800:] *= np.linspace(1, 0, 4800, dtype=np.float32)[:, None]
    assert floor_of(samples).known


def test_the_floor_of_a_long_recording_takes_no_more_memory_and_stays_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole = floor_of_parts(strokes(60))
    monkeypatch.setattr(noise_floor, "MOST_LEVELS", 2_000)
    monkeypatch.setattr(noise_floor, "MOST_CELLS", 400)
    thinned = floor_of_parts(strokes(60))
    assert thinned.known
    assert thinned.threshold_dbfs == pytest.approx(whole.threshold_dbfs, abs=0.05)
    assert thinned.loudest_dbfs == whole.loudest_dbfs
    assert peak_of_floor(60) < 1.1 * peak_of_floor(30)


def strokes(count: int) -> Iterator[np.ndarray]:
    """Yield strokes of 2 s with silence around them, 4 s each, at other noise."""
    for seed in range(count):
        yield touched(seed=seed)


def peak_of_floor(count: int) -> int:
    """Return the most bytes that a floor of ``count`` strokes took at once."""
    tracemalloc.start()
    floor_of_parts(strokes(count))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak
