"""Runs the tutorial's commands as they stand in docs/guide/tutorial.md, one after another, in an empty folder."""

import re
import shlex
from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.perception.model_file import read_model

TUTORIAL = Path(__file__).parent.parent / "docs" / "guide" / "tutorial.md"


def commands() -> list[tuple[list[str], int]]:
    """Each command with the exit code that the page promises, 0 unless it says otherwise."""
    blocks = re.findall(r"```console\n(.*?)```", TUTORIAL.read_text(), flags=re.DOTALL)
    lines = "\n".join(blocks).splitlines()
    found = []
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if line.startswith("$ tactophone "):
            promised = re.fullmatch(r"\[exit (\d)\]", following)
            found.append((shlex.split(line)[2:], int(promised[1]) if promised else 0))
    return found


@pytest.mark.slow
def test_the_tutorial_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a quarter of the fine-tuning's steps, of which each is like the others."""
    monkeypatch.setattr("tactophone.training.finetune.STEPS", 75)
    monkeypatch.chdir(tmp_path)
    assert len(commands()) > 12
    for command, promised in commands():
        assert main(command) == promised, command
    assert not (tmp_path / "never.toml").exists()
    made = (
        "finger.onnx",
        "calibration.toml",
        "recordings.png",
        "stones.onnx",
        "finetuned.trade-off.png",
        "felt/wiggle.haptic.wav",
    )
    assert all((tmp_path / name).is_file() for name in made)
    card = read_model(tmp_path / "finetuned.onnx").card
    assert card.training["finetuned"]["new"] == ["brick", "glazed tile", "sawn plank", "whiteboard"]
    assert "operating point" in card.scores
