import numpy as np
import pytest
import torch

from tactophone.core.texture_bands import BAND_COUNT, design_bands
from tactophone_lab.training.features import Texture
from tactophone_lab.training.recipe_options import BAND_VALUES
from tests.sounds import tone

RATE, SIZE = 16_000, 512


def described(windows: np.ndarray, *, unevenness: bool = False) -> np.ndarray:
    sound = torch.from_numpy(windows.swapaxes(1, 2)).float()
    return Texture(SIZE, RATE, unevenness=unevenness)(sound).numpy()


def describe(window: np.ndarray) -> np.ndarray:
    return described(window[None, :SIZE])[0]


def test_a_tone_stands_in_its_own_band() -> None:
    middle = [
        int(describe(tone(f, sample_rate=RATE))[0, :BAND_COUNT].argmax())
        for f in (100, 1000, 3000, 7000)
    ]
    assert middle == sorted(set(middle))
    assert middle[0] == 0
    assert middle[-1] == BAND_COUNT - 1


def test_a_tone_twice_as_loud_is_6_db_up_in_band_and_level_and_of_the_same_shape() -> (
    None
):
    quiet, loud = (
        describe(tone(1000, amplitude=a, sample_rate=RATE))[0] for a in (0.2, 0.4)
    )
    peak = quiet[:BAND_COUNT].argmax()
    assert loud[[peak, BAND_COUNT]] - quiet[[peak, BAND_COUNT]] == pytest.approx(
        np.log10(4), abs=1e-3
    )
    assert loud[BAND_COUNT + 1 :] == pytest.approx(quiet[BAND_COUNT + 1 :], abs=1e-5)


def test_shapes_of_a_sine_and_of_an_impact() -> None:
    sine = describe(tone(1000, sample_rate=RATE))[0, BAND_COUNT:]
    assert sine[1] == pytest.approx(np.log10(np.sqrt(2)), abs=0.01)
    # The slope of a sine is a sine: its fourth moment over the squared second is 3/2.
    assert sine[2] == pytest.approx(np.log10(1.5), abs=0.01)
    impact = np.zeros((SIZE, 1), np.float32)
    impact[SIZE - 100] = 0.5
    assert describe(impact)[0, BAND_COUNT + 2] > sine[2] + 1


def test_a_batch_is_described_window_by_window() -> None:
    windows = np.random.default_rng(0).standard_normal((3, SIZE, 2)).astype(np.float32)
    single = np.stack([describe(window) for window in windows])
    assert described(windows) == pytest.approx(single, abs=1e-5)


def test_every_band_has_a_bin_whatever_the_window() -> None:
    for size in (64, 256, 512, 4096):
        assert design_bands(size, RATE).sum(axis=0) == pytest.approx(
            np.ones(BAND_COUNT)
        )


def unevenness(window: np.ndarray) -> float:
    (values,) = described(window[None], unevenness=True)
    assert values.shape == (1, BAND_VALUES + 1)
    assert values[:, :BAND_VALUES] == pytest.approx(describe(window))
    return float(values[0, -1])


def test_treble_is_more_uneven_the_fewer_strikes_there_are_at_any_gain() -> None:
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((SIZE, 1))
    strikes = np.zeros((SIZE, 1))
    strikes[[100, 300, 420]] = 1
    lone = np.zeros((SIZE, 1))
    lone[300] = 1
    # The envelope of noise, 16 samples of three quarters of the band a step: 1 / sqrt(2
    # * 12) of its mean.
    assert unevenness(0.1 * noise) == pytest.approx(np.log10(1 / np.sqrt(24)), abs=0.1)
    assert unevenness(noise) < unevenness(strikes) - 0.5 < unevenness(lone) - 0.5
    assert unevenness(0.01 * strikes) == pytest.approx(unevenness(strikes), abs=1e-3)


def test_rumble_does_not_change_the_unevenness_of_treble_and_silence_has_one() -> None:
    noise = 0.01 * np.random.default_rng(1).standard_normal((SIZE, 1))
    assert unevenness(
        noise + tone(300, amplitude=0.5, sample_rate=RATE)[:SIZE, :1]
    ) == pytest.approx(unevenness(noise), abs=0.02)
    assert unevenness(np.zeros((SIZE, 1))) == pytest.approx(-3)
