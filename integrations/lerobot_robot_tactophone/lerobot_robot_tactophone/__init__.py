"""A LeRobot plug-in: a robot whose observation holds the newest values of its
fingertip.

LeRobot records them as scalars of ``observation.state``; `tactophone export-lerobot`
adds every prediction afterwards. LeRobot finds the robot by importing this package.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from tactophone import Prediction, Touch
from tactophone.live.log.reader import Passed, PredictionReader

FRESH = 0.1
"""Seconds after which a value is no longer that of this moment: a run that ends leaves
no frozen touch."""

NOTHING = {
    "touch": 0.0,
    "contact": 0.0,
    "slip": 0.0,
    "roughness": 0.0,
    "level_dbfs": -200.0,
    "amplitude": 0.0,
}
"""The values of no contact and of silence."""

QUIETEST_SLIP_DBFS = -90.0
"""Level of the contact microphone at which the slip magnitude is 0. As in the picture
of ``lerobot_camera_tactophone``, where it is black."""

LOUDEST_SLIP_DBFS = -10.0
"""Level at which the slip magnitude is 1."""


def slip_magnitude(prediction: Prediction) -> float:
    """Return how strongly the fingertip slides, 0 to 1; 0 without contact.

    A contact microphone hears sliding, and neither force nor a touch at rest. So this
    is the level of what it hears, on a scale of decibels: it grows with speed, force
    and roughness alike, and no two fingers or surfaces share its unit.
    """
    if prediction.touch == Touch.NONE:
        return 0.0
    scale = LOUDEST_SLIP_DBFS - QUIETEST_SLIP_DBFS
    return min(max((prediction.level_dbfs - QUIETEST_SLIP_DBFS) / scale, 0.0), 1.0)


class Felt:
    """The newest values of a finger of a run; ``read`` and ``clock`` (s of the
    monotonic clock) are replaced in tests."""

    def __init__(
        self,
        run: str,
        finger: str,
        *,
        read: Callable[[], list[Passed]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._read, self._clock = read or PredictionReader(run).read, clock
        self._finger, self._newest = finger, None

    def values(self) -> dict[str, float]:
        """Return the values of this moment, those of `NOTHING` where none is known."""
        for passed in self._read():
            self._newest = passed if passed.finger == self._finger else self._newest
        newest = self._newest
        if newest is None or self._clock() - newest.computed > FRESH:
            return dict(NOTHING)
        found = newest.prediction
        level = max(found.level_dbfs, NOTHING["level_dbfs"])
        return {
            "touch": float(found.touch),
            "contact": float(found.touch != Touch.NONE),
            "slip": slip_magnitude(found),
            "roughness": found.roughness,
            "level_dbfs": level,
            "amplitude": newest.command.amplitude,
        }


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
