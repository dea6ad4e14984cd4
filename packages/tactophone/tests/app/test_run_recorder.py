import time
from pathlib import Path

import numpy as np
import pytest

from tactophone.app.vibration_wav import RunRecorder
from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.live.telemetry.prediction_log import PredictionLog
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.live.telemetry.writer import Telemetry


def step(k: int) -> PipelineStep:
    block = AudioBlock(np.zeros((480, 2), np.float32), 48_000, start=480 * k)
    prediction = Prediction(
        (0.1, 0.2, 0.7), Touch.ROUGH, 0.78, -20.0, start=0.0, end=block.end / 48_000
    )
    return PipelineStep(
        block, (prediction,), (HapticCommand(0.5, 70.0, prediction.end),)
    )


def test_vibration_and_predictions_are_recorded_on_the_time_of_the_sound(
    tmp_path: Path,
) -> None:
    log = tmp_path / "timeline.csv"
    with (
        Telemetry("test-recorder") as telemetry,
        PredictionLog("test-recorder", log),
        RunRecorder("test-recorder") as recorder,
    ):
        telemetry.rendered(np.zeros(4800, np.float32))
        for k in range(10):
            telemetry.publish(step(k), now=time.monotonic())
            telemetry.rendered(np.full(480, 0.25, np.float32))
    lines = read_timeline(log)
    assert len(lines["time"]) == 10
    assert lines["touch"].tolist() == [Touch.ROUGH] * 10
    assert np.diff(lines["time"]) == pytest.approx(0.01)
    assert len(recorder.vibration(sample_rate=48_000)) == pytest.approx(4800, abs=480)
