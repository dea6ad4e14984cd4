import csv
import json
import math
import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import numpy as np
import pytest
import soundfile
from msgspec.structs import replace

from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.prediction_fields import prediction_of
from tactophone.core.types import (
    EVENT_KINDS,
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
    TouchEvent,
)
from tactophone.live.telemetry import layout, memory, prediction_log
from tactophone.live.telemetry.prediction_log import (
    CSV_READ_INTERVAL,
    DISK_INTERVAL,
    PredictionLog,
)
from tactophone.live.telemetry.timeline import (
    TIMELINE_COLUMNS,
    TimelineWriter,
    read_timeline,
    row,
)
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry

BLOCK = AudioBlock(np.zeros((1, 1), np.float32), 48_000)


def step(count: int, *, first: int = 0, commands: bool = True) -> PipelineStep:
    predictions = [
        Prediction(
            (0.2, 0.3, 0.5),
            Touch(n % 3),
            0.6,
            -20.0,
            n / 10,
            n / 10 + 0.256,
            unknown=n % 3 > 0,
        )
        for n in range(first, first + count)
    ]
    made = tuple(
        HapticCommand(0.5, 75.0, prediction.end + 0.003)
        for prediction in predictions
        if commands
    )
    return PipelineStep(BLOCK, tuple(predictions), made)


@pytest.fixture
def name() -> str:
    return f"test-{uuid.uuid4().hex[:8]}"


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    with TimelineWriter(path) as timeline:
        timeline.write(step(4))
        timeline.write(step(0))
    columns = read_timeline(path)
    assert set(columns) == set(TIMELINE_COLUMNS)
    assert columns["touch"].tolist() == [0, 1, 2, 0]
    assert columns["contact"].tolist() == [0, 1, 1, 0]
    assert columns["unknown"].tolist() == [0, 1, 1, 0]
    np.testing.assert_allclose(columns["time"], [0.259, 0.359, 0.459, 0.559])


@pytest.mark.parametrize("count", [0, 1, 5])
def test_json_holds_the_same(tmp_path: Path, count: int) -> None:
    with TimelineWriter(tmp_path / "a.csv", json_path=tmp_path / "a.json") as timeline:
        timeline.write(step(count))
    lines = list(csv.DictReader((tmp_path / "a.csv").open()))
    entries = json.loads((tmp_path / "a.json").read_text())
    assert [
        {name: str(value) for name, value in entry.items()} for entry in entries
    ] == lines


def test_a_level_of_minus_infinity_is_null_in_json(tmp_path: Path) -> None:
    silent = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, 0.0, 0.256)
    with TimelineWriter(tmp_path / "a.csv", json_path=tmp_path / "a.json") as timeline:
        timeline.write(
            PipelineStep(BLOCK, (silent,), (HapticCommand(0.0, 120.0, 0.26),))
        )
    assert json.loads((tmp_path / "a.json").read_text())[0]["level_dbfs"] is None
    assert read_timeline(tmp_path / "a.csv")["level_dbfs"][0] == -math.inf


def test_touch_events_reach_steps_predictions_and_the_log(
    tmp_path: Path, name: str
) -> None:
    plain = step(2)
    tap = replace(plain.predictions[1], events=(TouchEvent("tap", 0.31),))
    with (
        Telemetry(name) as telemetry,
        PredictionLog(name, tmp_path / "live.csv") as log,
    ):
        telemetry.publish(
            replace(plain, predictions=(plain.predictions[0], tap)), now=1.0
        )
        telemetry.publish(plain, now=1.0)
        log.read()
        watcher = Watcher(name)
        rows, _ = watcher.predictions()
        assert [prediction_of(row)[0].events for row in rows] == [
            (),
            tap.events,
            (),
            (),
        ]
        numbers = watcher.snapshot().steps["event"].tolist()
        assert numbers == [1 + EVENT_KINDS.index("tap"), 0]
    columns = read_timeline(tmp_path / "live.csv")
    assert columns["event"].tolist() == ["", "tap", "", ""]
    assert columns["event_time"][1] == 0.31


def test_a_timeline_from_before_the_events_is_read(tmp_path: Path) -> None:
    path = tmp_path / "old.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, TIMELINE_COLUMNS[:-2], extrasaction="ignore")
        writer.writeheader()
        writer.writerow(row(step(1).predictions[0], step(1).commands[0]))
    assert read_timeline(path)["event"].tolist() == [""]


def test_another_csv_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "metadata.csv"
    path.write_text("file_name,label\na.wav,rough\n")
    with pytest.raises(DatasetError, match="not a timeline"):
        read_timeline(path)


def test_a_live_log_is_the_timeline_of_the_same_steps(
    tmp_path: Path, name: str
) -> None:
    steps = [step(2), step(0), step(3, first=2)]
    with TimelineWriter(tmp_path / "offline.csv") as timeline:
        for each in steps:
            timeline.write(each)
    missed: list[str] = []
    with (
        Telemetry(name) as telemetry,
        PredictionLog(name, tmp_path / "live.csv", report=missed.append) as log,
    ):
        for each in steps:
            telemetry.publish(each, now=time.monotonic())
            log.read()
    assert (tmp_path / "live.csv").read_text() == (tmp_path / "offline.csv").read_text()
    assert (tmp_path / "live.csv").stat().st_mode & 0o777 == 0o600
    assert not missed


def test_each_read_reaches_the_disk(tmp_path: Path, name: str) -> None:
    with Telemetry(name) as telemetry, PredictionLog(name, tmp_path / "a.csv") as log:
        telemetry.publish(step(3), now=time.monotonic())
        log.read()
        assert len(read_timeline(tmp_path / "a.csv")["time"]) == 3


