from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.microphones import AIR, CONTACT
from tactophone_lab.app.simulate import plan_recordings
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.render import RenderOptions, plan_dataset, render
from tactophone_lab.simulation.room_sound import RoomSound
from tactophone_lab.simulation.takes import TAKES

RATE = 44_100


def voice(folder: Path) -> Path:
    """A second of a tone, then one of silence."""
    path = folder / "voice.wav"
    tone = 0.01 * np.sin(2 * np.pi * 440 * np.arange(RATE) / RATE)
    soundfile.write(path, np.append(tone, np.zeros(RATE)), RATE)
    return path


def test_the_contact_microphone_hears_it_fainter(tmp_path: Path) -> None:
    sound = RoomSound(voice(tmp_path), level_dbfs=-20, isolation_db=26)
    pair = sound.heard(3 * 48_000, np.random.default_rng(0))
    np.testing.assert_allclose(
        pair[:, CONTACT], pair[:, AIR] * 10 ** (-26 / 20), rtol=1e-5
    )
    second = np.lib.stride_tricks.sliding_window_view(pair[:, AIR], 48_000)[::480]
    loudest = np.square(second, dtype=np.float64).mean(axis=1).max()
    assert 10 * np.log10(loudest) == pytest.approx(-20, abs=0.2)


def test_takes_hear_other_parts_of_it_and_one_seed_the_same(tmp_path: Path) -> None:
    sound = RoomSound(voice(tmp_path))
    first, again, other = (
        sound.heard(48_000, np.random.default_rng(seed)) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_take_with_it_is_the_take_and_the_sound(tmp_path: Path) -> None:
    sound = RoomSound(voice(tmp_path), level_dbfs=-40)
    options = RenderOptions(duration=0.5)
    (job,) = plan_dataset([find("lava stone")], options, takes=TAKES[:1])
    beside = replace(job, options=replace(options, room_sound=sound))
    difference = render(beside)[0] - render(job)[0]
    heard = difference.std(axis=0)
    assert heard[CONTACT] == pytest.approx(0.1 * heard[AIR], rel=0.01)
    assert job.fingerprint != beside.fingerprint
    assert repr(job) == repr(beside), "what the shipped models' sets are hashed by"


def test_what_is_no_sound_is_said_before_anything_is_rendered(tmp_path: Path) -> None:
    silent = tmp_path / "silent.wav"
    soundfile.write(silent, np.zeros(100), RATE)
    for path, error in (
        (silent, ConfigError),
        (tmp_path / "absent.wav", DatasetError),
    ):
        options = RenderOptions(room_sound=RoomSound(path))
        with pytest.raises(error, match=path.name):
            plan_recordings([find("lava stone")], TAKES[:1], options)
