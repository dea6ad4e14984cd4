import itertools
import os
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.app import runs
from tactophone.app.sources import (
    AudioInput,
    open_source,
    recorded,
    refuse_overwriting,
)
from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.settings import Settings, change
from tactophone.core.types import Source, Touch
from tactophone.live.audio.files import FileSource
from tests.folders import audiofolder, write_sound


def source(*changes: str) -> Source:
    return open_source(change(Settings(), changes))


def test_a_recording_is_resampled_to_the_live_rate_and_looped(tmp_path: Path) -> None:
    tone = 0.5 * np.sin(2 * np.pi * 441 / 44_100 * np.arange(4410))
    soundfile.write(tmp_path / "tone.wav", tone, 44_100)
    with source(
        "capture.source=file", f"capture.device={tmp_path / 'tone.wav'}"
    ) as opened:
        blocks = list(itertools.islice(opened, 100))
    assert {block.sample_rate for block in blocks} == {48_000}
    assert [block.start for block in blocks[1:]] == [block.end for block in blocks[:-1]]
    sound = np.concatenate([block.samples[:, 0] for block in blocks])
    spectrum = np.abs(np.fft.rfft(sound[4800:9600] * np.hanning(4800)))
    assert np.argmax(spectrum) * 10 == 440
    assert len(sound) > 9600


@pytest.mark.slow
def test_the_finger_visits_stones_without_end_with_the_truth() -> None:
    with source("capture.source=finger", "capture.block_size=4096") as finger:
        truths = [finger.truth_of() for _ in itertools.islice(finger, 90)]
    assert set(truths) >= {0, 1} or set(truths) >= {0, 2}


def test_an_error_names_what_cannot_be_opened() -> None:
    with pytest.raises(ConfigError, match="no file is named"):
        source("capture.source=file")
    with pytest.raises(DatasetError, match="no such file"):
        source("capture.source=file", "capture.device=nowhere.wav")
    with pytest.raises(ConfigError, match="a seed"):
        source("capture.source=finger", "capture.device=thumb")


def test_without_the_laboratory_its_finger_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    install = r"pip install './packages/tactophone-lab\[sim\]'"
    monkeypatch.setattr("tactophone.core.plugins.load", lambda group, name: None)
    with pytest.raises(ConfigError, match=install):
        source("capture.source=finger")
    settings = change(Settings(), ["capture.source=finger"])
    with pytest.raises(ConfigError, match=install):
        AudioInput(settings, "brick")


def test_a_recording_of_a_data_set_has_its_truth(tmp_path: Path) -> None:
    folder = audiofolder(tmp_path)
    file = FileSource(folder / "audio" / "00_0.flac", block_size=480)
    with recorded(file, file.path, file.duration) as opened:
        truths = {opened.truth_of() for _ in opened}
    assert Touch.ROUGH in truths


def test_a_recording_without_a_data_set_has_no_truth(tmp_path: Path) -> None:
    file = FileSource(write_sound(tmp_path / "a.wav"), block_size=480)
    with recorded(file, file.path, file.duration) as opened:
        assert {opened.truth_of() for _ in opened} == {-1}


@pytest.mark.parametrize("spelling", ["stroke.wav", "a/../stroke.wav", "soft", "hard"])
def test_no_vibration_is_written_over_the_recording_that_is_felt(
    spelling: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("stroke.wav").write_bytes(b"mine")
    Path("a").mkdir()
    Path("soft").symlink_to("stroke.wav")
    os.link("stroke.wav", "hard")
    settings = change(
        Settings(),
        [
            "capture.source=file",
            f"capture.device={tmp_path}/stroke.wav",
            "output.actuator=file",
            f"output.device={spelling}",
        ],
    )
    for begin in (
        lambda: refuse_overwriting(settings),
        lambda: runs.both_sides(settings, name="none").__enter__(),
        lambda: runs.open_side(settings, "none", open_source),
    ):
        with pytest.raises(ConfigError, match="would overwrite"):
            begin()
    assert Path("stroke.wav").read_bytes() == b"mine"
    free = change(settings, ["output.device=vibration.wav"])
    refuse_overwriting(free)
    with pytest.raises(ConfigError, match="would overwrite"):
        refuse_overwriting(free, [Path(spelling)])


def test_the_usual_vibration_is_not_written_over_its_source_or_a_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("vibration.wav").touch()
    usual = change(Settings(), ["output.actuator=file"])
    refuse_overwriting(usual)
    for read in (
        ["capture.source=file", "capture.device=vibration.wav"],
        ["detector.model=vibration.wav"],
        ["detector.calibration=vibration.wav"],
    ):
        with pytest.raises(ConfigError, match="would overwrite"):
            refuse_overwriting(change(usual, read))
