import subprocess
import sys
import time
import uuid
from collections.abc import Iterator

import numpy as np
import pytest

from tactophone.core.types import AudioBlock, HapticCommand, PipelineStep
from tactophone.live.telemetry.layout import (
    LOG_CAPACITY,
    MARKS,
    FingerState,
    RunState,
)
from tactophone.live.telemetry.records import EventBatch, read_records, write_record
from tactophone.live.telemetry.watcher import Watcher, _newest
from tactophone.live.telemetry.writer import Telemetry

WRITER = """
import sys, time
import numpy as np
from tactophone.live.telemetry.layout import MARKS, RunState
from tactophone.live.telemetry.writer import Telemetry
from tactophone.core.types import AudioBlock, HapticCommand, PipelineStep

ends = time.monotonic() + float(sys.argv[2])
with Telemetry(sys.argv[1]) as telemetry:
    print("up", flush=True)
    n = 0
    while time.monotonic() < ends:
        n += 1
        sound = np.full((32, 2), n % 65536 / 65536, np.float32)
        block = AudioBlock(sound, sample_rate=32, start=32 * (n - 1))
        command = HapticCommand(n % 65536, n % 65536, 0.0)
        telemetry.publish(PipelineStep(block, (), (command,)), now=time.monotonic())
        state = RunState(source="x" * (n % 1000), sample_rate=n % 1000)
        telemetry.update(state, now=time.monotonic())
"""


@pytest.fixture
def telemetry() -> Iterator[Telemetry]:
    with Telemetry(f"test-{uuid.uuid4().hex[:8]}") as telemetry:
        yield telemetry


@pytest.mark.parametrize("count", [5, 1_000, 1_003, 48_000 * 604_800, (1 << 62) - 1])
def test_a_ring_is_read_at_once_however_long_the_run(count: int) -> None:
    """After a week of samples, each read took a third of a second; with a count from
    overwritten memory, for ever."""
    rows = np.arange(1_000)
    newest, end = _newest(rows, np.array([count], np.uint64), slack=10, since=count - 7)
    assert end == count
    assert newest.tolist() == [(count + k) % 1_000 for k in range(-min(7, count), 0)]


@pytest.mark.slow
def test_nothing_torn_is_ever_read_while_another_process_writes() -> None:
    name = f"test-{uuid.uuid4().hex[:8]}"
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, name, "1.5"], stdout=subprocess.PIPE
    )
    assert writer.stdout is not None
    writer.stdout.readline()
    watcher, snapshots = Watcher(name), 0
    while writer.poll() is None:
        snapshot = watcher.snapshot()
        snapshots += 1
        steps = snapshot.steps
        assert (np.diff(steps["time"]) == 1.0).all()
        assert (steps["time"] % 65536 == steps["amplitude"]).all()
        assert (steps["amplitude"] == steps["frequency"]).all()
        numbers = snapshot.sound[:, 0] * 65536
        assert np.isin(np.diff(numbers), [0, 1, -65535]).all()
        assert (
            len(snapshot.state.source) == snapshot.state.sample_rate % 1000
            or not snapshot.state.source
        )
    assert snapshots > 10


def test_since_returns_only_what_is_new(telemetry: Telemetry) -> None:
    watcher = Watcher(telemetry.name)
    telemetry.rendered(np.ones(100, np.float32))
    first = watcher.snapshot()
    telemetry.rendered(np.zeros(7, np.float32))
    telemetry.publish(
        PipelineStep(
            AudioBlock(np.zeros((5, 2), np.float32), sample_rate=48_000),
            (),
            (HapticCommand(0, 60, 0),),
        ),
        now=0.0,
    )
    second = watcher.snapshot(first)
    assert (
        len(first.vibration),
        len(second.vibration),
        len(second.sound),
        len(second.steps),
    ) == (100, 7, 5, 1)
    assert len(watcher.snapshot(second).vibration) == 0


