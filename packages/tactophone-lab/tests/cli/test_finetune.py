import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactophone.cli import main
from tactophone.core.types import FloatArray
from tactophone.signal.perception.model_file import Gate, read_model
from tactophone_lab.training import finetuning
from tactophone_lab.training.onnx_export import make_card, write_model
from tactophone_lab.training.paper_network import PaperNetwork, weights_of
from tests.folders import audiofolder


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A fine-tuning from a network that calls all sound smooth; training is skipped and
    makes all of it rough."""
    calling = {}
    for name, touch in (("smooth", 1), ("rough", 2)):
        weights = {
            key: np.zeros_like(value)
            for key, value in weights_of(PaperNetwork()).items()
        }
        weights["linear.bias"][touch] = 5.0
        calling[name] = weights
    card = replace(make_card(calling["smooth"], name="old", gate=Gate(-60.0)))
    write_model(tmp_path / "old.onnx", card, calling["smooth"])

    def train(*args: object, **settings: object) -> dict[str, FloatArray]:
        return calling["rough"]

    monkeypatch.setattr(finetuning, "train_on_both", train)
    new, general = (
        audiofolder(tmp_path / "new"),
        audiofolder(tmp_path / "general", surfaces=8, takes=1),
    )
    out = tmp_path / "tuned.onnx"
    options = ["--general", str(general), "--strategy", "fine-tuned", "--out", str(out)]
    return ["finetune", str(tmp_path / "old.onnx"), str(new), *options]


@pytest.mark.slow
def test_a_model_with_more_false_positives_elsewhere_is_refused_unless_anyway(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = Path(command[-1])
    assert main(command) == 1
    shown = " ".join(capsys.readouterr().out.split())
    # One smooth surface elsewhere: no interval.
    assert (
        "refused: elsewhere smooth as rough is now 1.000 (was 0.000); nothing was "
        "written" in shown
    )
    assert not out.exists()
    assert main([*command, "--anyway", "--json"]) == 0
    change = json.loads(capsys.readouterr().out)["general test set"][
        "false_positive_rate"
    ]
    assert (
        change["before"]["value"],
        change["after"]["value"],
        change["after"]["high"],
    ) == (0, 1, None)
    assert read_model(out).card.name == "tuned"
