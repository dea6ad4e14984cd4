import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile

from tactophone.cli import main


def test_version_and_help_exit_with_zero(capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as stop:
            main([flag])
        assert stop.value.code == 0
    printed = capsys.readouterr().out
    assert "tactophone" in printed
    assert "open_pipeline" not in printed  # the example of the package is for Python


def test_an_unknown_verb_is_a_usage_error() -> None:
    with pytest.raises(SystemExit) as stop:
        main(["telephone"])
    assert stop.value.code == 2


def test_the_help_begins_with_what_it_is_in_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    before = capsys.readouterr().out.partition("options:")[0]
    whole = " ".join(before.split("VERB ...")[1].split())
    assert whole == "A telephone for touch: microphones on a robot's fingertip, vibration on an operator's."


@pytest.mark.parametrize("closed", [">/dev/full", ">&-"])
def test_output_that_cannot_be_written_is_reported_in_one_line(closed: str) -> None:
    command = f"{shlex.quote(sys.executable)} -m tactophone settings {closed}"
    done = subprocess.run(command, shell=True, stderr=subprocess.PIPE, text=True, check=False)
    if closed == ">&-":
        assert (done.returncode, done.stderr) == (0, "")
    else:
        assert (done.returncode, done.stderr) == (
            1,
            "tactophone: cannot read or write: No space left on device; free some space, or write elsewhere\n",
        )


@pytest.mark.parametrize("verb", ["feel", "demo", "simulate competition"])
def test_a_folder_for_results_that_cannot_be_made_is_named(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    out = [str(tmp_path / "file")] if verb == "simulate competition" else ["--out", str(tmp_path / "file")]
    assert main([*verb.split(), *(["a.wav"] if verb == "feel" else []), *out]) == 1
    assert f"{tmp_path / 'file'}: cannot be made (File exists); name a folder of your own" in capsys.readouterr().err


def test_a_sound_file_on_a_full_disk_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(_: object) -> int:
        raise soundfile.LibsndfileError(2, "Error opening 'demo/vibration.wav': ")

    monkeypatch.setattr("tactophone.cli.devices.run", run, raising=False)
    assert main(["settings"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "demo/vibration.wav" in line
    assert "is the disk full?" in line
