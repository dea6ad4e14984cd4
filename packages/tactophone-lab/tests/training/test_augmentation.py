from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.recordings.values import Dataset, Recording
from tactophone_lab.training.augmentation import Augmentation
from tactophone_lab.training.recipe_options import FeatureSpec
from tactophone_lab.training.sets import build_training_set
from tactophone_lab.training.tracks import extract_features
from tests.surfaces import surfaces

RATE = 16_000

SOUND = np.random.default_rng(0).normal(0, 0.1, (2 * RATE, 2)).astype(np.float32)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return surfaces(tmp_path_factory.mktemp("scrapes"), each=1)


def powers(sound: np.ndarray) -> np.ndarray:
    return np.square(np.abs(np.fft.rfft(sound, axis=0)))


def test_every_copy_is_another_and_the_same_again() -> None:
    vary = Augmentation().vary
    first, second, again = (
        vary(SOUND, RATE, np.random.default_rng(seed)) for seed in (1, 2, 1)
    )
    assert first.shape == SOUND.shape
    assert np.isfinite(first).all()
    assert np.array_equal(first, again)
    assert not np.array_equal(first, second)


def test_a_low_pass_takes_the_treble_and_noise_fills_it() -> None:
    plain = Augmentation(gain_db=0, equaliser_db=0, share=0)
    assert plain.vary(SOUND, RATE, np.random.default_rng(0)) == pytest.approx(
        SOUND, abs=1e-6
    )
    dull = Augmentation(
        gain_db=0, equaliser_db=0, share=1, low_pass_hz=(3000, 3001), snr_db=(60, 61)
    )
    treble = powers(dull.vary(SOUND, RATE, np.random.default_rng(0)))[
        12_000:14_000, 0
    ].mean()
    assert treble < 0.01 * powers(SOUND)[12_000:14_000, 0].mean()
    noisy = Augmentation(
        gain_db=0, equaliser_db=0, share=1, low_pass_hz=(3000, 3001), snr_db=(0, 0.1)
    )
    assert (
        powers(noisy.vary(SOUND, RATE, np.random.default_rng(0)))[
            12_000:14_000, 0
        ].mean()
        > 10 * treble
    )


def test_only_the_air_microphone_hears_a_room() -> None:
    click = np.zeros_like(SOUND)
    click[1000] = 1
    room = Augmentation(
        gain_db=0, equaliser_db=0, share=1, low_pass_hz=(7900, 7901), snr_db=(200, 201)
    )
    found = np.square(room.vary(click, RATE, np.random.default_rng(3)))
    after = found[1100:].sum(axis=0) / found.sum(axis=0)
    assert after[0] < 1e-3
    assert after[1] > 0.03


def test_a_silent_channel_stays_silent() -> None:
    sound = SOUND * [1, 0]
    assert all(
        np.abs(
            Augmentation().vary(sound, RATE, np.random.default_rng(seed))[:, 1]
        ).max()
        < 1e-9
        for seed in range(8)
    )


def test_each_take_is_used_in_copies_at_other_speeds(dataset: Dataset) -> None:
    spec = FeatureSpec()
    plain = build_training_set(spec, dataset.recordings)
    varied = build_training_set(
        spec, dataset.recordings, augmentation=Augmentation(copies=3)
    )
    again = build_training_set(
        spec, dataset.recordings, augmentation=Augmentation(copies=3)
    )
    assert np.array_equal(
        varied.examples.features, again.examples.features, equal_nan=True
    )
    # At 0.6 to 1.6 times the speed a take lasts 1.7 to 0.6 times as long.
    assert (
        1 + 3 * 0.5
        < len(varied.examples.rough) / len(plain.examples.rough)
        < 1 + 3 * 1.8
    )
    # The gate is for the microphone as it is.
    assert varied.threshold_dbfs == plain.threshold_dbfs


def test_a_take_of_2200_hz_is_played_no_slower_than_it_can_be_resampled(
    tmp_path: Path,
) -> None:
    path = tmp_path / "finger.wav"
    sound = np.random.default_rng(0).normal(0, 0.1, 2 * 2200)
    soundfile.write(path, sound, 2200)
    take = Recording(path, "slate", None, ("contact",))
    spec = FeatureSpec(channels=1, augmentation=Augmentation(speed=(0.6, 0.61)))
    (track,) = extract_features([take], replace(spec, copy=(0, 1)))
    # At 0.91 times the speed, which is 2000 Hz, 2 s last for 2.2 s.
    assert track.end[-1] == pytest.approx(2.2, abs=0.05)
