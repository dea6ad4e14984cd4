"""Scores from Python are those of the command line."""

import json
from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone_lab.app.evaluate import evaluate_model
from tactophone_lab.datasets.open import open_dataset
from tests.folders import audiofolder


def test_python_scores_a_model_as_evaluate_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, done = audiofolder(tmp_path / "sound"), list[int]()
    report, warnings = evaluate_model(
        "texture",
        open_dataset(folder),
        report=lambda what, part, total, name: done.append(part),
    )
    assert main(["evaluate", "texture", "--data", str(folder), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)["texture"]
    assert (
        shown["rendered"]["balanced_accuracy"]["value"]
        == report.rendered.balanced_accuracy.value
    )
    assert shown["updates"] == report.updates
    assert (warnings, done) == ([], list(range(1, 9)))
