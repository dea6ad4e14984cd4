"""A finger is set up, and its microphones are checked, from Python as by the command
line."""

import json
from pathlib import Path

import pytest

from tactophone.app.check import check_microphones
from tactophone.cli import main
from tactophone.core.settings import Settings, change
from tactophone.signal.perception.model_file import read_model
from tactophone_lab.app.setup import fit_finger, record_set_up

QUICK = ["capture.source=finger", "simulation.gain_db=-20"]


@pytest.mark.slow
def test_python_fits_the_model_that_setup_fits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    done: list[int] = []
    sounds = record_set_up(
        change(Settings(), QUICK), ["whiteboard"], ["brick"], seconds=2.0
    )
    fitted = fit_finger(sounds, tmp_path / "python.onnx", tip="pad", report=done.append)
    command = [
        "setup",
        "--source",
        "finger",
        "--set",
        "simulation.gain_db=-20",
        "--seconds",
        "2",
        "--yes",
        "--json",
    ]
    assert (
        main(
            [
                *command,
                "--smooth",
                "whiteboard",
                "--rough",
                "brick",
                "--out",
                str(tmp_path / "cli.onnx"),
            ]
        )
        == 0
    )
    result = json.loads(capsys.readouterr().out)
    assert (result["threshold_dbfs"], result["score"]) == (
        fitted.threshold_dbfs,
        fitted.fit.score,
    )
    assert done == [1, 2]
    cards = [read_model(tmp_path / f"{name}.onnx").card for name in ("python", "cli")]
    assert cards[0].gate == cards[1].gate
    assert cards[0].decision == cards[1].decision


@pytest.mark.slow
def test_python_checks_microphones_as_the_verb_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = check_microphones(change(Settings(), QUICK), tmp_path / "python.toml")
    command = [
        "check",
        "--source",
        "finger",
        "--set",
        "simulation.gain_db=-20",
        "--yes",
        "--json",
    ]
    assert main([*command, "--out", str(tmp_path / "cli.toml")]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["threshold_dbfs"] == found.calibration.threshold_dbfs
    assert found.passed
    texts = [
        (tmp_path / f"{name}.toml").read_text().splitlines()
        for name in ("python", "cli")
    ]
    different = [pair for pair in zip(*texts, strict=True) if pair[0] != pair[1]]
    assert all("made" in one for one, _ in different)
