import numpy as np
import pytest

from tactophone.app.vibration_wav import CAPACITY, PeakEnvelope
from tests.sounds import ODD_SIZES, noise


def columns(samples: np.ndarray, size: int) -> list[np.ndarray]:
    envelope = PeakEnvelope(samples.shape[1], sample_rate=48_000)
    for start in range(0, len(samples), size):
        envelope.push(samples[start : start + size])
    return list(envelope.columns())


@pytest.mark.parametrize("size", [*ODD_SIZES[1:], 1_000_000])
def test_any_block_size_gives_the_same_columns(size: int) -> None:
    samples = noise(duration=3)
    for actual, expected in zip(
        columns(samples, size), columns(samples, 4096), strict=True
    ):
        np.testing.assert_array_equal(actual, expected)


def test_a_click_stays_in_its_place_however_long_the_sound() -> None:
    samples = np.zeros((480_000, 1), np.float32)
    samples[240_000] = 0.9
    time, low, high = columns(samples, 4096)
    assert len(time) <= CAPACITY
    assert not low.any()
    step = time[1]
    assert time[np.argmax(high[:, 0])] == pytest.approx(5.0, abs=step)


def test_an_empty_envelope_has_no_columns() -> None:
    time, low, high = PeakEnvelope(2, sample_rate=48_000).columns()
    assert (len(time), low.shape, high.shape) == (0, (0, 2), (0, 2))
