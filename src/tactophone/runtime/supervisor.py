"""Runs one side of the live system in a process of its own, and supervises it.

Everything that computes beside the sound (terminal, logs, supervision) stays out of the process with the audio
callback: a busy Python thread there delays the callback through the interpreter lock. A process that dies or is killed
by the watchdog is replaced by a new one, which starts muted: nothing restores vibration by itself.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Self, TypeAlias

from tactophone.config import Settings
from tactophone.errors import TactophoneError
from tactophone.runtime.realtime_priority import prioritize_thread
from tactophone.runtime.watchdog import CHECK_INTERVAL, SILENT_TIMEOUT, StallTimeouts, Watchdog
from tactophone.telemetry import Watcher

RESTART_DELAY = 0.5
"""Seconds between the end of a process and the next."""

START_TIMEOUT = 20.0
"""Seconds that a process may take to import, open its devices and report."""

END_TIMEOUT = 3.0
"""Seconds that a process may take to end in order."""


@dataclass(frozen=True, slots=True)
class ProcessInfo:
    """What a process gets at its start: the name of its run, and how many processes of the run ended before it."""

    name: str
    restarts: int = 0
    parent: int = 0

    @property
    def orphaned(self) -> bool:
        """Whether the supervising process is gone, so that this one should end too."""
        return self.parent != 0 and os.getppid() != self.parent


Main: TypeAlias = Callable[[Settings, ProcessInfo], None]
"""One side of the live system: runs until SIGTERM, or until its sound ends. Must be importable by a new process."""


class Supervisor:
    """Runs one side in its own process; a context manager.

    Attributes
    ----------
    restarts
        Number of new processes that had to be started.
    """

    def __init__(self, main: Main, settings: Settings, *, name: str) -> None:
        self.name = name
        self.restarts = 0
        self._main, self._settings = main, settings
        self._process: SpawnProcess | None = None
        self._errors: Connection | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def __enter__(self) -> Self:
        self._begin()
        try:
            self._await_start()
        except BaseException:
            self._end()
            raise
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._end()

    @property
    def running(self) -> bool:
        """Whether the side runs or will be restarted; false once its sound has ended."""
        return not self._ended.is_set()

    @property
    def pid(self) -> int:
        """Of the current process."""
        return (self._process.pid or 0) if self._process else 0

    def wait(self, timeout: float) -> bool:
        """Wait up to ``timeout`` s for the side to end by itself; true when it has."""
        return self._ended.wait(timeout)

    def stop_emergency(self) -> None:
        """Send the emergency stop as a signal, which needs no free thread in the process."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGUSR1)

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._errors, errors = context.Pipe(duplex=False)
        info = ProcessInfo(self.name, self.restarts, os.getpid())
        self._process = context.Process(
            target=_run, args=(self._main, self._settings, info, errors), name=self.name, daemon=True
        )
        self._process.start()
        errors.close()

    def _await_start(self) -> None:
        """Wait for the first telemetry; an error raised before it is raised here."""
        until = time.monotonic() + START_TIMEOUT
        while time.monotonic() < until:
            if self._errors is not None and self._errors.poll():
                raise TactophoneError(self._errors.recv())
            if self._process is None or not self._process.is_alive():
                break
            with contextlib.suppress(TactophoneError):
                watcher = Watcher(self.name)
                if watcher.pid == self.pid and watcher.pulse().beat > 0:
                    return
            time.sleep(0.02)
        raise TactophoneError(
            f"{self.name} did not start within {START_TIMEOUT:g} s: see its messages, or try again on an idle machine"
        )

    def _watch(self) -> None:
        """Supervise the process, and its successors, until the side ends."""
        # If this is refused, the network thread has warned already.
        prioritize_thread(self._settings.process.priority)
        while not self._ended.is_set():
            if not self._watch_process():
                self._ended.set()
                return
            if self._ended.wait(RESTART_DELAY):
                return
            self.restarts += 1
            self._begin()

    def _watch_process(self) -> bool:
        """Watch one process; true when it died or was killed, and another should start."""
        process = self._process
        if process is None:
            return False
        watcher = self._watcher()
        watchdog = Watchdog(_timeouts(self._settings))
        while not self._ended.wait(CHECK_INTERVAL):
            if not process.is_alive():
                return process.exitcode != 0
            if watcher is None:
                watcher = self._watcher()
            elif self._settings.process.watchdog and watchdog.check(watcher.pulse(), now=time.monotonic()):
                process.kill()
                process.join()
                return True
        return False

    def _watcher(self) -> Watcher | None:
        with contextlib.suppress(TactophoneError):
            watcher = Watcher(self.name)
            return watcher if watcher.pid == self.pid else None
        return None

    def _end(self) -> None:
        process = self._process
        if process is None:
            return
        process.terminate()
        process.join(END_TIMEOUT)
        if process.is_alive():
            process.kill()
            process.join()


def _run(main: Main, settings: Settings, info: ProcessInfo, errors: Connection) -> None:
    """Run the side in the new process: an expected error is passed on in one line, a bug is a traceback."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent handles the keyboard interrupt
    try:
        main(settings, info)
    except TactophoneError as error:
        errors.send(str(error))
        raise SystemExit(1) from None


def _timeouts(settings: Settings) -> StallTimeouts:
    """Use the short timeout only with a real actuator: a stalled file harms nobody, and a busy machine may be late."""
    if settings.output.actuator in ("file", "none"):
        return StallTimeouts(vibrating=SILENT_TIMEOUT)
    return StallTimeouts(vibrating=settings.process.stall_timeout)
