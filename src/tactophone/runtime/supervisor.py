"""Runs one side of the live system in a process of its own, and supervises it.

Everything that computes beside the sound (terminal, logs, supervision) stays out of the process with the audio
callback: a busy Python thread there delays the callback through the interpreter lock. A process that dies or is killed
by the watchdog is replaced by a new one, which starts muted: nothing restores vibration by itself.
"""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Self, TypeAlias

from tactophone.devices import disconnect_from_jack
from tactophone.errors import TactophoneError
from tactophone.processes import Child, Parent, orphaned
from tactophone.runtime.priority import MAIN_PRIORITY, GarbageCollection, prioritize_thread, share_interpreter
from tactophone.runtime.watchdog import CHECK_INTERVAL, SILENT_TIMEOUT, StallTimeouts, Verdict, Watchdog
from tactophone.settings import Settings
from tactophone.telemetry import Watcher, remove_leftovers, remove_memory

RESTART_DELAY, LONGEST_RESTART_DELAY = 0.5, 30.0
"""Seconds between the end of a process and the next, which double with every process that lived less than
`SHORT_LIFE`."""

SHORT_LIFE = 10.0
"""Seconds under which the next process will most likely end for the same reason."""

START_TIMEOUT = 20.0
"""Seconds that a process may spend at its start without any progress: neither a message nor processor time."""

LONGEST_START = 300.0
"""Seconds that a start may take in all; compiling the simulation on a busy machine takes one minute."""

SLOW_START = 5.0
"""Seconds between two lines on what a slow start is at."""

END_TIMEOUT = 3.0
"""Seconds that a process may take to end in order."""


def ignore(_: str) -> None:
    """Discard a message."""


@dataclass(frozen=True, slots=True)
class ProcessInfo:
    """What a process gets at its start: the name of its run, and how many processes of the run ended before it."""

    name: str
    restarts: int = 0
    progress: Callable[[str], None] = ignore
    """Called with what the process does next, while it starts."""


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
        self._main, self._settings, self._report = main, settings, report
        self._child: Child | None = None
        self._began = 0.0
        self._restart_delay = RESTART_DELAY
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
        """Of the current process; 0 before the first."""
        return self._child.pid if self._child else 0

    def wait(self, timeout: float) -> bool:
        """Wait up to ``timeout`` s for the side to end by itself; true when it has."""
        return self._ended.wait(timeout)

    def stop_emergency(self) -> None:
        """Send the emergency stop as a signal, which needs no free thread in the process."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGUSR1)

    def _begin(self) -> None:
        if self._child:
            self._child.close()
        # A bare function, as `self` holds a thread and cannot be sent to another process.
        self._child = Child(_run, self._main, self._settings, self.name, self.restarts, name=self.name)
        self._began = time.monotonic()

    def _await_start(self) -> None:
        """Wait for the first telemetry as long as the process makes progress; its error is raised here."""
        child, doing, failure = self._child, "importing", "it ended"
        if child is None:
            return
        began = progressed = shown = time.monotonic()
        used = 0
        while True:
            now = time.monotonic()
            alive = child.alive  # asked first: what it told before its end is then read below
            for kind, doing in child.messages():
                if kind in ("error", "bug"):
                    raise TactophoneError(doing)
                progressed = now
            if not alive:
                if not child.how_ended():
                    return  # its sound was so short that it has ended already
                break
            if (watcher := self._watcher()) and watcher.pulse().beat > 0:
                return
            if (ticks := _processor_time(child.pid)) != used:
                used, progressed = ticks, now
            if now - progressed > START_TIMEOUT:
                failure = f"no progress within {START_TIMEOUT:g} s"
                break
            if now - began > LONGEST_START:
                failure = f"not done within {LONGEST_START:g} s"
                break
            if now - shown >= SLOW_START:
                shown = now
                self._report(f"{self.name}: starting for {now - began:.0f} s, now {doing}")
            time.sleep(0.02)
        raise TactophoneError(f"{self.name} did not start: {failure}; it was last {doing}")

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
        child, watcher = self._child, self._watcher()
        watchdog = Watchdog(_timeouts(self._settings))
        while child and not self._ended.wait(CHECK_INTERVAL):
            if not child.alive:
                failures = [text for kind, text in child.messages() if kind in ("error", "bug")]
                how = child.how_ended()
                return failures[-1] if how and failures else how
            if watcher is None:
                watcher = self._watcher()
            elif self._settings.process.watchdog and not self._tolerates(watchdog, watcher):
                # It may be stopped in the middle of a period, where it could take no note of any gentler word.
                child.kill()
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

    def _watcher(self) -> Watcher | None:
        with contextlib.suppress(TactophoneError):
            watcher = Watcher(self.name)
            return watcher if watcher.pid == self.pid else None
        return None

    def _end(self) -> None:
        if self._child:
            self._child.terminate()
            self._child.end(END_TIMEOUT)
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


def _run(parent: Parent, main: Main, settings: Settings, name: str, restarts: int) -> None:
    main(settings, ProcessInfo(name, restarts, progress=lambda text: parent.tell(("progress", text))))


def _processor_time(pid: int) -> int:
    """Return the clock ticks that a process has used (Linux; elsewhere 0: only its messages count as progress)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return int(fields[11]) + int(fields[12])
    except (OSError, IndexError, ValueError):
        return 0


def _timeouts(settings: Settings) -> StallTimeouts:
    """Use the short timeout only with a real actuator: a stalled file harms nobody, and a busy machine may be late."""
    if settings.output.actuator in ("file", "none"):
        return StallTimeouts(vibrating=SILENT_TIMEOUT)
    return StallTimeouts(vibrating=settings.process.stall_timeout)


class Side(Protocol):
    """The operator's or the robot's side, set up."""

    ended: threading.Event

    def housekeep(self, now: float) -> None:
        """Apply requests and update telemetry; ``now`` is in s of the monotonic clock."""


def run_housekeeping(side: Side, *, terminated: threading.Event, interval: float, priority: int) -> None:
    """Do a side's housekeeping every ``interval`` seconds, until it or its parent process ends or it is ``terminated``.

    Call it in the main thread of the side's process. ``priority`` is that of the whole process, which the main thread
    does not exceed.
    """
    garbage = GarbageCollection(time.monotonic())
    share_interpreter()
    prioritize_thread(min(MAIN_PRIORITY, priority))
    while not (terminated.is_set() or side.ended.is_set() or orphaned()):
        now = time.monotonic()
        side.housekeep(now)
        garbage.collect(now)
        side.ended.wait(interval)
