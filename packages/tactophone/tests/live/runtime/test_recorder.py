"""What packets leave for watchers is written later, in order and complete."""

import uuid
from collections.abc import Iterator

import numpy as np
import pytest

from tactophone.core.settings import Settings, change
from tactophone.core.types import AudioBlock, PipelineStep, Prediction, Touch
from tactophone.live.runtime.recorder import (
    LONGEST_DEFERRAL,
    SessionRecorder,
    describe_run,
)
from tactophone.live.telemetry.layout import MARKS
from tactophone.live.telemetry.records import (
    Controls,
    EventBatch,
    RunStart,
    read_records,
    write_record,
)
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.link.events import PacketReceived

Run = tuple[SessionRecorder, Watcher]


@pytest.fixture
def run() -> Iterator[Run]:
    name = f"test-deferred-{uuid.uuid4().hex[:8]}"
    with Telemetry(name) as telemetry:
        yield SessionRecorder(telemetry, Settings(), role="operator"), Watcher(name)


def step(number: int, *touches: Touch) -> PipelineStep:
    block = AudioBlock(
        np.full((120, 2), number / 100, np.float32), 48_000, 120 * number
    )
    probabilities = (0.2, 0.3, 0.5)
    return PipelineStep(
        block,
        tuple(
            Prediction(probabilities, touch, 0.5, -20.0, 0.0, 0.1) for touch in touches
        ),
        (),
    )


def test_nothing_is_written_at_once_and_then_all_in_order(run: Run) -> None:
    recorder, watcher = run
    for number in range(10):
        assert not recorder.due(1.0)
        recorder.mark(120 * number, (MARKS.index("decoded"), 1.0 + number / 1e4))
        recorder.publish(step(number), now=1.0)
    assert watcher.snapshot().step_end == 0
    assert recorder.due(1.0 + LONGEST_DEFERRAL + 1e-3)
    recorder.write(lambda finger: 2)
    found = watcher.snapshot()
    assert found.steps["sound_end"].tolist() == [
        120 * (number + 1) for number in range(10)
    ]
    assert set(found.steps["truth"].tolist()) == {2}
    assert found.sound[::120, 0] == pytest.approx(
        [number / 100 for number in range(10)]
    )
    assert watcher.marks("decoded")["position"].tolist() == [
        120 * number for number in range(10)
    ]
    assert not recorder.due(2.0)


def test_nothing_waits_for_long_and_a_prediction_not_at_all(run: Run) -> None:
    recorder, _ = run
    recorder.publish(step(0), now=1.0)
    assert not recorder.due(1.0)
    assert recorder.due(1.0 + LONGEST_DEFERRAL + 1e-3)
    recorder.write()
    recorder.publish(step(1, Touch.ROUGH), now=2.0)
    assert recorder.due(2.0)
    recorder.write()
    recorder.publish(step(2), now=3.0)
    assert not recorder.due(3.0)


def test_the_session_log_keeps_the_order_of_packets_and_controls(run: Run) -> None:
    recorder, watcher = run
    for number in range(3):
        recorder.controls(True, 0.5, 1.0, "paper", -40.0 + (number == 2))
        recorder.arrival(float(number), [PacketReceived(bytes([number]), report=False)])
    assert not recorder.due(5.0)
    assert recorder.due(5.0 + LONGEST_DEFERRAL + 1e-3)
    recorder.write()
    _, *records = read_records(watcher.log()[0])
    assert [type(record) for record in records] == [
        Controls,
        EventBatch,
        EventBatch,
        Controls,
        EventBatch,
    ]
    assert [record.time for record in records if isinstance(record, EventBatch)] == [
        0.0,
        1.0,
        2.0,
    ]


def test_more_arrivals_than_one_write_of_the_log_takes_are_all_kept(run: Run) -> None:
    recorder, watcher = run
    for number in range(20):
        recorder.arrival(float(number), [PacketReceived(bytes(10_000), report=False)])
    recorder.write()
    batches = [
        record
        for record in read_records(watcher.log()[0])
        if isinstance(record, EventBatch)
    ]
    assert [batch.time for batch in batches] == [float(number) for number in range(20)]


def test_a_file_name_that_is_no_utf8_ends_no_log() -> None:
    settings = change(Settings(), ["capture.device=/tmp/s\udcff.wav"])
    record = describe_run(settings, role="robot")
    (kept,) = read_records(b"".join(write_record(record)))
    assert isinstance(kept, RunStart)
    assert kept.settings["capture"]["device"] == r"/tmp/s\xff.wav"
