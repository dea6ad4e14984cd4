"""A small LeRobotDataset v3.0: three episodes of two joints and a camera, written by
lerobot 0.4.4 itself."""

import shutil
from pathlib import Path

import pytest

FPS, FRAMES = 30, 45


def robot_data(root: Path) -> Path:
    """Copy the data set; skips where pyarrow is missing."""
    pytest.importorskip("pyarrow")
    return Path(
        shutil.copytree(Path(__file__).parents[4] / "tests/data/lerobot/robot", root)
    )
