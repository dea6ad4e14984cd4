"""One side of the line in a process of its own, and the eye that rests on it.

What computes beside the sound (terminal, logs, this watching) stays out of the process that holds the audio callback:
a busy Python thread there ruins its punctuality through the interpreter lock. A process that dies or is ended by the
watchdog is followed by a new one, which begins muted: nothing restores vibration by itself.
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
from types import TracebackType
from typing import Self, TypeAlias

from tactophone.config import Settings
from tactophone.errors import TactophoneError
from tactophone.runtime import realtime_priority as tuning
from tactophone.runtime.watchdog import LOOK_EVERY, PATIENCE, Patience, Watchdog
from tactophone.telemetry import Watcher

RESTART_DELAY = 0.5
"""Seconds between the end of a process and the next."""

START_TIMEOUT = 20.0
"""Seconds that a process may take to import, open its devices and say so."""

END_TIMEOUT = 3.0
"""Seconds that a process may take to end in order."""


@dataclass(frozen=True, slots=True)
class ProcessInfo:
    """What a process is told when it begins: under which name others watch it, and how many went before it."""

    name: str
    restarts: int = 0
    parent: int = 0

    @property
    def orphaned(self) -> bool:
        """Whether who watched over this process is gone, so that it should end too."""
        return self.parent != 0 and os.getppid() != self.parent


Main: TypeAlias = Callable[[Settings, ProcessInfo], None]
"""One side of the line: runs until SIGTERM, or until its sound ends. Must be importable by a new process."""


class Supervisor:
    """Run one side in its own process; a context manager that gives it a start and an end.

    Attributes
    ----------
    restarts
        Times that a new process had to be begun.
    """

    def __init__(self, main: Main, settings: Settings, *, name: str) -> None:
        self.name = name
        self.restarts = 0
        self._main, self._settings = main, settings
        self._process: SpawnProcess | None = None
        self._words: Connection | None = None
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._end()

    @property
    def running(self) -> bool:
        """Whether the side still runs or will again; false once its sound has come to its end."""
        return not self._ended.is_set()

    @property
    def pid(self) -> int:
        """Of the process at hand."""
        return (self._process.pid or 0) if self._process else 0

    def wait(self, timeout: float) -> bool:
        """Wait for the side to end by itself; true when it has."""
        return self._ended.wait(timeout)

    def stop_emergency(self) -> None:
        """Pass an emergency stop on, by signal: it needs no thread of the process to be free."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGUSR1)

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._words, words = context.Pipe(duplex=False)
        birth = ProcessInfo(self.name, self.restarts, os.getpid())
        self._process = context.Process(
            target=_run, args=(self._main, self._settings, birth, words), name=self.name, daemon=True
        )
        self._process.start()
        words.close()

    def _await_start(self) -> None:
        """Wait for the first sign of life; what the process raised before it is raised here."""
        until = time.monotonic() + START_TIMEOUT
        while time.monotonic() < until:
            if self._words is not None and self._words.poll():
                raise TactophoneError(self._words.recv())
            if self._process is None or not self._process.is_alive():
                break
            with contextlib.suppress(TactophoneError):
                watcher = Watcher(self.name)
                if watcher.pid == self.pid and watcher.pulse().beat > 0:
                    return
            time.sleep(0.02)
        raise TactophoneError(
            f"{self.name} did not start within {START_TIMEOUT:g} s: see what it said, or wait for a calmer machine"
        )

    def _watch(self) -> None:
        """Look after the process until somebody ends it, here or there."""
        # The network thread has warned already, if this is refused.
        tuning.prioritize_thread(self._settings.process.priority)
        while not self._ended.is_set():
            if not self._watch_one():
                self._ended.set()
                return
            if self._ended.wait(RESTART_DELAY):
                return
            self.restarts += 1
            self._begin()

    def _watch_one(self) -> bool:
        """Watch one process; true when it died or was ended, and another should begin."""
        process = self._process
        if process is None:
            return False
        watcher = self._watcher()
        watchdog = Watchdog(_patience(self._settings))
        while not self._ended.wait(LOOK_EVERY):
            if not process.is_alive():
                return process.exitcode != 0
            if watcher is None:
                watcher = self._watcher()
            elif self._settings.process.watchdog and watchdog.look(watcher.pulse(), now=time.monotonic()):
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


def _run(main: Main, settings: Settings, birth: ProcessInfo, words: Connection) -> None:
    """Be the process: one line for an error that people understand, a trace for our own mistakes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the keyboard's interrupt is the parent's to handle
    try:
        main(settings, birth)
    except TactophoneError as error:
        words.send(str(error))
        raise SystemExit(1) from None


def _patience(settings: Settings) -> Patience:
    """Be in haste only where there is a finger: a file that stalls buzzes nobody, and a busy machine may be late."""
    if settings.output.actuator in ("file", "none"):
        return Patience(vibrating=PATIENCE)
    return Patience(vibrating=settings.process.stall_timeout)
