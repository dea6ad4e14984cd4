import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from tactophone.errors import DatasetError
from tactophone.telemetry.prediction_log import COLUMNS, TimelineWriter, read_timeline
from tactophone.types import AudioBlock, HapticCommand, PipelineStep, Prediction, Touch

BLOCK = AudioBlock(np.zeros((1, 1), np.float32), 48_000)


def tick(count: int) -> PipelineStep:
    beliefs = [Prediction((0.2, 0.3, 0.5), Touch(n % 3), 0.6, -20.0, n / 10, n / 10 + 0.256) for n in range(count)]
    return PipelineStep(BLOCK, tuple(beliefs), tuple(HapticCommand(0.5, 75.0, one.end + 0.003) for one in beliefs))


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with TimelineWriter(path) as timeline:
        timeline.write(tick(4))
        timeline.write(tick(0))
    columns = read_timeline(path)
    assert set(columns) == set(COLUMNS)
    assert columns["touch"].tolist() == [0, 1, 2, 0]
    assert columns["contact"].tolist() == [0, 1, 1, 0]
    np.testing.assert_allclose(columns["time"], [0.259, 0.359, 0.459, 0.559])


@pytest.mark.parametrize("count", [0, 1, 5])
def test_json_holds_the_same(tmp_path: Path, count: int) -> None:
    with TimelineWriter(tmp_path / "a.csv", json_path=tmp_path / "a.json") as timeline:
        timeline.write(tick(count))
    lines = list(csv.DictReader((tmp_path / "a.csv").open()))
    entries = json.loads((tmp_path / "a.json").read_text())
    assert [{name: str(value) for name, value in entry.items()} for entry in entries] == lines


def test_no_level_at_all_is_null_in_json(tmp_path: Path) -> None:
    silent = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, 0.0, 0.256)
    with TimelineWriter(tmp_path / "a.csv", json_path=tmp_path / "a.json") as timeline:
        timeline.write(PipelineStep(BLOCK, (silent,), (HapticCommand(0.0, 120.0, 0.26),)))
    assert json.loads((tmp_path / "a.json").read_text())[0]["level_dbfs"] is None
    assert read_timeline(tmp_path / "a.csv")["level_dbfs"][0] == -math.inf


def test_another_csv_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "metadata.csv"
    path.write_text("file_name,label\na.wav,rough\n")
    with pytest.raises(DatasetError, match="no timeline of ours"):
        read_timeline(path)
