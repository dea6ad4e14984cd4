"""Concealment of gaps in PCM."""

import numpy as np
import pytest

from tactophone.core.types import FloatArray
from tactophone.net.link.codec import conceal_gap, mirror


def noise(size: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).normal(0, 0.1, (size, 2)).astype(np.float32)


@pytest.mark.parametrize("size", [1, 2, 120, 480, 5_000])
def test_a_concealed_gap_keeps_the_level_of_noise_and_has_its_size(size: int) -> None:
    filled = conceal_gap(noise(240, 1), noise(240, 2), size)
    assert filled.shape == (size, 2)
    assert filled.dtype == np.float32
    if size > 100:
        assert filled.std() == pytest.approx(0.1, rel=0.15)


def test_a_concealed_gap_is_continuous_at_both_sides() -> None:
    before = np.linspace(0, 0.5, 240, dtype=np.float32)[:, np.newaxis]
    after = np.linspace(-0.3, 0.2, 240, dtype=np.float32)[:, np.newaxis]
    joined = np.concatenate([before, conceal_gap(before, after, 480), after])
    assert np.abs(np.diff(joined, axis=0)).max() < 0.01


def test_a_gap_without_sound_is_silent() -> None:
    nothing = np.zeros((0, 1), np.float32)
    assert not conceal_gap(nothing, nothing, 5).any()
    assert mirror(np.array([[1], [2]], np.float32), 5).ravel().tolist() == [
        1,
        2,
        2,
        1,
        1,
    ]
