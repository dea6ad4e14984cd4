"""A LeRobot plug-in: a robot whose observation holds the newest values of its
fingertip.

LeRobot records them as scalars of ``observation.state``; `tactophone export lerobot`
adds every prediction afterwards. LeRobot finds the robot by importing this package.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from tactophone.live.log.reader import Passed, PredictionReader

FRESH = 0.1
"""Seconds after which a value is no longer that of this moment: a run that ends leaves
no frozen touch."""

NOTHING = {"touch": 0.0, "roughness": 0.0, "level_dbfs": -200.0, "amplitude": 0.0}
"""The values of no contact and of silence."""


class Felt:
    """The newest values of a finger of a run; ``read`` and ``clock`` (s since 1970) are
    replaced in tests."""

    def __init__(
        self,
        run: str,
        finger: str,
        *,
        read: Callable[[], list[Passed]] | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._read, self._clock = read or PredictionReader(run).read, clock
        self._finger, self._newest = finger, None

    def values(self) -> dict[str, float]:
        """Return the values of this moment, those of `NOTHING` where none is known."""
        for passed in self._read():
            self._newest = passed if passed.finger == self._finger else self._newest
        newest = self._newest
        if newest is None or self._clock() - newest.made > FRESH:
            return dict(NOTHING)
        found = newest.prediction
        level = max(found.level_dbfs, NOTHING["level_dbfs"])
        values = float(found.touch), found.roughness, level, newest.command.amplitude
        return dict(zip(NOTHING, values, strict=True))


with suppress(ModuleNotFoundError):
    from lerobot.robots import Robot, RobotConfig
    from lerobot.utils.errors import DeviceNotConnectedError

    @RobotConfig.register_subclass("tactophone")
    @dataclass
    class TactophoneConfig(RobotConfig):
        """``run`` is the name of a run (``tactophone status``); a run of one finger
        calls it ``index``."""

        run: str = "loopback"
        finger: str = "index"

    class Tactophone(Robot):
        """A fingertip alone; add the joints of your robot to each method, or its class
        as a base."""

        config_class = TactophoneConfig
        name = "tactophone"

        def __init__(self, config: TactophoneConfig) -> None:
            super().__init__(config)
            self.config = config
            self._felt: Felt | None = None

        @cached_property
        def observation_features(self) -> dict[str, type]:
            return {f"finger.{name}": float for name in NOTHING}

        @cached_property
        def action_features(self) -> dict[str, type]:
            return {}

        @property
        def is_connected(self) -> bool:
            return self._felt is not None

        def connect(self, calibrate: bool = True) -> None:
            """Find the run; raises ``tactophone.TactophoneError`` where there is
            none."""
            self._felt = Felt(self.config.run, self.config.finger)

        @property
        def is_calibrated(self) -> bool:
            return True

        def calibrate(self) -> None: ...

        def configure(self) -> None: ...

        def get_observation(self) -> dict[str, Any]:
            """Return the values of this moment."""
            if self._felt is None:
                raise DeviceNotConnectedError(
                    "the fingertip is not connected: call connect() first"
                )
            return {
                f"finger.{name}": value for name, value in self._felt.values().items()
            }

        def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
            return action

        def disconnect(self) -> None:
            self._felt = None
