"""Reading a run's telemetry regularly, in a thread of the process that watches."""

import threading
from typing import Self

from tactophone.telemetry.watcher import Watcher

READ_INTERVAL = 0.2
"""Seconds between two reads: telemetry keeps the newest 2.7 s of vibration, and far more steps and predictions."""


class RunFollower:
    """Calls `read` every `READ_INTERVAL` and once at the end; a context manager within which the run goes on."""

    def __init__(self, name: str) -> None:
        self.watcher = Watcher(name)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._follow, name="telemetry-follower", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.read()

    def read(self) -> None:
        """Process what is new in ``self.watcher``."""
        raise NotImplementedError

    def _follow(self) -> None:
        while not self._ended.wait(READ_INTERVAL):
            self.read()
