from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import DatasetError
from tactophone.core.recordings.values import Recording
from tactophone.net.link.codec import Codec
from tactophone.signal.perception.resample import Resampler
from tactophone_lab.training.tracks import read_signals


def write(
    path: Path, *, rate: int = 48_000, seconds: float = 1.0, seed: int = 0
) -> Recording:
    time = np.arange(int(rate * seconds)) / rate
    noise = np.random.default_rng(seed).normal(0, 0.01, len(time))
    soundfile.write(
        path,
        np.stack(
            [
                0.4 * np.sin(2 * np.pi * 200 * time),
                0.1 * np.cos(2 * np.pi * 300 * time),
            ],
            axis=1,
        )
        + noise[:, None],
        rate,
    )
    return Recording(path, "slate", channels=("contact", "air"))


def test_training_sound_equals_live_sound(tmp_path: Path) -> None:
    recording = write(tmp_path / "a.wav")
    whole = soundfile.read(recording.path, dtype="float32")[0]
    live = Resampler(48_000, 2000, channels=2)
    expected = np.concatenate([live.push(whole), live.flush()])
    assert np.array_equal(read_signals([recording], channels=2)[0], expected)


def test_swapped_channels_are_put_right_and_one_channel_is_contact(
    tmp_path: Path,
) -> None:
    straight = write(tmp_path / "a.wav")
    swapped = Recording(straight.path, "slate", channels=("air", "contact"))
    both, exchanged = (
        read_signals([straight], channels=2)[0],
        read_signals([swapped], channels=2)[0],
    )
    assert np.array_equal(both, exchanged[:, ::-1])
    assert np.array_equal(read_signals([swapped], channels=1)[0], both[:, 1:])


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    first = read_signals([write(tmp_path / "a.wav")], channels=1)[0]
    second = read_signals([write(tmp_path / "a.wav", seed=1)], channels=1)[0]
    assert not np.array_equal(first, second)


@pytest.mark.parametrize("channels", [1, 2])
def test_opus_changes_sound_a_little_and_its_length_not_at_all(
    tmp_path: Path, channels: int
) -> None:
    recording = write(tmp_path / "a.wav")
    codec = Codec("opus", channels=channels, packet_size=480)
    plain, coded = (
        read_signals([recording], channels=channels, codec=each)[0]
        for each in (None, codec)
    )
    assert plain.shape == coded.shape
    assert 0 < np.abs(plain - coded)[100:-100].max() < 0.05


def test_opus_at_another_rate_says_so(tmp_path: Path) -> None:
    recording = write(tmp_path / "a.wav", rate=44_100)
    with pytest.raises(DatasetError, match="44100 Hz, but Opus works at 48000 Hz"):
        read_signals([recording], channels=2, codec=Codec("opus"))


@pytest.mark.parametrize("content", [None, "words"])
def test_an_unreadable_file_is_named(tmp_path: Path, content: str | None) -> None:
    if content:
        (tmp_path / "a.wav").write_text(content)
    with pytest.raises(DatasetError, match=r"a\.wav"):
        read_signals([Recording(tmp_path / "a.wav", "slate")], channels=1)


def test_a_known_gain_of_the_contact_preamplifier_is_undone(tmp_path: Path) -> None:
    recording = write(tmp_path / "a.wav")
    quiet = replace(recording, properties={"gain_db": "-6"})
    plain, louder = (read_signals([each], channels=2)[0] for each in (recording, quiet))
    assert louder[:, 0] == pytest.approx(plain[:, 0] * 10**0.3, rel=1e-5)
    assert np.array_equal(louder[:, 1], plain[:, 1])
