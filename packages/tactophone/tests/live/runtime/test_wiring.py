from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.settings import Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, Touch
from tactophone.live.runtime.wiring import microphone_faults, open_microphone_check
from tactophone.signal.perception.fallback import FallbackDetector
from tactophone.signal.pipeline import open_pipeline_for
from tests.signal.perception.test_calibration_file import CALIBRATION


def calibrated(folder: Path) -> Settings:
    CALIBRATION.write(folder / "finger.toml")
    return change(Settings(), [f"detector.calibration={folder / 'finger.toml'}"])


def noise(seconds: float, levels: tuple[float, float]) -> AudioBlock:
    samples = (
        np.random.default_rng(0).normal(0, 1, (int(seconds * LIVE_SAMPLE_RATE), 2))
        * levels
    )
    return AudioBlock(samples.astype(np.float32), LIVE_SAMPLE_RATE)


def test_a_calibration_sets_the_threshold_and_a_setting_goes_before_it(
    tmp_path: Path,
) -> None:
    settings = change(
        calibrated(tmp_path), ["detector.contact=level"]
    )  # bands follow the noise instead
    # The default model's contact rule is `banded`, the paper's network's is `rms`.
    assert (
        open_pipeline_for(settings, channels=2).detector.threshold.dbfs
        == CALIBRATION.banded_dbfs
    )
    paper = change(settings, ["detector.model=paper"])
    assert (
        open_pipeline_for(paper, channels=2).detector.threshold.dbfs
        == CALIBRATION.threshold_dbfs
    )
    louder = change(settings, ["detector.threshold_dbfs=-10"])
    assert open_pipeline_for(louder, channels=2).detector.threshold.dbfs == -10


@pytest.mark.parametrize("channels", [1, 2])
def test_the_margin_of_a_robots_motion_reaches_the_gate_and_a_setting_goes_before_it(
    channels: int, tmp_path: Path
) -> None:
    def margin(*changes: str) -> float:
        detector = open_pipeline_for(
            change(settings, list(changes)), channels=channels
        ).detector
        assert isinstance(detector, FallbackDetector)
        assert detector.floor
        return detector.floor.margin_db

    calibration = replace(
        CALIBRATION,
        margin_db=6.5,
        floor_dbfs=CALIBRATION.floor_dbfs[:channels],
        hum_dbfs=CALIBRATION.hum_dbfs[:channels],
        stroke_dbfs=CALIBRATION.stroke_dbfs[:channels],
        peak_dbfs=CALIBRATION.peak_dbfs[:channels],
    )
    calibration.write(tmp_path / "finger.toml")
    settings = change(Settings(), [f"detector.calibration={tmp_path / 'finger.toml'}"])
    assert margin() == 6.5
    assert margin("detector.margin_db=8") == 8.0


def test_a_calibration_of_two_microphones_is_not_taken_for_one(tmp_path: Path) -> None:
    own = open_pipeline_for(Settings(), channels=1).detector.threshold.dbfs
    assert (
        open_pipeline_for(calibrated(tmp_path), channels=1).detector.threshold.dbfs
        == own
    )


def test_a_dead_microphone_is_reported_with_its_consequence_and_silenced(
    tmp_path: Path,
) -> None:
    pipeline = open_pipeline_for(calibrated(tmp_path), channels=2)
    step = pipeline.push(noise(2.0, (0.0, 0.1)))
    (fault,) = microphone_faults(pipeline.detector)
    assert fault.code == "contact-dead"
    assert fault.text.endswith("(nothing is rendered)")
    assert {
        prediction.touch for prediction in step.predictions if prediction.end > 1
    } == {Touch.NONE}
    assert {command.amplitude for command in step.commands if command.time > 1} == {0.0}


def test_the_robot_reports_microphone_faults_before_the_codec(tmp_path: Path) -> None:
    check = open_microphone_check(calibrated(tmp_path), channels=2)
    assert check is not None
    check.push(noise(2.0, (0.04, 0.0)))
    assert [fault.code for fault in check.faults] == ["air-dead"]


def test_a_good_set_up_has_no_faults(tmp_path: Path) -> None:
    pipeline = open_pipeline_for(calibrated(tmp_path), channels=2)
    pipeline.push(noise(2.0, (0.04, 0.001)))
    assert not list(microphone_faults(pipeline.detector))


def test_the_check_can_be_switched_off_for_test_signals() -> None:
    settings = change(Settings(), ["detector.check_microphones=false"])
    assert open_microphone_check(settings, channels=2) is None
    pipeline = open_pipeline_for(settings, channels=2)
    pipeline.push(noise(2.0, (0.0, 0.0)))
    assert not list(microphone_faults(pipeline.detector))
