from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.perception import read_model
from tests.dataset.folders import audiofolder

QUICK = ["--reference-code", "--hop", "64", "--batch-size", "64", "--epochs", "1", "--least-steps", "0"]


def test_trains_a_model_that_the_live_side_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "stones.onnx"
    assert main(["train", str(audiofolder(tmp_path / "sound")), "--out", str(out), *QUICK]) == 0
    assert capsys.readouterr().out == f"{out}\n"
    card = read_model(out).card
    assert (card.name, card.channels, card.gate.rule) == ("stones", 2, "mean_absolute")
    assert card.training["recipe"] == "authors/general"
    assert card.training["settings"]["hop"] == 64
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sound", "stones.onnx"]


def test_training_continues_from_a_model(tmp_path: Path) -> None:
    sound, first, second = str(audiofolder(tmp_path / "sound")), tmp_path / "a.onnx", tmp_path / "b.onnx"
    main(["train", sound, "--out", str(first), *QUICK])
    assert main(["train", sound, "--out", str(second), "--from", str(first), *QUICK]) == 0
    assert read_model(second).card.training["start"] == "a.onnx"
    assert main(["train", sound, "--from", str(first), "--variant", "one-channel", *QUICK]) == 1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--epochs", "0"], "--epochs 0: must be 1 or more"),
        (["--noise", "nan"], "--noise nan: must be 0 or more"),
        (["--contact-threshold", "loud"], "--contact-threshold loud: must be a level"),
        (["--opus-bitrate", "5"], "--opus-bitrate 5: must be 16 to 512 kbit/s"),
        (["--filter", "label=soft"], "no recording has it; label is one of rough, smooth"),
    ],
)
def test_an_impossible_request_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    sound = audiofolder(tmp_path / "sound")
    assert main(["train", str(sound), "--out", str(tmp_path / "a.onnx"), *QUICK, *options]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "a.onnx").exists()


def test_quiet_recordings_are_too_quiet_for_the_papers_threshold(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = [option for option in QUICK if option != "--reference-code"]
    assert main(["train", str(audiofolder(tmp_path / "sound")), "--out", str(tmp_path / "a.onnx"), *options]) == 1
    assert "no window of the smooth recordings is louder than -26.0 dBFS" in capsys.readouterr().err
    assert not (tmp_path / "a.onnx").exists()


def test_a_broken_recording_is_named_and_the_others_train(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sound = audiofolder(tmp_path / "sound")
    (sound / "audio" / "00_0.flac").write_text("no sound")
    assert main(["train", str(sound), "--out", str(tmp_path / "a.onnx"), *QUICK]) == 0
    assert "left out: " in capsys.readouterr().err