def test_a_power_failure_takes_less_than_a_second_of_a_log(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert CSV_READ_INTERVAL * DISK_INTERVAL < 1.0
    monkeypatch.setattr(prediction_log, "CSV_READ_INTERVAL", 1e3)
    on_disk: list[int] = []
    monkeypatch.setattr(
        os, "fsync", lambda descriptor: on_disk.append(os.fstat(descriptor).st_size)
    )
    path = tmp_path / "a.csv"
    with Telemetry(name) as telemetry, PredictionLog(name, path) as log:
        for _ in range(DISK_INTERVAL):
            telemetry.publish(step(3), now=time.monotonic())
            log.read()
        assert on_disk == [path.stat().st_size]
        telemetry.publish(step(3), now=time.monotonic())
    assert on_disk[-1] == path.stat().st_size > on_disk[0]


def test_predictions_without_a_command_have_no_amplitude(
    tmp_path: Path, name: str
) -> None:
    with Telemetry(name) as telemetry, PredictionLog(name, tmp_path / "a.csv"):
        telemetry.publish(step(2, commands=False), now=time.monotonic())
    columns = read_timeline(tmp_path / "a.csv")
    assert np.isnan(columns["amplitude"]).all()
    assert columns["time"].tolist() == columns["window_end"].tolist() == [0.256, 0.356]


def test_an_overflow_is_reported(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "tactophone.live.telemetry.prediction_log.CSV_READ_INTERVAL", 1e3
    )
    messages: list[str] = []
    total = layout.PREDICTION_CAPACITY + 100
    with (
        Telemetry(name) as telemetry,
        PredictionLog(name, tmp_path / "a.csv", report=messages.append),
    ):
        telemetry.publish(step(total), now=time.monotonic())
    written = len(read_timeline(tmp_path / "a.csv")["time"])
    # One row more is given up than must be, as the writer may be filling it.
    assert total - written == 101
    assert "101 predictions before 10.356 s are missing" in messages[0]


def test_a_replaced_process_is_followed_on(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Only this test's thread reads.
    monkeypatch.setattr(prediction_log, "CSV_READ_INTERVAL", 1e3)
    code = (
        "import os, sys; sys.path.insert(0, os.getcwd()); from "
        "tests.live.telemetry.test_prediction_log import *\n"
        "telemetry = Telemetry(sys.argv[1])\n"
        "telemetry.publish(step(2), now=1.0); print(flush=True); sys.stdin.read(1)\n"
        "telemetry.publish(step(2, first=2), now=1.0); os.kill(os.getpid(), "
        "signal.SIGKILL)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.readline()
    with PredictionLog(name, tmp_path / "a.csv") as log:
        log.read()
        process.communicate(b"x")
        with Telemetry(name) as telemetry:
            telemetry.publish(step(3), now=time.monotonic())
            log.read()
    assert read_timeline(tmp_path / "a.csv")["touch"].tolist() == [0, 1, 2, 0, 0, 1, 2]


@pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="no /dev/full on this system"
)
def test_a_full_disk_ends_the_log_with_one_line_and_not_the_run(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "tactophone.live.telemetry.prediction_log.CSV_READ_INTERVAL", 1e3
    )
    messages: list[str] = []
    with (
        Telemetry(name) as telemetry,
        PredictionLog(name, Path("/dev/full"), report=messages.append) as log,
    ):
        for _ in range(3):
            telemetry.publish(step(3), now=time.monotonic())
            log.read()
    assert messages == [
        "/dev/full: the log ends here (No space left on device); the run goes on"
    ]


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path, name: str) -> None:
    with (
        Telemetry(name),
        pytest.raises(ConfigError, match="--record"),
        PredictionLog(name, tmp_path / "no" / "a.csv"),
    ):
        pass


@pytest.mark.realtime
def test_a_killed_loopback_leaves_a_log_that_lacks_at_most_a_second(
    tmp_path: Path, name: str
) -> None:
    noise = np.random.default_rng(0).normal(0, 0.05, (48_000 * 20, 2))
    soundfile.write(tmp_path / "noise.wav", noise, 48_000)
    command = [
        sys.executable,
        "-m",
        "tactophone",
        "loopback",
        "--actuator",
        "none",
        "--name",
        name,
    ]
    command += [
        "--source",
        f"file:{tmp_path / 'noise.wav'}",
        "--record",
        str(tmp_path / "log.csv"),
    ]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as loopback:
        watcher = _wait_for(name, predictions=150)
        os.kill(watcher.pid, signal.SIGKILL)  # the process with the audio callback
        rows, count = watcher.predictions()
        loopback.kill()
    log = read_timeline(tmp_path / "log.csv")
    assert set(log) == set(TIMELINE_COLUMNS)
    assert rows["window_end"][-1] - log["window_end"][-1] < 1.0
    np.testing.assert_allclose(
        log["window_end"], rows["window_end"][: len(log["window_end"])], atol=1e-6
    )
    assert np.isfinite(log["amplitude"]).all()
    assert count >= 150


def _wait_for(name: str, *, predictions: int) -> Watcher:
    ends = time.monotonic() + 40
    while time.monotonic() < ends:
        time.sleep(0.05)
        if (memory.folder() / f"{memory.PREFIX}{name}").exists():
            watcher = Watcher(name)
            if watcher.snapshot().counters["predictions"] >= predictions:
                return watcher
    raise TimeoutError(f"{name} made fewer than {predictions} predictions in 40 s")
