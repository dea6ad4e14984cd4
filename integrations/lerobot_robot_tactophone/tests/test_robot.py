import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lerobot_robot_tactophone import NOTHING, Felt, slip_magnitude

from tactophone import HapticCommand, Prediction, TactophoneError, Touch
from tactophone.live.log.reader import Passed
from tactophone.live.telemetry.writer import Telemetry


def passed(
    made: float,
    roughness: float = 0.8,
    finger: str = "index",
    level_dbfs: float = -20.0,
) -> Passed:
    prediction = Prediction(
        probabilities=(0.1, 0.2, 0.7),
        touch=Touch.ROUGH,
        roughness=roughness,
        start=0.0,
        end=0.1,
        level_dbfs=level_dbfs,
    )
    times = made, made, made
    return Passed(
        finger, prediction, HapticCommand(0.4, 120.0, made), *times, computed=made
    )


def test_the_newest_values_of_the_finger_are_read() -> None:
    arrived = [passed(9.98, 0.1), passed(9.99, 0.8), passed(10.0, 0.3, "thumb")]
    felt = Felt("none", "index", read=lambda: arrived, clock=lambda: 10.0)
    assert felt.values() == {
        "touch": 2.0,
        "contact": 1.0,
        "slip": 0.875,
        "roughness": 0.8,
        "level_dbfs": -20.0,
        "amplitude": 0.4,
    }


@pytest.mark.parametrize(
    ("touch", "level_dbfs", "slip"),
    [
        (Touch.NONE, -10.0, 0.0),
        (Touch.SMOOTH, -90.0, 0.0),
        (Touch.SMOOTH, -50.0, 0.5),
        (Touch.ROUGH, 0.0, 1.0),
        (Touch.ROUGH, -np.inf, 0.0),
    ],
)
def test_slip_grows_with_the_level_in_contact_and_is_nothing_without(
    touch: Touch, level_dbfs: float, slip: float
) -> None:
    probabilities = (0.1, 0.2, 0.7)
    prediction = Prediction(probabilities, touch, 0.7, level_dbfs, 0.0, 0.1)
    assert slip_magnitude(prediction) == slip


def test_nothing_is_felt_before_the_first_prediction_and_after_a_run_has_ended() -> (
    None
):
    now, arrived = [10.0], []
    felt = Felt(
        "none",
        "index",
        read=lambda: [arrived.pop()] if arrived else [],
        clock=lambda: now[0],
    )
    assert felt.values() == NOTHING
    arrived.append(passed(10.0))
    assert felt.values()["touch"] == 2.0
    now[0] = 10.15
    assert felt.values() == NOTHING


@pytest.mark.parametrize("by", [-100.0, 100.0])
def test_a_clock_that_is_set_neither_hides_a_touch_nor_freezes_one(by: float) -> None:
    """As NTP sets it after a boot, or the sleep of the machine."""
    newest = replace(passed(time.time() + by), computed=time.monotonic())
    felt = Felt("none", "index", read=lambda: [newest])
    assert felt.values()["touch"] == 2.0
    newest = replace(newest, computed=newest.computed - 0.2)
    assert felt.values() == NOTHING


def test_silence_is_a_finite_level() -> None:
    felt = Felt(
        "none",
        "index",
        read=lambda: [passed(10.0, level_dbfs=-np.inf)],
        clock=lambda: 10.0,
    )
    assert np.isfinite(list(felt.values().values())).all()


def robots() -> Any:
    return pytest.importorskip("lerobot.robots")


def test_lerobot_makes_the_robot_by_its_name() -> None:
    lerobot = robots()
    from lerobot.utils.errors import DeviceNotConnectedError

    config = lerobot.RobotConfig.get_choice_class("tactophone")(run="test-robot-1")
    robot = lerobot.make_robot_from_config(config)
    with pytest.raises(TactophoneError):
        robot.connect()
    with pytest.raises(DeviceNotConnectedError):
        robot.get_observation()
    with Telemetry("test-robot-1"):
        robot.connect()
        assert set(robot.get_observation()) == set(robot.observation_features)
        robot.disconnect()


def test_lerobots_recorder_keeps_what_each_episode_felt(tmp_path: Path) -> None:
    """The loop of `lerobot-record` itself, with a teleoperator that does nothing."""
    lerobot = robots()
    os.environ["HF_HUB_OFFLINE"] = "1"
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.datasets.utils import hw_to_dataset_features
    from lerobot.scripts import lerobot_record as recorder
    from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

    class Still(Teleoperator):
        """Does nothing."""

        config_class, name, action_features, feedback_features = (
            TeleoperatorConfig,
            "still",
            None,
            None,
        )
        is_connected = is_calibrated = True

        def __init__(self) -> None: ...

        def __del__(self) -> None: ...

        def connect(self, calibrate: bool = True) -> None: ...

        def calibrate(self) -> None: ...

        def configure(self) -> None: ...

        def get_action(self) -> dict[str, Any]:
            return {}

        def send_feedback(self, feedback: dict[str, Any]) -> None: ...

        def disconnect(self) -> None: ...

    config = lerobot.RobotConfig.get_choice_class("tactophone")(run="test-robot-2")
    robot, episode = lerobot.make_robot_from_config(config), [0.9]
    with Telemetry("test-robot-2"):
        robot.connect()
        features = hw_to_dataset_features(robot.observation_features, "observation")
        dataset = LeRobotDataset.create(
            "local/robot", 30, features, root=tmp_path / "robot", use_videos=False
        )
        robot._felt = Felt(
            "none", "index", read=lambda: [passed(10.0, episode[0])], clock=lambda: 10.0
        )
        steps = recorder.make_default_processors()
        for roughness in (0.9, 0.1):
            episode[0] = roughness
            recorder.record_loop(
                robot,
                {"exit_early": False},
                30,
                *steps,
                dataset=dataset,
                teleop=Still(),
                control_time_s=0.5,
                single_task="feel",
            )
            dataset.save_episode()
        dataset.finalize()
    read = LeRobotDataset("local/robot", root=tmp_path / "robot")
    assert read.meta.features["observation.state"]["names"] == [
        f"finger.{name}" for name in NOTHING
    ]
    place_of_roughness = list(NOTHING).index("roughness")
    rows = [read[place] for place in range(len(read))]
    assert len(rows) > 20
    for row in rows:
        assert float(row["observation.state"][place_of_roughness]) == pytest.approx(
            (0.9, 0.1)[int(row["episode_index"])]
        )
