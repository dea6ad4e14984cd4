from pathlib import Path

import numpy as np
import pytest

from tactophone import ModelError
from tactophone.training.network.checkpoint import Checkpoint, load, save


def make_checkpoint(steps: int = 3) -> Checkpoint:
    return Checkpoint("this run", steps, {"layer1.weight": np.ones((2, 3), np.float32)})


def test_a_saved_checkpoint_loads_and_leaves_no_other_file(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", make_checkpoint(3))
    save(tmp_path / "a.npz", make_checkpoint(4))
    read = load(tmp_path / "a.npz", identity="this run")
    assert read is not None
    assert read.steps == 4
    assert np.array_equal(read.arrays["layer1.weight"], np.ones((2, 3)))
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_missing_checkpoint_is_not_an_error(tmp_path: Path) -> None:
    assert load(tmp_path / "a.npz", identity="this run") is None


def test_checkpoint_of_another_run_is_refused(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", make_checkpoint())
    with pytest.raises(ModelError, match="left by a run with another recipe"):
        load(tmp_path / "a.npz", identity="that run")


@pytest.mark.parametrize("content", [b"", b"words", b"PK\x03\x04 half a file"])
def test_a_broken_checkpoint_says_what_to_do(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ModelError, match="delete it to start over"):
        load(tmp_path / "a.npz", identity="this run")


def test_a_pickled_checkpoint_is_not_opened(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", head=np.array([{"identity": "this run"}], dtype=object))
    with pytest.raises(ModelError, match="not a checkpoint of Tactophone"):
        load(tmp_path / "a.npz", identity="this run")
