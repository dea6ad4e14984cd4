"""A verb that takes a person's strokes, or trains, refuses a file that it cannot write
before it begins."""

from pathlib import Path

import pytest

from tactophone.cli import main

VERBS = (
    "check --source finger --yes --out {out}",
    "setup --source finger --yes --out {out}",
    "devices measure --out {out}",
    "train nowhere --out {out}",
    "finetune texture nowhere --general nowhere --out {out}",
    "set-threshold texture --data nowhere --false-bumps 1/min --out {out}",
    "set-threshold texture --data nowhere --false-bumps 1/min --dry-run --plot {out}",
)


@pytest.mark.parametrize("place", ["file/new", "folder"])
@pytest.mark.parametrize("verb", VERBS)
def test_a_file_that_cannot_be_written_is_refused_before_anything_begins(
    verb: str,
    place: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Minutes of strokes were lost, as the file was tried last."""
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    for module in ("tactophone.app.check", "tactophone_lab.app.object_sounds"):
        monkeypatch.setattr(f"{module}.AudioInput", pytest.fail)
    assert main(verb.format(out=tmp_path / place).split()) == 1
    words = {
        "file/new": "file/new: nothing can be written there",
        "folder": "folder: is a folder; name a file",
    }
    assert words[place] in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    "arguments", [["--model", "paper"], ["--compare", "a,b", "--model", "none.onnx"]]
)
def test_a_model_that_cannot_be_used_is_refused_before_anything_begins(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tactophone_lab.app.object_sounds.AudioInput", pytest.fail)
    monkeypatch.chdir(tmp_path)
    assert main(["setup", "--source", "finger", "--yes", *arguments]) == 1
