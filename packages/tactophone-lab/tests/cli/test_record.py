import dataclasses
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import soundfile

from tactophone.cli import main
from tactophone_lab.datasets.open import open_dataset
from tests.signal.perception.test_calibration_file import CALIBRATION

FINGER = [
    "record",
    "whiteboard",
    "--label",
    "smooth",
    "--source",
    "finger",
    "--set",
    "simulation.gain_db=-12",
    "--seconds",
    "8",
]


@pytest.mark.slow
def test_a_session_in_virtual_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration = dataclasses.replace(
        CALIBRATION, window_dbfs=-38.0, floor_dbfs=(-40.0, -58.0)
    )
    calibration.write(tmp_path / "finger.toml")
    command = [
        *FINGER,
        "--takes",
        "long_medium,wiggle",
        "--material",
        "enamel",
        "--out",
        str(tmp_path),
        "--json",
    ]
    command += ["--calibration", str(tmp_path / "finger.toml")]
    assert main(command) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [take["take"] for take in printed["takes"]] == ["long_medium", "wiggle"]
    assert [
        recording.known("material") for recording in open_dataset(tmp_path).recordings
    ] == ["enamel", "enamel"]
    written = [path for path in tmp_path.rglob("*") if path.name != "finger.toml"]
    assert not any(path.stat().st_mode & 0o077 for path in written)
    assert main(command) == 0
    assert json.loads(capsys.readouterr().out)["takes"] == []


def test_a_take_that_there_is_not_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*FINGER, "--takes", "sideways", "--out", str(tmp_path)]) == 1
    assert "long_light" in capsys.readouterr().err


@pytest.mark.slow
def test_a_session_that_was_killed_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        sys.executable,
        "-m",
        "tactophone",
        *FINGER[:-1],
        "60",
        "--out",
        str(tmp_path),
    ]
    process = subprocess.Popen(
        command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )
    part = tmp_path / "whiteboard" / "table" / "long_light.part.wav"
    while not (part.is_file() and part.stat().st_size > 48_000 * 6):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    written = part.stat().st_size / 6 / 48_000
    assert main([*FINGER, "--takes", "wiggle", "--out", str(tmp_path)]) == 0
    assert "which was cut off" in capsys.readouterr().err
    first, _ = open_dataset(tmp_path).recordings
    assert soundfile.info(first.path).duration > written - 1
    assert "cut off" in first.known("quality")
