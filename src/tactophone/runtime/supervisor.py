"""Runs one side of the live system in a process of its own, and supervises it.

Everything that computes beside the sound (terminal, logs, supervision) stays out of the process with the audio
callback: a busy Python thread there delays the callback through the interpreter lock. A process that dies or is killed
by the watchdog is replaced by a new one, which starts muted: nothing restores vibration by itself.
"""

import contextlib
import dataclasses
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from typing import Self, TypeAlias

from tactophone.child_processes import ChildContext, ChildProcess
from tactophone.devices import disconnect_from_jack
from tactophone.errors import TactophoneError
from tactophone.runtime.realtime_priority import prioritize_thread
from tactophone.runtime.start_progress import StartProgress
from tactophone.runtime.watchdog import CHECK_INTERVAL, SILENT_TIMEOUT, StallTimeouts, Verdict, Watchdog
from tactophone.settings import Settings
from tactophone.telemetry import Watcher, remove_leftovers, remove_memory

RESTART_DELAY, LONGEST_RESTART_DELAY = 0.5, 30.0
"""Seconds between the end of a process and the next, which double with every process that lived less than
`SHORT_LIFE`."""

SHORT_LIFE = 10.0
"""Seconds under which the next process will most likely end for the same reason."""

END_TIMEOUT = 3.0
"""Seconds that a process may take to end in order."""


def ignore(_: str) -> None:
    """Discard a message."""


@dataclass(frozen=True, slots=True)
class ProcessInfo:
    """What a process gets at its start: the name of its run, and how many processes of the run ended before it."""

    name: str
    restarts: int = 0
    parent: int = 0
    progress: Callable[[str], None] = ignore
    """Called with what the process does next, while it starts."""

    @property
    def orphaned(self) -> bool:
        """Whether the supervising process is gone, so that this one should end too."""
        return self.parent != 0 and os.getppid() != self.parent


Main: TypeAlias = Callable[[Settings, ProcessInfo], None]
"""One side of the live system: runs until SIGTERM, or until its sound ends. Must be importable by a new process."""


