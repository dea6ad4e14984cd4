"""The log of a live run's predictions as CSV (`--record RUN.csv`), written from outside
the process of the run."""

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from tactophone.core.errors import ConfigError
from tactophone.core.prediction_fields import prediction_of
from tactophone.core.processes import make_private
from tactophone.core.types import ignore
from tactophone.live.telemetry.timeline import TimelineWriter
from tactophone.live.telemetry.watcher import Watcher

CSV_READ_INTERVAL = 0.2
"""Seconds between two reads: telemetry keeps the newest 2.7 s of vibration, and far
more steps and predictions."""

DISK_INTERVAL = 4
"""Reads after which the lines are brought to the disk, 0.8 s: it then lacks under 1 s
after a power failure."""


class RunFollower:
    """Calls `read` every `CSV_READ_INTERVAL` and once at the end; a context manager
    within which the run goes on."""

    def __init__(self, name: str) -> None:
        self.watcher = Watcher(name)
        self._ended = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name="run-follower", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self.read()

    def read(self) -> None:
        raise NotImplementedError

    def _run(self) -> None:
        while not self._ended.wait(CSV_READ_INTERVAL):
            self.read()


class PredictionLog(RunFollower):
    """Writes each prediction of a live run to a CSV file, from outside the run's
    process; a context manager.

    Lines are flushed at each read (`CSV_READ_INTERVAL`), and to the disk at some
    (`DISK_INTERVAL`), so a kill of either process and a power failure lose less than
    1 s. When the watchdog replaces a process, the log follows its
    successor, whose times begin at 0 again; in a new session of one process, times go
    on. A prediction without a command (it came too late, or was made on the robot) has
    ``nan`` as ``frequency`` and ``amplitude``.

    - ``name``: name of a run that exists already.
    - ``path``: the CSV file, with the columns of `TimelineWriter`.
    - ``report``: called with a message when predictions were overwritten before they
      were read, and when the file can no longer be written: the log ends then, and the
      run goes on.

    Raises `ConfigError` when the file cannot be written.
    """

    def __init__(
        self, name: str, path: Path, *, report: Callable[[str], None] = ignore
    ) -> None:
        super().__init__(name)
        self._full = False
        self._reads = 0
        self._path = path
        self._report = report
        self._writer = TimelineWriter(
            path, fingers=list(filter(None, self.watcher.finger_names()))
        )

    def __enter__(self) -> Self:
        try:
            make_private(self._path)  # it tells when something was touched
            self._writer.__enter__()
        except OSError as error:
            raise ConfigError(
                f"cannot write {self._path} ({error.strerror}): choose another --record"
            ) from error
        return super().__enter__()

    def __exit__(self, *error: Any) -> None:
        super().__exit__(*error)
        with suppress(OSError):  # reported by `read`
            self._writer.write_to_disk()
        with suppress(OSError):
            self._writer.__exit__(*error)

    def read(self) -> None:
        try:
            if not self._full:
                self._write_new()
        except OSError as error:
            self._full = True
            self._report(
                f"{self._path}: the log ends here ({error.strerror}); the run goes on"
            )

    def _write_new(self) -> None:
        self.watcher.follow()
        for finger in range(self.watcher.fingers):
            rows, missed = self.watcher.new_predictions(finger=finger)
            if missed:
                until = f" before {rows[0]['window_end']:.3f} s" if len(rows) else ""
                self._report(
                    f"{self._path}: {missed} predictions{until} are missing, "
                    "as they were not read in time"
                )
            for entry in rows:
                self._writer.write_row(*prediction_of(entry), finger=finger)
        self._writer.flush()
        self._reads += 1
        if self._reads % DISK_INTERVAL == 0:
            self._writer.write_to_disk()
