import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.recordings.metadata import write_metadata
from tactophone.core.recordings.values import Recording, Segment
from tactophone.core.types import Touch
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.evaluation.bootstrap import Estimate
from tests.models import write_tiny_model


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rough is loud and low, smooth is less so, both with noise."""
    root, rng = tmp_path_factory.mktemp("validation"), np.random.default_rng(0)
    recordings = []
    for number in range(6):
        label = Touch.ROUGH if number % 2 else Touch.SMOOTH
        phase = 2 * np.pi * 300 * np.arange(3 * 48_000) / 48_000
        sound = (0.4 if label is Touch.ROUGH else 0.2) * np.sin(phase) + rng.normal(
            0, 0.05, len(phase)
        )
        path = root / f"{number}.wav"
        soundfile.write(path, np.stack([sound, 0.1 * sound], axis=1), 48_000)
        recordings.append(Recording(path, f"stone {number}", label, ("contact", "air")))
    write_metadata(root, recordings)
    return root


@pytest.mark.slow
def test_the_rule_is_written_into_the_file_and_a_picture_beside_it(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, out = write_tiny_model(tmp_path / "tiny.onnx"), tmp_path / "tuned.onnx"
    command = [
        "set-threshold",
        str(model),
        "--data",
        str(data),
        "--out",
        str(out),
        "--json",
    ]
    assert main([*command, "--false-positives", "1"]) == 0
    figures = json.loads(capsys.readouterr().out)
    card = read_model(out).card
    assert card.decision.rough_on == figures["chosen"]["rough_on"]
    assert card.scores["operating point"]["dataset"] == data.name
    assert (tmp_path / "tuned.trade-off.png").is_file()
    assert read_model(model).card.decision.rough_on == 0.5


@pytest.mark.slow
def test_a_rule_that_is_worse_on_objects_left_out_is_refused_unless_anyway(
    data: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    rates = iter([Estimate(0.1, 0.0, 0.2), Estimate(0.3, 0.1, 0.5)] * 2)
    monkeypatch.setattr(
        "tactophone_lab.app.set_threshold.smooth_as_rough",
        lambda *arguments: next(rates),
    )
    model, out = write_tiny_model(tmp_path / "tiny.onnx"), tmp_path / "tuned.onnx"
    command = [
        "set-threshold",
        str(model),
        "--data",
        str(data),
        "--out",
        str(out),
        "--false-bumps",
        "600/min",
    ]
    assert main(command) == 1
    words = " ".join(capsys.readouterr().out.split())
    assert (
        "smooth as rough is now 0.300 (0.10-0.50) as rendered (was 0.100 "
        "(0.00-0.20)); nothing was written" in words
    )
    assert "--anyway" in words
    assert not out.exists()
    assert main([*command, "--anyway"]) == 0
    assert out.exists()


@pytest.mark.slow
def test_one_object_of_a_class_has_no_intervals_and_says_so(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = write_tiny_model(tmp_path / "tiny.onnx")
    one = ["--data", str(data), "--filter", "surface=stone 0,stone 1"]
    assert (
        main(["set-threshold", str(model), *one, "--false-positives", "1", "--dry-run"])
        == 0
    )
    shown = capsys.readouterr().out
    assert "one object of a class" in shown
    assert "(" not in shown.split("note")[0]
    assert main(["evaluate", str(model), *one, "--note", "two stones"]) == 0
    shown = capsys.readouterr().out
    assert "No intervals" in shown
    assert "(" not in shown
    assert len(read_model(model).card.scores["two stones"]["auc, two-class rule"]) == 1


@pytest.mark.slow
def test_a_dry_run_leaves_the_model_alone(data: Path, tmp_path: Path) -> None:
    model = write_tiny_model(tmp_path / "tiny.onnx")
    before = model.read_bytes()
    assert (
        main(
            [
                "set-threshold",
                str(model),
                "--data",
                str(data),
                "--false-positives",
                "1",
                "--dry-run",
            ]
        )
        == 0
    )
    assert model.read_bytes() == before


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        (["--false-bumps", "often"], "such as 1/min"),
        (["--false-positives", "2"], "must be over 0 to 1"),
    ],
)
def test_an_invalid_goal_is_an_error(
    goal: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["set-threshold", "paper", "--data", "nowhere", *goal]) == 1
    assert words in capsys.readouterr().err


@pytest.mark.slow
def test_a_shipped_model_is_copied_not_changed(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = model_path("texture").read_bytes()
    assert (
        main(
            ["set-threshold", "texture", "--data", str(data), "--false-positives", "1"]
        )
        == 0
    )
    assert model_path("texture").read_bytes() == before
    assert (
        read_model(tmp_path / "texture.onnx").card.scores["operating point"]["dataset"]
        == data.name
    )


def test_a_recording_of_both_labels_counts_by_its_segments(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    smooth, rough = (soundfile.read(data / f"{number}.wav")[0] for number in (0, 1))
    soundfile.write(tmp_path / "run.wav", np.concatenate([smooth, rough]), 48_000)
    parts = (Segment(0.0, 3.0, "smooth"), Segment(3.0, 6.0, "rough"))
    write_metadata(
        tmp_path,
        [
            Recording(
                tmp_path / "run.wav", "run", None, ("contact", "air"), segments=parts
            )
        ],
    )
    command = [
        "set-threshold",
        str(write_tiny_model(tmp_path / "tiny.onnx")),
        "--data",
        str(tmp_path),
        "--dry-run",
    ]
    assert main([*command, "--false-positives", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["chosen"]["rough_recall"][0] > 0.9