def test_a_session_log_is_whole_records_or_nothing(telemetry: Telemetry) -> None:
    watcher = Watcher(telemetry.name)
    record = EventBatch(0.0, (b"a packet",) * 100)
    encoded = b"".join(write_record(record))
    # As many as overwrite the beginning of the first one, and the middle of others.
    for _ in range(LOG_CAPACITY // len(encoded) + 7):
        telemetry.log(encoded)
    lost, total = watcher.log(0)
    assert lost == b""
    assert total > LOG_CAPACITY
    telemetry.log(encoded)
    found, _ = watcher.log(total)
    assert list(read_records(found)) == [record]


def test_a_run_without_a_heartbeat_is_not_alive(telemetry: Telemetry) -> None:
    watcher = Watcher(telemetry.name)
    assert not watcher.snapshot().alive
    telemetry.update(RunState(), now=time.monotonic())
    assert watcher.snapshot().alive
    telemetry.update(RunState(), now=time.monotonic() - 2.0)
    assert not watcher.snapshot().alive
    assert watcher.snapshot().age >= 2.0


def test_a_text_that_does_not_fit_is_refused(telemetry: Telemetry) -> None:
    with pytest.raises(ValueError, match="longer than"):
        Watcher(telemetry.name).ask("profile", text="x" * 65)


def test_a_pulse_contains_callbacks_amplitude_and_heartbeat(
    telemetry: Telemetry,
) -> None:
    telemetry.count("callbacks", 5)
    telemetry.gauge("output_amplitude", 0.25)
    telemetry.update(RunState(), now=7.0)
    pulse = Watcher(telemetry.name).pulse()
    assert (pulse.callbacks, pulse.amplitude, pulse.beat) == (5, 0.25, 7.0)


def test_marks_are_kept_by_kind_newest_last(telemetry: Telemetry) -> None:
    for index in range(5000):
        telemetry.mark((MARKS.index("sent"), 120 * index, float(index)))
    telemetry.mark((MARKS.index("detected"), 7, 1.0))
    sent = Watcher(telemetry.name).marks("sent")
    assert sent[-1].tolist() == (120 * 4999, 4999.0)
    assert (np.diff(sent["position"]) == 120).all()
    assert len(sent) > 4000
    assert Watcher(telemetry.name).marks("detected").tolist() == [(7, 1.0)]


def test_each_finger_has_its_own_rows_and_requests() -> None:
    name = f"test-{uuid.uuid4().hex[:8]}"
    block = AudioBlock(np.zeros((5, 2), np.float32), sample_rate=48_000)
    with Telemetry(name, fingers=3) as telemetry:
        watcher = Watcher(name)
        telemetry.publish(
            PipelineStep(block, (), (HapticCommand(0.5, 60, 0),), 2),
            now=time.monotonic(),
        )
        telemetry.rendered(np.ones(7, np.float32), finger=1)
        snapshots = [watcher.snapshot(finger=finger) for finger in range(3)]
        assert watcher.fingers == 3
        assert [
            (len(each.steps), len(each.sound), len(each.vibration))
            for each in snapshots
        ] == [
            (0, 0, 0),
            (0, 0, 7),
            (1, 5, 0),
        ]
        watcher.ask("mute", finger=1)
        watcher.ask("ceiling", 0.2)
        watcher.ask("ceiling", 0.3, finger=2)
        found = {
            (request.action, request.value, request.finger)
            for request in telemetry.requests()
        }
        assert found == {("mute", 0.0, 1), ("ceiling", 0.2, -1), ("ceiling", 0.3, 2)}


def test_the_state_of_a_hand_names_its_fingers() -> None:
    fingers = (
        FingerState("thumb", armed=True, ceiling=0.5),
        FingerState("index", ceiling=0.1),
    )
    thumb, index = RunState.parse(bytes(RunState(fingers=fingers))).fingers
    assert (index.ceiling, index.armed, thumb.armed) == (0.1, False, True)


@pytest.mark.parametrize("drain", [True, False])
def test_a_watcher_follows_the_process_that_replaced_its_own(drain: bool) -> None:
    with Telemetry("test-follow") as first:
        watcher = Watcher("test-follow")
        first.count("xruns", 2)
        assert not watcher.follow(drain=drain)
    assert not watcher.follow(drain=drain)  # ended, and nobody has come
    with Telemetry("test-follow"):
        before = watcher.snapshot()
        if drain:
            assert not watcher.follow()
            # The last values of the dead process can still be read.
            assert watcher.totals()[0]["xruns"] == 2
        assert watcher.follow(drain=drain)
        assert (watcher.restarts, watcher.totals()[0]["xruns"]) == (1, 0)
        assert watcher.snapshot(before).restarts == 1
