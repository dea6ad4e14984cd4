import json
from pathlib import Path

import pytest

from tactophone.cli import main
from tests.bridges.recorded_run import record
from tests.models import write_tiny_model

pytest.importorskip("mcap")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    return record(folder / "run.mcap", write_tiny_model(folder / "tiny.onnx"))


def test_it_says_that_all_is_equal(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(log)]) == 0
    assert "equal to the bit" in capsys.readouterr().out


def test_what_would_have_been_rendered_is_written(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--profile", "perceptual", "--out", str(tmp_path), "--plot", "--json", "--to", ".ahap"]
    assert main(["replay", str(log), *options]) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert outcome["different"] > 0
    assert all(Path(path).is_file() for path in outcome["files"].values())
    assert {"vibration", "timeline", "figure", ".ahap"} == set(outcome["files"])


def test_a_changed_log_is_noticed(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Another model under the same name is what a changed log looks like.
    assert main(["replay", str(log), "--model", "paper-mono", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["different"] > 50


@pytest.mark.parametrize("words", [["--profile", "none-such"], ["--plot"], ["--ceiling", "2"]])
def test_wrong_options_are_one_line(log: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(log), *words]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_the_sound_of_a_log_is_processed_and_imported(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["feel", str(log), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "run.haptic.wav").is_file()
    assert main(["dataset", "import", str(log), str(tmp_path / "set"), "--surface", "slate", "--label", "rough"]) == 0
    assert "run.flac,slate,rough,contact" in (tmp_path / "set" / "metadata.csv").read_text()
    assert main(["dataset", "import", str(log), str(tmp_path / "other"), "--label", "soft"]) == 1
