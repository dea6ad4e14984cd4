import itertools
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import config
from tactophone.capture import FileSource
from tactophone.cli._support.sources import Recorded, open_source
from tactophone.config import Settings
from tactophone.errors import ConfigError, DatasetError
from tactophone.types import Source, Touch

from ..dataset.folders import audiofolder, write_sound


def source(*changes: str) -> Source:
    return open_source(config.change(Settings(), changes))


def test_a_recording_comes_at_the_lines_rate_and_again_and_again(tmp_path: Path) -> None:
    tone = 0.5 * np.sin(2 * np.pi * 441 / 44_100 * np.arange(4410))
    soundfile.write(tmp_path / "tone.wav", tone, 44_100)
    with source("capture.source=file", f"capture.device={tmp_path / 'tone.wav'}") as opened:
        blocks = list(itertools.islice(opened, 100))
    assert {block.sample_rate for block in blocks} == {48_000}
    assert [block.start for block in blocks[1:]] == [block.end for block in blocks[:-1]]
    sound = np.concatenate([block.samples[:, 0] for block in blocks])
    spectrum = np.abs(np.fft.rfft(sound[4800:9600] * np.hanning(4800)))
    assert np.argmax(spectrum) * 10 == 440
    assert len(sound) > 9600


def test_the_finger_visits_stones_for_ever_and_knows_the_truth() -> None:
    with source("capture.source=finger", "capture.block_size=4096") as finger:
        truths = [finger.truth_now() for _ in itertools.islice(finger, 90)]
    assert set(truths) >= {0, 1} or set(truths) >= {0, 2}


def test_what_cannot_be_opened_says_why() -> None:
    with pytest.raises(ConfigError, match="no file is named"):
        source("capture.source=file")
    with pytest.raises(DatasetError, match="no such file"):
        source("capture.source=file", "capture.device=nowhere.wav")
    with pytest.raises(ConfigError, match="a seed"):
        source("capture.source=finger", "capture.device=thumb")


def test_a_recording_of_a_data_set_knows_its_truth(tmp_path: Path) -> None:
    folder = audiofolder(tmp_path)
    with Recorded(FileSource(folder / "audio" / "00_0.flac", block_size=480)) as recorded:
        truths = {recorded.truth_now() for _ in recorded}
    assert Touch.ROUGH in truths


def test_one_of_no_data_set_says_that_it_does_not_know(tmp_path: Path) -> None:
    with Recorded(FileSource(write_sound(tmp_path / "a.wav"), block_size=480)) as recorded:
        assert {recorded.truth_now() for _ in recorded} == {-1}
