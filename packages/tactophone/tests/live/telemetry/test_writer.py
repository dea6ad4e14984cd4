import time
import uuid
from collections.abc import Iterator

import numpy as np
import pytest

from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.live.telemetry.layout import (
    COUNTERS,
    SOUND_CAPACITY,
    Fault,
    FingerState,
    RunState,
)
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry

PREDICTION = Prediction(
    (0.1, 0.2, 0.7), Touch.ROUGH, roughness=0.75, level_dbfs=-20.0, start=0.0, end=0.256
)


@pytest.fixture
def telemetry() -> Iterator[Telemetry]:
    with Telemetry(f"test-{uuid.uuid4().hex[:8]}") as telemetry:
        yield telemetry


def step(size: int = 120, *, start: int = 0, predicted: bool = True) -> PipelineStep:
    block = AudioBlock(
        np.arange(2 * size, dtype=np.float32).reshape(size, 2) + start,
        sample_rate=48_000,
        start=start,
    )
    return (
        PipelineStep(block, (PREDICTION,), (HapticCommand(0.5, 60.0, 0.0),))
        if predicted
        else PipelineStep(block, (), ())
    )


def test_a_step_contains_prediction_and_command(telemetry: Telemetry) -> None:
    telemetry.publish(step(), now=1.0, truth=Touch.ROUGH)
    row = Watcher(telemetry.name).snapshot().steps[0]
    assert row["time"] == pytest.approx(120 / 48_000)
    assert [row[name] for name in ("none", "smooth", "rough")] == pytest.approx(
        [0.1, 0.2, 0.7]
    )
    assert (row["touch"], row["truth"], row["sound_end"]) == (2, 2, 120)
    assert (row["amplitude"], row["frequency"]) == (0.5, 60.0)


def test_a_step_without_a_prediction_repeats_the_last(telemetry: Telemetry) -> None:
    telemetry.publish(step(predicted=False), now=1.0)
    telemetry.publish(step(), now=1.0)
    telemetry.publish(step(predicted=False), now=1.0)
    steps = Watcher(telemetry.name).snapshot().steps
    assert np.isnan([steps[0][name] for name in ("none", "smooth", "rough")]).all()
    assert steps[2]["roughness"] == steps[1]["roughness"] == 0.75
    assert telemetry.counter("predictions") == 1


def test_mono_sound_fills_both_channels(telemetry: Telemetry) -> None:
    block = AudioBlock(np.ones((10, 1), np.float32), sample_rate=48_000)
    telemetry.publish(PipelineStep(block, (), ()), now=0.0)
    assert Watcher(telemetry.name).snapshot().sound.tolist() == [[1.0, 1.0]] * 10


@pytest.mark.parametrize("size", [1, 17, 480, 509, 20_000])
def test_the_vibration_is_read_as_written(telemetry: Telemetry, size: int) -> None:
    total = SOUND_CAPACITY + 50_000 if size > 100 else 3_000
    waveform = np.arange(total, dtype=np.float32)
    for start in range(0, total, size):
        telemetry.rendered(waveform[start : start + size])
    snapshot = Watcher(telemetry.name).snapshot()
    assert snapshot.vibration_end == total
    np.testing.assert_array_equal(
        snapshot.vibration, waveform[total - len(snapshot.vibration) :]
    )
    assert len(snapshot.vibration) >= min(total, 96_000)


def test_the_mailbox_is_emptied_in_the_order_of_the_requests(
    telemetry: Telemetry,
) -> None:
    watcher = Watcher(telemetry.name)
    watcher.ask("ceiling", 0.5)
    watcher.ask("ceiling", 0.25)
    watcher.ask("arm")
    watcher.ask("profile", text="paper")
    requests = telemetry.requests()
    assert [request.action for request in requests] == ["ceiling", "arm", "profile"]
    assert (requests[0].value, requests[2].text) == (0.25, "paper")
    assert telemetry.requests() == []


def test_a_request_is_forgotten_after_ten_seconds_unless_it_silences(
    telemetry: Telemetry,
) -> None:
    """A process that stood still obeys a stop, however long it waited."""
    watcher = Watcher(telemetry.name)
    for action in ("arm", "stop", "mute"):
        watcher.ask(action)
    watcher.ask("ceiling", 0.5)
    later = telemetry.requests(now=time.monotonic() + 60.0)
    assert [request.action for request in later] == ["stop", "mute"]


def test_an_unknown_counter_raises(telemetry: Telemetry) -> None:
    with pytest.raises(KeyError):
        telemetry.count("packets_eaten")


def test_the_state_is_published_with_a_heartbeat(telemetry: Telemetry) -> None:
    telemetry.update(
        RunState(
            fingers=(FingerState(armed=True),),
            faults=(Fault("link", "no sound from the robot"),),
        ),
        now=5.0,
    )
    snapshot = Watcher(telemetry.name).snapshot()
    assert snapshot.state.armed
    assert snapshot.state.faults[0].code == "link"


def test_counters_start_at_zero_and_gauges_at_nan(telemetry: Telemetry) -> None:
    snapshot = Watcher(telemetry.name).snapshot()
    assert set(snapshot.counters.values()) == {0}
    assert list(snapshot.counters) == list(COUNTERS)
    assert all(np.isnan(value) for value in snapshot.gauges.values())


def test_more_faults_than_there_is_room_for_end_no_run(telemetry: Telemetry) -> None:
    """A robot chooses what the microphones of ten fingers sound like."""
    faults = tuple(
        Fault("microphones", f"{number}: " + "ä" * 99) for number in range(90)
    )
    telemetry.update(RunState("operator", faults=faults), now=0.0)
    shown = Watcher(telemetry.name).state().faults
    assert shown[:20] == faults[:20]
    assert shown[-1].text == f"and {len(faults) - len(shown) + 1} more"
    telemetry.update(RunState("operator", link="x" * 20_000), now=0.0)
    assert Watcher(telemetry.name).state().role == "operator"
