"""Writes a small LeRobotDataset v3.0, as lerobot does."""

import json
from pathlib import Path

import numpy as np
import pytest

FPS, FRAMES = 30, 45


def robot_data(root: Path) -> Path:
    """Write two episodes of a robot with one joint; skips where pyarrow or pandas is missing."""
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    pandas = pytest.importorskip("pandas")
    for place in ("meta/episodes/chunk-000", "data/chunk-000", "videos/front/chunk-000"):
        (root / place).mkdir(parents=True)
    (root / "videos/front/chunk-000/file-000.mp4").write_bytes(b"a film")
    frames = np.arange(2 * FRAMES)
    columns = {
        "observation.state": np.sin(frames / 10).astype(np.float32),
        "timestamp": (frames % FRAMES / FPS).astype(np.float32),
        "frame_index": frames % FRAMES,
        "episode_index": frames // FRAMES,
        "index": frames,
        "task_index": 0 * frames,
    }
    parquet.write_table(pyarrow.table(columns), root / "data/chunk-000/file-000.parquet")
    episodes = {
        "episode_index": [0, 1], "tasks": [["feel"]] * 2, "length": [FRAMES] * 2,
        "data/chunk_index": [0, 0], "data/file_index": [0, 0],
        "dataset_from_index": [0, FRAMES], "dataset_to_index": [FRAMES, 2 * FRAMES],
    }  # fmt: skip
    parquet.write_table(pyarrow.table(episodes), root / "meta/episodes/chunk-000/file-000.parquet")
    pandas.DataFrame({"task_index": [0]}, index=pandas.Index(["feel"], name="task")).to_parquet(
        root / "meta/tasks.parquet"
    )
    features = {name: {"dtype": str(values.dtype), "shape": [1], "names": None} for name, values in columns.items()}
    info = {
        "codebase_version": "v3.0", "fps": FPS, "features": features, "total_episodes": 2, "total_frames": 2 * FRAMES,
        "total_tasks": 1, "chunks_size": 1000, "splits": {"train": "0:2"}, "robot_type": "test", "video_path": None,
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    }  # fmt: skip
    (root / "meta/info.json").write_text(json.dumps(info))
    (root / "meta/stats.json").write_text("{}")
    return root
