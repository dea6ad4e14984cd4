"""A robot's data set, a recorded run, and the verb without an installation."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactophone.cli.verbs import all_verbs
from tests.entry_points import write_metadata
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model

ROBOT = Path(__file__).parent / "data/robot"
"""A small LeRobotDataset v3.0, written by lerobot 0.4.4 itself (``make.py`` beside it):
three episodes of two joints and a camera."""


@pytest.fixture(scope="session", autouse=True)
def _entry_points(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Register what the package's ``pyproject.toml`` names, as its wheel would."""
    folder = tmp_path_factory.mktemp("registered")
    write_metadata(Path(__file__).parents[1], folder)
    sys.path.insert(0, str(folder))
    all_verbs.cache_clear()
    yield
    sys.path.remove(str(folder))
    all_verbs.cache_clear()


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mcap")
    folder = tmp_path_factory.mktemp("run")
    return record(folder / "run.mcap", write_tiny_model(folder / "tiny.onnx"))


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return Path(shutil.copytree(ROBOT, tmp_path / "robot"))
