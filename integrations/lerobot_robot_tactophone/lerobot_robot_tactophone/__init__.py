"""A LeRobot plug-in: your robot, whose observation also holds the fingertip's newest values.

`lerobot-record --robot.type=tactophone --robot.run=NAME` writes them as scalars of `observation.state`: it cannot write
arrays at our rate today, which `tactophone export lerobot` adds afterwards. NAME is that of a run, as
`tactophone status` lists it. Replace `Arm` by the class of your robot.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lerobot.robots import Robot, RobotConfig

from tactophone import Watcher

FELT = ("touch", "roughness", "level_dbfs", "amplitude")


@RobotConfig.register_subclass("tactophone")
@dataclass
class TactophoneConfig(RobotConfig):
    """The run to read."""

    run: str = "loopback"


class Tactophone(Robot):
    """A fingertip alone; add your robot's joints to each method."""

    config_class = TactophoneConfig
    name = "tactophone"

    def __init__(self, config: TactophoneConfig) -> None:
        super().__init__(config)
        self.config, self._watcher = config, None

    @cached_property
    def observation_features(self) -> dict[str, type]:
        """A number for each value."""
        return {f"finger.{name}": float for name in FELT}

    @cached_property
    def action_features(self) -> dict[str, type]:
        """A fingertip does nothing."""
        return {}

    @property
    def is_connected(self) -> bool:
        """Whether the run was found."""
        return self._watcher is not None

    def connect(self, calibrate: bool = True) -> None:
        """Find the run."""
        self._watcher = Watcher(self.config.run)

    @property
    def is_calibrated(self) -> bool:
        """There is nothing to calibrate."""
        return True

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing."""

    def get_observation(self) -> dict[str, Any]:
        """Return the newest values; zeros before the first."""
        self._watcher.follow(drain=False)
        rows, _ = self._watcher.predictions()
        newest = rows[-1] if len(rows) else dict.fromkeys(FELT, 0.0)
        return {f"finger.{name}": float(newest[name]) for name in FELT}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Do nothing."""
        return action

    def disconnect(self) -> None:
        """Let the run go."""
        self._watcher = None
