from pathlib import Path

import numpy as np

from tactophone.config import Settings, change
from tactophone.runtime.wiring import SAMPLE_RATE, open_pipeline_for, open_watch, sensor_faults
from tactophone.types import AudioBlock, Touch
from tests.perception.sensor_health.test_calibration_file import CALIBRATION


def calibrated(folder: Path) -> Settings:
    CALIBRATION.write(folder / "finger.toml")
    return change(Settings(), [f"judge.calibration={folder / 'finger.toml'}"])


def noise(seconds: float, levels: tuple[float, float]) -> AudioBlock:
    samples = np.random.default_rng(0).normal(0, 1, (int(seconds * SAMPLE_RATE), 2)) * levels
    return AudioBlock(samples.astype(np.float32), SAMPLE_RATE)


def test_a_calibration_sets_the_threshold_and_a_setting_goes_before_it(tmp_path: Path) -> None:
    settings = calibrated(tmp_path)
    assert open_pipeline_for(settings, channels=2).judge.threshold_dbfs == CALIBRATION.threshold_dbfs
    louder = change(settings, ["judge.threshold_dbfs=-10"])
    assert open_pipeline_for(louder, channels=2).judge.threshold_dbfs == -10


def test_a_calibration_of_two_microphones_is_not_taken_for_one(tmp_path: Path) -> None:
    own = open_pipeline_for(Settings(), channels=1).judge.threshold_dbfs
    assert open_pipeline_for(calibrated(tmp_path), channels=1).judge.threshold_dbfs == own


def test_a_dead_microphone_is_named_with_what_is_done_and_not_felt(tmp_path: Path) -> None:
    walk = open_pipeline_for(calibrated(tmp_path), channels=2)
    tick = walk.push(noise(2.0, (0.0, 0.1)))
    (fault,) = sensor_faults(walk.judge)
    assert fault.code == "contact-dead"
    assert fault.text.endswith("(nothing is felt)")
    assert {belief.touch for belief in tick.predictions if belief.end > 1} == {Touch.NONE}
    assert {command.amplitude for command in tick.commands if command.time > 1} == {0.0}


def test_the_robot_names_what_is_wrong_where_it_is_heard(tmp_path: Path) -> None:
    watch = open_watch(calibrated(tmp_path), channels=2)
    assert watch is not None
    watch.push(noise(2.0, (0.04, 0.0)))
    assert [fault.code for fault in watch.faults] == ["air-dead"]


def test_a_good_set_up_has_nothing_to_say(tmp_path: Path) -> None:
    walk = open_pipeline_for(calibrated(tmp_path), channels=2)
    walk.push(noise(2.0, (0.04, 0.001)))
    assert not list(sensor_faults(walk.judge))


def test_the_watch_can_be_left_out_for_test_signals() -> None:
    settings = change(Settings(), ["judge.watch=false"])
    assert open_watch(settings, channels=2) is None
    walk = open_pipeline_for(settings, channels=2)
    walk.push(noise(2.0, (0.0, 0.0)))
    assert not list(sensor_faults(walk.judge))
