from pathlib import Path

import numpy as np
import pytest

from tactophone import ModelError
from tactophone.training.network.checkpoint import Checkpoint, load, save


def made(steps: int = 3) -> Checkpoint:
    return Checkpoint("this run", steps, {"layer1.weight": np.ones((2, 3), np.float32)})


def test_what_is_saved_is_loaded_and_nothing_else_is_left(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", made(3))
    save(tmp_path / "a.npz", made(4))
    read = load(tmp_path / "a.npz", identity="this run")
    assert read is not None
    assert read.steps == 4
    assert np.array_equal(read.arrays["layer1.weight"], np.ones((2, 3)))
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_no_checkpoint_is_no_error(tmp_path: Path) -> None:
    assert load(tmp_path / "a.npz", identity="this run") is None


def test_another_runs_checkpoint_is_refused(tmp_path: Path) -> None:
    save(tmp_path / "a.npz", made())
    with pytest.raises(ModelError, match="left by a run with another recipe"):
        load(tmp_path / "a.npz", identity="that run")


@pytest.mark.parametrize("content", [b"", b"words", b"PK\x03\x04 half a file"])
def test_a_broken_checkpoint_says_what_to_do(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ModelError, match="delete it to begin anew"):
        load(tmp_path / "a.npz", identity="this run")


def test_a_pickled_checkpoint_is_not_opened(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", head=np.array([{"identity": "this run"}], dtype=object))
    with pytest.raises(ModelError, match="no checkpoint of ours"):
        load(tmp_path / "a.npz", identity="this run")
