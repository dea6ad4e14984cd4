import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import DatasetError
from tactophone.cli import main
from tactophone.signal.perception.model_file import read_model
from tactophone_lab.cli.data import Reading, open_filtered
from tests.folders import SAMPLE_RATE, audiofolder, write_sound


def field_recorder(folder: Path) -> Path:
    """Class folders of four channels, the finger's on the last two."""
    for number, label in enumerate(("rough", "smooth") * 3):
        noise = np.random.default_rng(number).uniform(-0.3, 0.3, (2 * SAMPLE_RATE, 4))
        noise[:SAMPLE_RATE] *= 1e-3  # no touch yet
        path = folder / label / f"thing{number}_1.wav"
        path.parent.mkdir(parents=True, exist_ok=True)
        noise[:, :2] = 0
        soundfile.write(path, noise, SAMPLE_RATE)
    return folder


def test_two_of_four_channels_are_trained_on_and_scored(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = str(field_recorder(tmp_path / "set"))
    model = tmp_path / "a.onnx"
    train = ["train", data, "--recipe", "level", "--out", str(model)]
    assert main([*train, "--channels", "2"]) == 1
    assert "--channels 3,4" in capsys.readouterr().err
    assert main([*train, "--channels", "3,4"]) == 0
    assert read_model(model).card.channels == 2
    score = ["evaluate", str(model), "--data", data, "--json"]
    assert main([*score, "--channels", "3,4"]) == 0
    # The first two channels are silent, so they would be no contact at all.
    printed = capsys.readouterr().out
    (scores,) = json.loads(printed[printed.index("{") :]).values()
    assert scores["contact"] > 0.3


def test_the_picked_channels_reach_whoever_reads_the_recordings(
    tmp_path: Path,
) -> None:
    data = field_recorder(tmp_path / "set")
    kept = open_filtered(data, None, channels=2, reading=Reading(places=(2, 3)))
    sound = kept.recordings[0].read(channels=2)
    assert np.abs(sound.samples).max() > 0.2


def test_every_filter_must_match(tmp_path: Path) -> None:
    kept = open_filtered(
        audiofolder(tmp_path), ["surface=stone 00,stone 01", "scenario=table"]
    )
    assert [recording.path.name for recording in kept.recordings] == [
        "00_1.flac",
        "01_1.flac",
    ]
    assert len(open_filtered(tmp_path, None).recordings) == 8


def test_bad_files_are_left_out(tmp_path: Path) -> None:
    (audiofolder(tmp_path) / "audio" / "02_0.flac").write_bytes(b"")
    assert len(open_filtered(tmp_path, None).recordings) == 7


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scenario", "write KEY=VALUE"),
        ("scenario=box", "scenario is one of hand, table"),
    ],
)
def test_a_filter_without_a_match_says_what_there_is(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(DatasetError, match=message):
        open_filtered(audiofolder(tmp_path), [text])


def test_a_mono_file_among_stereo_ones_is_left_out_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sound(audiofolder(tmp_path) / "audio" / "02_0.flac", channels=1)
    manifest = (
        (tmp_path / "metadata.csv")
        .read_text()
        .replace(
            "02_0.flac,stone 02,rough,contact|air", "02_0.flac,stone 02,rough,contact"
        )
    )
    (tmp_path / "metadata.csv").write_text(manifest)
    assert len(open_filtered(tmp_path, None, channels=2).recordings) == 7
    printed = capsys.readouterr().err
    assert "02_0.flac: channels: one microphone" in printed
    assert "--channels 1" in printed
    assert len(open_filtered(tmp_path, None, channels=1).recordings) == 8
