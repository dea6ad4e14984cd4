"""The time of day is set in the middle of a run: by NTP after a boot, by hand, or by a
machine that slept."""

import json
import time
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
from tactophone.live.log import log_topics
from tactophone.live.log.reader import PredictionReader, RunReader
from tactophone.live.telemetry.writer import Telemetry

real_time = time.time


@pytest.fixture
def telemetry(request: pytest.FixtureRequest) -> Iterator[Telemetry]:
    with Telemetry(f"test-clock-{abs(hash(request.node.name))}") as telemetry:
        yield telemetry


def publish(telemetry: Telemetry, end: float, made: float) -> None:
    found = Prediction((0.1, 0.2, 0.7), Touch.ROUGH, 0.75, -20.0, end - 0.1, end)
    silence = AudioBlock(np.zeros((1, 1), np.float32), 48_000)
    step = PipelineStep(silence, (found,), (HapticCommand(0.5, 60.0, made),))
    telemetry.publish(step, now=made)


def set_clock(monkeypatch: pytest.MonkeyPatch, by: float) -> None:
    monkeypatch.setattr(time, "time", lambda: real_time() + by)


@pytest.mark.parametrize("by", [-100.0, 0.5, 1e6])
def test_a_bridges_stamps_follow_and_stay_even(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch, by: float
) -> None:
    reader = PredictionReader(telemetry.name)
    began = time.monotonic()
    epoch = real_time() - began
    publish(telemetry, 0.0, began + 0.005)
    (before,) = reader.read()
    set_clock(monkeypatch, by)
    publish(telemetry, 0.01, began + 0.040)
    (after,) = reader.read()
    assert after.made - epoch - by == pytest.approx(began + 0.040, abs=1e-3)
    # The delay of the first, 5 ms, is still the least that was seen.
    assert after.sound - before.sound == pytest.approx(0.01 + by, abs=1e-3)


@pytest.mark.parametrize("by", [-100.0, 100.0])
def test_the_age_of_a_command_is_told_by_a_clock_that_is_never_set(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch, by: float
) -> None:
    reader = PredictionReader(telemetry.name)
    set_clock(monkeypatch, by)
    made = time.monotonic()
    publish(telemetry, 0.0, made)
    (passed,) = reader.read()
    assert passed.computed == made
    (ended,) = reader.silenced()
    assert made <= ended.computed <= time.monotonic()


def test_a_log_goes_on_by_the_clock_it_began_with_and_says_so_once(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader = RunReader(telemetry.name)
    reader.read()
    set_clock(monkeypatch, 3600.0)
    publish(telemetry, 0.0, time.monotonic())
    messages = reader.read() + reader.read()
    (said,) = [
        json.loads(message.data)
        for message in messages
        if message.topic == log_topics.EVENTS
    ]
    assert (
        "clock was set: it is +3600.0 s from the times of this log" in said["message"]
    )
    for message in messages:
        assert message.time == pytest.approx(real_time(), abs=5.0)
