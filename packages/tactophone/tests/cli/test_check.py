import json
from pathlib import Path
from typing import Any

import pytest
import soundfile

from tactophone.app.check import check_microphones
from tactophone.cli import check as check_verb
from tactophone.cli import main
from tactophone.cli.guide import GuideScreen
from tactophone.core.settings import Settings, change
from tactophone.signal.perception.calibration import Calibration, CalibrationResult

FINGER = ["check", "--source", "finger", "--set", "simulation.gain_db=-12"]


@pytest.mark.slow
def test_a_good_set_up_is_written_down(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "finger.toml"
    assert main([*FINGER, "--out", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "good: written to" in printed
    assert Calibration.read(file).source == "finger"


@pytest.mark.slow
def test_a_bad_one_is_refused_with_what_to_change(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "finger.toml"
    assert (
        main([*FINGER, "--set", "simulation.faults=swapped", "--out", str(file)]) == 1
    )
    assert "refused: microphones swapped" in capsys.readouterr().out
    assert not file.exists()


@pytest.mark.slow
def test_fewer_false_alarms_want_a_higher_threshold(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    thresholds = []
    for rate in ("60/min", "0.1/min"):
        assert (
            main(
                [
                    *FINGER,
                    "--false-alarms",
                    rate,
                    "--json",
                    "--out",
                    str(tmp_path / "c.toml"),
                ]
            )
            == 0
        )
        thresholds.append(json.loads(capsys.readouterr().out)["threshold_dbfs"])
    assert thresholds[0] < thresholds[1]


def test_a_recording_can_be_calibrated_on_and_one_too_short_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(tmp_path / "short.wav", [[0.0, 0.0]] * 48_000, 48_000)
    command = ["check", "--source", f"file:{tmp_path / 'short.wav'}"]
    assert main(command) == 1
    assert "ended" in capsys.readouterr().err


@pytest.mark.parametrize("rate", ["many", "0/min", "3/hour"])
def test_a_rate_that_is_none_is_named(
    rate: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*FINGER, "--false-alarms", rate]) == 1
    assert "1/min" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "code"), [([], 0), (["--set", "simulation.faults=air-covered"], 1)]
)
def test_a_glazed_tile_which_sounds_alike_to_both_microphones_covers_neither(
    faults: list[str], code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [
        *FINGER,
        "--stroked",
        "glazed tile",
        "--out",
        str(tmp_path / "calibration.toml"),
    ]
    assert main([*arguments, *faults]) == code
    assert ("covered" in capsys.readouterr().out) is bool(faults)


@pytest.mark.slow
@pytest.mark.parametrize(("key", "steps"), [("y", 4), ("n", 3)])
def test_a_robot_is_asked_for_and_then_to_move(
    key: str,
    steps: int,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    instructions: list[str] = []

    def check(
        settings: Settings, *args: Any, step: Any, **options: Any
    ) -> CalibrationResult:
        def follow(*step_arguments: Any) -> Any:
            instructions.append(step_arguments[-1])
            return step(*step_arguments)

        simulated = change(
            settings, ["capture.source=finger", "simulation.gain_db=-12"]
        )
        return check_microphones(simulated, *args, step=follow, **options)

    monkeypatch.setattr(check_verb, "check_microphones", check)
    monkeypatch.setattr(GuideScreen, "answers", True)
    monkeypatch.setattr(GuideScreen, "pressed", lambda *_: key)
    assert (
        main(
            [
                "check",
                "--source",
                "portaudio",
                "--out",
                str(tmp_path / "finger.toml"),
            ]
        )
        == 0
    )
    output = capsys.readouterr()
    assert "Does a robot move this finger?" in output.err + output.out
    assert len(instructions) == steps
    assert ("move the robot in the air all the time" in instructions[-1]) is (
        key == "y"
    )
    assert ("motion:" in output.out) is (key == "y")
    assert Calibration.read(tmp_path / "finger.toml").margin_db == (
        4.0 if key == "y" else 5.0
    )


def test_no_calibration_is_written_over_the_recording_that_it_is_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = tmp_path / "silence.wav"
    sound.write_bytes(b"mine")
    link = tmp_path / "finger.toml"
    link.symlink_to(sound)
    for out in (sound, link):
        assert main(["check", "--source", f"file:{sound}", "--out", str(out)]) == 1
        assert f"{out}: would overwrite the recording" in capsys.readouterr().err
    assert sound.read_bytes() == b"mine"
