"""The camera, as LeRobot's classes ask for it."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lerobot.cameras.camera import Camera
from lerobot.cameras.configs import CameraConfig

from lerobot_camera_tactophone.picture import SIZE, Picture, Pixels
from lerobot_camera_tactophone.sound import LiveSound, LoggedSound
from tactophone.live.telemetry.watcher import running


@CameraConfig.register_subclass("tactophone")
@dataclass(kw_only=True)
class TactophoneCameraConfig(CameraConfig):
    """``run`` is the name of a run (``tactophone status``); ``log`` is an MCAP file
    that stands for one."""

    run: str = "loopback"
    log: str = ""
    fps: int | None = 30
    width: int | None = SIZE
    height: int | None = SIZE


class TactophoneCamera(Camera):
    """Looks at what a fingertip hears."""

    def __init__(self, config: TactophoneCameraConfig) -> None:
        super().__init__(config)
        if (config.width, config.height) != (SIZE, SIZE):
            raise ValueError(
                f"{config.width} x {config.height}: the picture has {SIZE} x {SIZE}; "
                "leave both out"
            )
        self.config = config
        self._sound: LiveSound | LoggedSound | None = None
        self._due = 0.0

    @property
    def is_connected(self) -> bool:
        return self._sound is not None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        return [
            {"type": "tactophone", "id": name, "name": f"what {name} hears"}
            for name in running()
        ]

    def connect(self, warmup: bool = True) -> None:
        self._picture = Picture()
        fps = self.fps or 30
        if self.config.log:
            self._sound = LoggedSound(Path(self.config.log), self._picture, fps=fps)
        else:
            self._sound = LiveSound(
                self.config.run, self._picture, clock=time.monotonic
            )

    def read(self, *_: Any) -> Pixels:
        """Return the picture of this moment."""
        if self._sound is None:
            raise RuntimeError("the camera is not connected: call connect() first")
        self._sound.draw()
        return self._picture.rgb

    def async_read(self, timeout_ms: float = 200) -> Pixels:
        """Return the next picture, at most `fps` a second."""
        if not self.config.log:
            time.sleep(max(0.0, min(self._due - time.monotonic(), timeout_ms / 1000)))
        self._due = max(self._due, time.monotonic()) + 1 / (self.fps or 30)
        return self.read()

    def read_latest(self, max_age_ms: int = 500) -> Pixels:
        return self.read()

    def disconnect(self) -> None:
        self._sound = None
