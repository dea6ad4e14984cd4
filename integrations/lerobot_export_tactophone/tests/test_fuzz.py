"""Random changes of a data set's files and of a log crash no reader of them."""

import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from lerobot_export_tactophone.export import count_frames, read_fingers, read_info

from tactophone.core.errors import TactophoneError
from tests.fuzz import TARGETS
from tests.fuzz.__main__ import attack
from tests.fuzz.file_targets import chosen, file_run
from tests.fuzz.target import Run, Target

pyarrow = pytest.importorskip("pyarrow")

CRASHES = Path(__file__).parent / "data/crashes/robot_frames"
SMOKE = 1.0
"""Seconds of random inputs for each reader."""


def robot_frames() -> tuple[Sequence[bytes], Run]:
    """The files of a robot's data set: its table of features, and the head of its
    frames."""
    from pyarrow import parquet

    buffer = io.BytesIO()
    frames = {
        "timestamp": np.zeros(30, np.float32),
        "episode_index": np.zeros(30, np.int64),
    }
    parquet.write_table(pyarrow.table(frames), buffer)
    info = json.dumps({"codebase_version": "v3.0", "fps": 30, "features": {}}).encode()
    runs = [
        file_run("meta/info.json", lambda path: read_info(path.parents[1])),
        file_run("frames.parquet", lambda path: count_frames([path])),
    ]
    return [b"\0" + info, b"\1" + buffer.getvalue()], chosen(runs)


def logs() -> tuple[Sequence[bytes], Run]:
    seeds, _ = TARGETS["logs"].prepare()
    return seeds, file_run("log.mcap", read_fingers)


@pytest.mark.parametrize("path", sorted(CRASHES.iterdir()), ids=lambda path: path.stem)
def test_an_input_that_once_crashed_is_refused_in_words(path: Path) -> None:
    _, run = robot_frames()
    with pytest.raises(TactophoneError):
        run(path.read_bytes())


@pytest.mark.parametrize("prepare", [robot_frames, logs])
def test_random_inputs_crash_no_reader(
    prepare: Callable[[], tuple[Sequence[bytes], Run]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    target = Target(prepare, (TactophoneError,))
    assert attack(prepare.__name__, target, SMOKE, seed=1) == 0
