"""A LeRobot camera whose picture is what a fingertip heard in the last 2 s.

LeRobot finds the camera by importing this package; the picture itself needs no LeRobot.
"""

from contextlib import suppress

with suppress(ModuleNotFoundError):
    from lerobot_camera_tactophone.camera import (
        TactophoneCamera,
        TactophoneCameraConfig,
    )

__all__ = ["TactophoneCamera", "TactophoneCameraConfig"]
