from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.app.hum import Hum
from tactophone.app.prepare import Preparation, PreparedSource
from tactophone.live.audio.files import FileSource
from tests.sounds import noise


def written(path: Path, samples: np.ndarray) -> Path:
    soundfile.write(path, samples, 48_000, subtype="FLOAT")
    return path


def prepared(path: Path) -> tuple[Preparation, np.ndarray]:
    preparation = Preparation.of(FileSource(path))
    with PreparedSource(FileSource(path), preparation) as source:
        return preparation, np.concatenate([block.samples for block in source])


@pytest.mark.parametrize("live", [0, 1])
def test_a_silent_channel_is_left_out(live: int, tmp_path: Path) -> None:
    samples = np.zeros((9000, 2), np.float32)
    samples[:, live] = noise(level_dbfs=-30, duration=9000 / 48_000, channels=1)[:, 0]
    preparation, found = prepared(written(tmp_path / "a.wav", samples))
    assert found.shape == (9000, 1)
    assert (found[:, 0] == samples[:, live]).all()
    assert preparation.notes(2) == [
        f"channel {2 - live} of 2 has no microphone: taken as a recording of one "
        "channel"
    ]


def test_an_offset_is_removed_of_each_channel_by_itself(tmp_path: Path) -> None:
    samples = noise(level_dbfs=-30, duration=0.5, channels=2)
    samples -= samples.mean(axis=0)
    preparation, found = prepared(
        written(tmp_path / "a.wav", samples + np.array([0.1, -0.05], np.float32))
    )
    np.testing.assert_allclose(found, samples, atol=1e-6)
    assert "+0.100" in preparation.notes(2)[0]


def test_sound_as_it_should_be_is_left_bit_equal(tmp_path: Path) -> None:
    samples = noise(level_dbfs=-30, duration=0.5, channels=2)
    preparation, found = prepared(written(tmp_path / "a.wav", samples))
    assert (found == samples).all()
    assert not preparation.notes(2)


def test_digital_silence_keeps_its_channels(tmp_path: Path) -> None:
    preparation, found = prepared(
        written(tmp_path / "a.wav", np.zeros((900, 2), np.float32))
    )
    assert found.shape == (900, 2)
    assert preparation.amplified(-200.0).gain_db == 0


@pytest.mark.parametrize(
    ("loudest_dbfs", "gain_db"), [(-49.0, 0.0), (-70.0, 35.0), (-100.0, 0.0)]
)
def test_quiet_sound_is_amplified_and_a_converters_noise_is_not(
    loudest_dbfs: float, gain_db: float
) -> None:
    assert Preparation((0,), (0.0,)).amplified(loudest_dbfs).gain_db == gain_db


def test_the_places_of_invalid_samples_are_passed_on_through_every_change(
    tmp_path: Path,
) -> None:
    samples = noise(level_dbfs=-70, duration=0.5, channels=2)
    samples[:, 1] = 0
    samples[7, 0] = np.nan
    path = written(tmp_path / "a.wav", samples + np.array([0.1, 0], np.float32))
    preparation = replace(Preparation.of(FileSource(path)), gain_db=6.0)
    with PreparedSource(FileSource(path), preparation) as source:
        block = next(iter(source))
    assert preparation.invalid == 1
    assert block.invalid is not None
    assert block.invalid.shape == block.samples.shape == (block.size, 1)
    assert np.flatnonzero(block.invalid).tolist() == [7]


def test_mains_hum_is_subtracted_before_a_channel_is_left_out(tmp_path: Path) -> None:
    samples = np.zeros((4 * 48_000, 2), np.float32)
    samples[:, 1] = noise(level_dbfs=-40, duration=4, channels=1)[:, 0]
    hum = 0.1 * np.sin(2 * np.pi * 50 * np.arange(len(samples)) / 48_000)
    preparation, found = prepared(
        written(tmp_path / "a.wav", samples + np.array([0, 1]) * hum[:, None])
    )
    assert found.shape == (len(samples), 1)
    np.testing.assert_allclose(found[:, 0], samples[:, 1], atol=2e-3)
    assert (
        preparation.notes(2)[-1]
        == "hum of 50 Hz mains at -23 dBFS was removed: see the cables"
    )


@pytest.mark.parametrize(
    ("tip", "level_dbfs", "subtracted"),
    [
        ("pad", -40.0, False),
        ("", -40.0, False),
        ("pad", -25.0, True),
        ("stylus", -40.0, True),
    ],
)
def test_hum_that_a_model_was_trained_with_is_left(
    tip: str, level_dbfs: float, subtracted: bool
) -> None:
    amplitude = np.full((1, 1, 4), 10 ** (level_dbfs / 20) * np.sqrt(2), np.complex64)
    hum = Hum(48_000, np.full((1, 1), 50.0), amplitude)
    assert (Preparation((0,), (0.0,), hum=hum).for_tip(tip).hum is hum) == subtracted


def test_an_infinite_sample_leaves_the_others_as_they_are(tmp_path: Path) -> None:
    samples = noise(level_dbfs=-30, duration=3, channels=2)
    samples[5] = np.inf
    preparation, found = prepared(written(tmp_path / "a.wav", samples))
    samples[5] = 0
    assert (found == samples).all()
    (note,) = preparation.notes(2)
    assert note.startswith("1 x no sound")
