from pathlib import Path

import pytest

from tactophone.signal.perception.model_file import read_model
from tactophone_lab.app.train import train_model
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.training.recipes import configure
from tests.folders import audiofolder


def test_a_training_on_two_data_sets_counts_the_surfaces_of_both(
    tmp_path: Path,
) -> None:
    one = open_dataset(audiofolder(tmp_path / "one"))
    other = open_dataset(audiofolder(tmp_path / "other"))
    said: list[str] = []
    out = tmp_path / "level.onnx"
    trained = train_model(configure("level"), [one, other], out, warn=said.append)
    assert trained.path == out
    assert trained.smooth + trained.rough == len(one.surfaces)
    assert read_model(out).card.training["dataset"] == "one + other"
    (warning,) = said
    assert warning.startswith("warning: 2 smooth and 2 rough surface(s) say little")


@pytest.mark.parametrize("restart", [False, True])
def test_an_unfinished_training_leaves_nothing_beside_the_model(
    tmp_path: Path, *, restart: bool
) -> None:
    out = tmp_path / "level.onnx"
    unfinished = tmp_path / "level.onnx.unfinished"
    unfinished.write_bytes(b"of an earlier run")
    dataset = open_dataset(audiofolder(tmp_path / "sound"))
    train_model(configure("level"), [dataset], out, restart=restart)
    assert not unfinished.exists()
