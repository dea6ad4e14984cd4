"""A run beside a robot's frames, written and read back by the description of LeRobotDataset v3.0."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.live.log.mcap import LogEnd, read_messages
from tests.app.robot_data import FPS, FRAMES, robot_data
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model

pytest.importorskip("mcap")
parquet = pytest.importorskip("pyarrow.parquet")
pandas = pytest.importorskip("pandas")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lerobot")
    return record(folder / "run.mcap", write_tiny_model(folder / "tiny.onnx"))


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    return robot_data(tmp_path / "robot")


def read_episode(root: Path, episode: int) -> "pandas.DataFrame":
    """Read as LeRobot's documentation describes it, with nothing of ours."""
    info = json.loads((root / "meta/info.json").read_text())
    rows = pandas.concat(map(pandas.read_parquet, (root / "meta/episodes").rglob("*.parquet")))
    row = rows[rows["episode_index"] == episode].iloc[0]
    path = info["data_path"].format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
    return parquet.read_table(root / path, filters=[("episode_index", "=", episode)]).to_pandas()


def test_every_prediction_stands_beside_the_frames_of_its_episode(log: Path, dataset: Path, tmp_path: Path) -> None:
    original = (dataset / "data/chunk-000/file-000.parquet").read_bytes()
    out = tmp_path / "felt"
    assert main(["export", "lerobot", str(log), "--with", str(dataset), "--out", str(out), "--episode", "1"]) == 0
    logged = [
        (message.time, json.loads(message.data))
        for message in read_messages(log)
        if not isinstance(message, LogEnd) and message.topic.name == "/tactophone/prediction"
    ]
    info = json.loads((out / "meta/info.json").read_text())
    base = "observation.tactile.index"
    (size,) = info["features"][f"{base}.roughness"]["shape"]
    assert 3 <= size <= 12
    felt, other = read_episode(out, 1), read_episode(out, 0)
    assert len(felt) == len(other) == FRAMES
    assert np.array_equal(felt["observation.state"], np.sin(np.arange(FRAMES, 2 * FRAMES) / 10).astype(np.float32))
    assert not np.any(np.stack(other[f"{base}.valid"]))
    lead = min(time - entry["window_end"] for time, entry in logged)
    begin = lead + logged[0][1]["window_end"]
    times = begin + felt["timestamp"].to_numpy(float)[:, None] - np.stack(felt[f"{base}.age"]).astype(float)
    assert np.all(np.stack(felt[f"{base}.age"]) >= 0)  # nothing of a frame's future
    found = {
        (round(float(time), 3), round(float(rough), 4))
        for time, rough in zip(times.ravel(), np.stack(felt[f"{base}.rough"]).ravel(), strict=True)
    }
    until = begin + (FRAMES - 1) / FPS
    expected = {
        (round(lead + entry["window_end"], 3), round(entry["rough"], 4))
        for _, entry in logged
        if lead + entry["window_end"] < until
    }
    near = {(round(time + step / 1000, 3), rough) for time, rough in found for step in (-1, 0, 1)}
    assert len(expected) > 100
    assert not expected - near
    stats = json.loads((out / "meta/stats.json").read_text())
    assert set(stats[f"{base}.roughness"]) == {"min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"}
    (sound,) = (out / "raw_audio").rglob("*.wav")
    assert sound.relative_to(out).as_posix() == "raw_audio/observation.audio.index/episode_000001.wav"
    assert soundfile.info(sound).subtype == "FLOAT"
    assert info["tactophone"]["audio"][sound.relative_to(out).as_posix()]["sample_rate"] == 48_000
    assert (dataset / "data/chunk-000/file-000.parquet").read_bytes() == original
    assert "tactophone" not in json.loads((dataset / "meta/info.json").read_text())
    assert (out / "videos/front/chunk-000/file-000.mp4").read_bytes() == b"a film"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--start", "5"], "covers no frame of episode 0"),
        (["--with", "nowhere"], "no LeRobot data set"),
        (["--out", "."], "exists already"),
    ],
)
def test_what_does_not_fit_is_one_line(
    log: Path, dataset: Path, tmp_path: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["export", "lerobot", str(log), "--with", str(dataset), "--out", str(tmp_path / "out"), *words]
    assert main(command) == 1
    assert message in capsys.readouterr().err


def test_lerobot_itself_opens_it(log: Path, dataset: Path, tmp_path: Path) -> None:
    pytest.importorskip("lerobot")
    os.environ["HF_HUB_OFFLINE"] = "1"
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    assert main(["export", "lerobot", str(log), "--with", str(dataset), "--out", str(tmp_path / "felt")]) == 0
    opened = LeRobotDataset("local/felt", root=tmp_path / "felt")
    assert opened[10]["observation.tactile.index.roughness"].ndim == 1