class Supervisor:
    """Runs one side in its own process; a context manager.

    ``report`` is called with a line for people: why a process is restarted, or what a slow start is at; from another
    thread.

    Attributes
    ----------
    restarts
        Number of new processes that had to be started.
    """

    def __init__(self, main: Main, settings: Settings, *, name: str, report: Callable[[str], None] = ignore) -> None:
        self.name = name
        self.restarts = 0
        self._report = report
        self._began = 0.0
        self._restart_delay = RESTART_DELAY
        self._main, self._settings = main, settings
        self._process: ChildProcess | None = None
        self._messages: Connection | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def __enter__(self) -> Self:
        self.begin()
        self.await_start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._thread.is_alive():
            self._thread.join()
        self._end()

    def begin(self) -> None:
        """Start the process without waiting for it; `await_start` has to follow."""
        remove_leftovers()
        self._begin()

    def await_start(self) -> None:
        """Wait until the process runs, and supervise it from then on.

        Raises `TactophoneError` when it does not start; the process has ended then.
        """
        try:
            self._await_start()
        except BaseException:
            self._end()
            raise
        self._thread.start()

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
        context = ChildContext()
        if self._messages is not None:
            self._messages.close()
        self._messages, messages = context.Pipe(duplex=False)
        info = ProcessInfo(self.name, self.restarts, os.getpid())
        self._process = context.Process(
            target=_run, args=(self._main, self._settings, info, messages), name=self.name, daemon=True
        )
        self._process.start()
        self._began = time.monotonic()
        messages.close()

    def _await_start(self) -> None:
        """Wait for the first telemetry as long as the process makes progress; its error is raised here."""
        start = StartProgress(self.pid, now=time.monotonic())
        while start.goes_on(time.monotonic()):
            for error, text in self._read_messages():
                if error:
                    raise TactophoneError(text)
                start.note(text, now=time.monotonic())
            if self._process is None or not self._process.is_alive():
                if self._process and self._process.exitcode == 0:
                    return  # its sound was so short that it has ended already
                break
            with contextlib.suppress(TactophoneError):
                watcher = Watcher(self.name)
                if watcher.pid == self.pid and watcher.pulse().beat > 0:
                    return
            if line := start.slow_line(time.monotonic()):
                self._report(f"{self.name}: {line}")
            time.sleep(0.02)
        for error, text in self._read_messages():
            if error:
                raise TactophoneError(text)
        raise TactophoneError(f"{self.name} did not start: {start.failure}; it was last {start.doing}")

    def _read_messages(self) -> Iterator[tuple[bool, str]]:
        """Yield what the process has sent: whether it is the error that ended it, and its text."""
        with contextlib.suppress(EOFError, OSError):
            while self._messages is not None and self._messages.poll():
                yield self._messages.recv()

    def _watch(self) -> None:
        """Supervise the process, and its successors, until the side ends."""
        # If this is refused, the network thread has warned already.
        prioritize_thread(self._settings.process.priority)
        while not self._ended.is_set():
            reason = self._watch_process()
            if not reason:
                self._ended.set()
                return
            if self._ended.is_set():
                return
            lived = time.monotonic() - self._began
            self._restart_delay = (
                min(2 * self._restart_delay, LONGEST_RESTART_DELAY)
                if lived < SHORT_LIFE and self.restarts
                else RESTART_DELAY
            )
            self._report(f"! {self.name} ended ({reason}) and starts again in {self._restart_delay:g} s")
            if self._ended.wait(self._restart_delay):
                return
            self.restarts += 1
            self._begin()

    def _watch_process(self) -> str:
        """Watch one process; returns why it ended and another should start, empty when none should."""
        process = self._process
        if process is None:
            return ""
        watcher = self._watcher()
        watchdog = Watchdog(_timeouts(self._settings))
        while not self._ended.wait(CHECK_INTERVAL):
            if not process.is_alive():
                return self._reason(process.exitcode or 0)
            if watcher is None:
                watcher = self._watcher()
            elif self._settings.process.watchdog and not self._tolerates(watchdog, watcher):
                process.kill()
                process.join()
                return "the watchdog found it stalled"
        return ""

    def _tolerates(self, watchdog: Watchdog, watcher: Watcher) -> bool:
        """Check the pulse once; a process that is late at vibrating is silenced from outside, if it can be."""
        match watchdog.check(watcher.pulse(), now=time.monotonic()):
            case Verdict.LATE:
                if self._settings.output.actuator != "jack" or not disconnect_from_jack(self.pid):
                    return False
                # It stays, and goes on by itself once it can: it joins the JACK server again and waits for fresh sound.
                self._report(f"! {self.name} was late and is silent until it goes on")
            case Verdict.STALLED:
                return False
        return True

    def _reason(self, exitcode: int) -> str:
        """Return why the process ended, empty for an orderly end."""
        if not exitcode:
            return ""
        errors = [text for error, text in self._read_messages() if error]
        with contextlib.suppress(ValueError):
            return errors[-1] if errors else f"signal {signal.Signals(-exitcode).name}"
        return f"exit code {exitcode}"

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
        remove_memory(self.name)


@contextlib.contextmanager
def supervised(*sides: Supervisor) -> Iterator[tuple[Supervisor, ...]]:
    """Start several sides at once, which takes as long as one does, and wait for all; ends them, the last first."""
    with contextlib.ExitStack() as stack:
        for side in sides:
            stack.push(side)
            side.begin()
        for side in sides:
            side.await_start()
        yield sides


def _run(main: Main, settings: Settings, info: ProcessInfo, messages: Connection) -> None:
    """Run the side in the new process: an expected error is passed on in one line, a bug is a traceback."""
    try:
        main(settings, dataclasses.replace(info, progress=partial(_send, messages, False)))
    except TactophoneError as error:
        _send(messages, True, str(error))
        raise SystemExit(1) from None
    except Exception as error:
        _send(messages, True, f"{type(error).__name__}: {error}")
        raise


def _send(messages: Connection, error: bool, text: str) -> None:
    """Send a message to the supervisor, if it still listens."""
    with contextlib.suppress(OSError):
        messages.send((error, text))


def _timeouts(settings: Settings) -> StallTimeouts:
    """Use the short timeout only with a real actuator: a stalled file harms nobody, and a busy machine may be late."""
    if settings.output.actuator in ("file", "none"):
        return StallTimeouts(vibrating=SILENT_TIMEOUT)
    return StallTimeouts(vibrating=settings.process.stall_timeout)
