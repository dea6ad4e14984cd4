"""Runs one side of the live system in a process of its own, and supervises it.

Everything that computes beside the sound (terminal, logs, supervision) stays out of the
process with the audio callback: a busy Python thread there delays the callback through
the interpreter lock. A process that dies or is killed by the watchdog is replaced by a
new one, which starts muted: nothing restores vibration by itself.

==========  ==============================================  ==========
state       what happens                                    next state
==========  ==============================================  ==========
idle        `Supervisor.begin`                              starting
starting    the process writes telemetry                    running
starting    it dies after others have run                   restarting
starting    an error, no progress, or the block is left     ended
running     it dies, or the watchdog finds it stalled       restarting
running     its sound ends, or the block is left            ended
restarting  the delay is over                               starting
restarting  the block is left                               ended
==========  ==============================================  ==========
"""

import contextlib
import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from types import MappingProxyType
from typing import Literal, Self, TypeAlias

from tactophone.core.errors import TactophoneError
from tactophone.core.processes import (
    Child,
    Parent,
    never_suspended,
    orphaned,
    parent_is_stopped,
)
from tactophone.core.settings import Settings
from tactophone.core.types import ignore
from tactophone.core.version import __version__
from tactophone.live.audio.jack import disconnect_from_jack
from tactophone.live.runtime.held_files import (
    FILES_INTERVAL,
    HeldFiles,
    HeldPeers,
    files_of,
)
from tactophone.live.runtime.priority import (
    MAIN_PRIORITY,
    collect_garbage,
    cores_awake,
    follow_period,
    name_thread,
    prioritize_thread,
    settle,
)
from tactophone.live.runtime.recorder import SessionRecorder
from tactophone.live.runtime.watchdog import (
    CHECK_INTERVAL,
    HARMLESS,
    SILENT_TIMEOUT,
    Verdict,
    Watchdog,
)
from tactophone.live.telemetry.layout import Fault, FingerState, RunState
from tactophone.live.telemetry.memory import remove_leftovers, remove_memory
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.link.identity import Peers

RESTART_DELAY = 0.5
"""Seconds between the end of a process and the next; doubled with every process that
lived less than `SHORT_LIFE`."""

LONGEST_RESTART_DELAY = 4.0
"""Seconds up to which `RESTART_DELAY` is doubled."""

SHORT_LIFE = 2.0
"""Seconds after its start within which a process most likely ends for a reason that
ends the next one too."""

SIDE_START_TIMEOUT = 20.0
"""Seconds that a process may spend at its start without any progress: neither a message
nor processor time."""

LONGEST_START = 300.0
"""Seconds that a start may take in all; compiling the simulation on a busy machine
takes one minute."""

SLOW_START = 5.0
"""Seconds after which a line says what a slow start is at; the next comes after twice
as long."""

BUDGET_INTERVAL = 1.0
"""Seconds between two updates of the latency budget."""

LAST_WORDS = 0.5
"""Seconds for which a side whose call has ended still shows that, and for which the end
of a run waits for its last lines: more than between two updates of a console."""

MOVING = ", moving"
"""Added to the link of a robot that says that it moves."""

NO_ANSWER = (
    "the other end may still be starting; "
    "if it stays silent once it is ready, hang up and call again"
)
"""Advice where a call's other end does not answer."""

SIDE_END_TIMEOUT = 3.0
"""Seconds that a process may take to end in order."""


@dataclass(frozen=True, slots=True)
class ProcessInfo:
    """What a process gets at its start: the name of its run, and how many processes of
    the run ended before it."""

    name: str
    restarts: int = 0
    progress: Callable[[str], None] = ignore
    """Called with what the process does next, while it starts."""
    files: Mapping[str, str] = field(default_factory=dict)
    """The files of the run when it began, see `held_files.files_of`."""
    fingers: tuple[FingerState, ...] = ()
    """What the process before this one showed of its fingers, at an operator."""


Main: TypeAlias = Callable[[Settings, ProcessInfo], None]
"""One side of the live system: runs until SIGTERM, or until its sound ends. Must be
importable by a new process."""


SideState = Literal["idle", "starting", "running", "restarting", "ended"]

SIDE_TRANSITIONS: Mapping[SideState, frozenset[SideState]] = MappingProxyType(
    {
        "idle": frozenset({"starting"}),
        "starting": frozenset({"running", "restarting", "ended"}),
        "running": frozenset({"restarting", "ended"}),
        "restarting": frozenset({"starting", "ended"}),
        "ended": frozenset(),
    }
)
"""The table above: `Supervisor` makes no other move."""


class Supervisor:
    """Runs one side in its own process; a context manager.

    - ``report``: called, from a thread that may stand still or end, with a line for
      people: why a process is restarted, or what a slow start is doing. The latter ends
      in ``"\\r"``, as the next such line replaces it.
    - ``progress``: called with what the process does next, while its start is awaited;
      it may be replaced.
    - ``restarts``: number of new processes that had to be started.
    - ``state``: where the side stands in the table at the head of this file.
    """

    def __init__(
        self,
        main: Main,
        settings: Settings,
        *,
        name: str,
        report: Callable[[str], None] = ignore,
    ) -> None:
        self.name = name
        self.restarts = 0
        self.state: SideState = "idle"
        self.progress: Callable[[str], None] = ignore
        self._main = main
        self._settings = settings
        self._report = report
        self._words: SimpleQueue[str | None] = SimpleQueue()
        self._speaker = threading.Thread(target=self._speak, name="words", daemon=True)
        self._child: Child | None = None
        self._files: dict[str, str] = {}
        self._fingers: tuple[FingerState, ...] = ()
        self._started = math.inf
        self._restart_delay = RESTART_DELAY
        self._stop_asked = False
        self._ended = threading.Event()
        self._thread = threading.Thread(
            target=self._watch, name="watchdog", daemon=True
        )

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
        if self._child:
            self._child.close()
        else:
            # Not for a successor: who watches the run still reads what the dead process
            # wrote last.
            remove_leftovers()
            self._files = files_of(self._settings)
            self._speaker.start()
            _sides[self.name] = self
        info = ProcessInfo(
            self.name, self.restarts, files=self._files, fingers=self._fingers
        )
        # A bare function, as `self` holds a thread and cannot be sent to another
        # process.
        self._child = Child(
            _run, self._main, self._settings, info, __version__, name=self.name
        )
        self._started = math.inf
        self._enter("starting")
        if self._stop_asked:
            self.stop_emergency()

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
        """Whether the side runs or will be restarted; false once its sound has
        ended."""
        return not self._ended.is_set()

    @property
    def pid(self) -> int:
        """Process id of the current process; 0 before the first."""
        return self._child.pid if self._child else 0

    def wait(self, timeout: float) -> bool:
        """Wait up to ``timeout`` s for the side to end by itself; true when it has."""
        return self._ended.wait(timeout)

    def stop_emergency(self) -> None:
        """Send the emergency stop as a signal, which needs no free thread in the
        process; one that still starts, or has not begun, begins stopped."""
        self._stop_asked = True
        if self.state in ("starting", "running"):
            self._stop_asked = False
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGUSR1)

    def _say(self, line: str) -> None:
        """Report a line in a thread of its own: a terminal that stands still holds up
        whoever writes to it, and one that is gone ends the thread, but nothing may keep
        the watchdog from its watch."""
        self._words.put(line)

    def _speak(self) -> None:
        while (line := self._words.get()) is not None:
            # The console turns a broken pipe into the end of the thread.
            with contextlib.suppress(Exception, SystemExit):
                self._report(line)

    def _enter(self, state: SideState) -> None:
        """Move to a state; a move that `SIDE_TRANSITIONS` does not allow is our
        mistake."""
        if state != self.state and state not in SIDE_TRANSITIONS[self.state]:
            raise RuntimeError(f"{self.name}: {self.state} cannot become {state}")
        self.state = state

    def _await_start(self) -> None:
        """Wait for the first telemetry as long as the process makes progress; its error
        is raised here."""
        child = self._child
        if child is None:
            return
        doing = "loading libraries"
        failure = "it ended"
        began = time.monotonic()
        progressed = began
        used = 0
        slow = SLOW_START
        while True:
            now = time.monotonic()
            # Asked before the messages are read: whatever the process told before its
            # end is among them then.
            alive = child.alive
            for kind, doing in child.messages():
                if kind in ("error", "bug"):
                    raise TactophoneError(doing)
                progressed = now
                self.progress(doing)
            if not alive:
                if not child.how_ended():
                    return  # its sound was so short that it has ended already
                break
            watcher = self.watcher()
            if watcher and watcher.pulse().beat > 0:
                self._started = now
                self._enter("running")
                return
            ticks = _processor_time(child.pid)
            if ticks != used:
                used = ticks
                progressed = now
            if now - progressed > SIDE_START_TIMEOUT:
                failure = f"no progress within {SIDE_START_TIMEOUT:g} s"
                break
            if now - began > LONGEST_START:
                failure = f"not done within {LONGEST_START:g} s"
                break
            if now - began >= slow:
                slow *= 2
                self._say(f"still starting ({now - began:.0f} s): {doing}\r")
            time.sleep(0.02)
        raise TactophoneError(
            f"{self.name} did not start: {failure}; it was last {doing}"
        )

    def _watch(self) -> None:
        try:
            # If this is refused, the network thread has warned already.
            prioritize_thread(self._settings.process.priority)
            self._keep_running()
        except BaseException:
            # Without a watchdog nothing may vibrate.
            if self._child:
                self._child.kill()
            self._ended.set()
            raise

    def _keep_running(self) -> None:
        while not self._ended.is_set():
            reason = self._watch_process()
            if not reason:
                self._enter("ended")
                self._ended.set()
            if self._ended.is_set():
                return
            self._enter("restarting")
            # What ends soon after each start will most likely do so again: it is tried
            # less and less often.
            short = self.restarts and time.monotonic() - self._started < SHORT_LIFE
            delay = RESTART_DELAY
            if short:
                delay = min(2 * self._restart_delay, LONGEST_RESTART_DELAY)
            restarts = self.restarts + 1
            while True:
                self._restart_delay = delay
                self._say(
                    f"! {self.name} ended ({reason}) and starts again in {delay:g} s"
                )
                if self._ended.wait(delay):
                    return
                # Its successor begins muted: it finds the count in `ProcessInfo`.
                self.restarts = restarts
                try:
                    self.begin()
                    break
                except OSError as error:
                    # The system has no process, memory or descriptor to give now.
                    reason = f"no process can be started: {error.strerror}"
                    delay = min(2 * delay, LONGEST_RESTART_DELAY)

    def _watch_process(self) -> str:
        """Watch one process; returns why it ended and another should start, empty when
        none should."""
        child = self._child
        watcher = self.watcher()
        # The short timeout is for real actuators: a stalled file harms nobody, and a
        # busy machine may be late.
        harmless = self._settings.output.actuator in HARMLESS
        watchdog = Watchdog(
            SILENT_TIMEOUT if harmless else self._settings.process.stall_timeout
        )
        while child and not self._ended.wait(CHECK_INTERVAL):
            if not child.alive:
                self._remember(watcher)
                failures = [
                    text for kind, text in child.messages() if kind in ("error", "bug")
                ]
                how = child.how_ended()
                return failures[-1] if how and failures else how
            if watcher is None:
                watcher = self.watcher()
                if watcher:
                    self._started = time.monotonic()
                    self._enter("running")
                    self._say(f"{self.name} runs again")
                continue
            if not self._settings.process.watchdog:
                continue
            if not self._tolerates(watchdog, watcher):
                # It may be stopped in the middle of a period, where it could take no
                # note of any gentler word.
                child.kill()
                self._remember(watcher)
                return "the watchdog found it stalled"
        return ""

    def _remember(self, watcher: Watcher | None) -> None:
        """Note how strong its successor may be; the memory is read also where the
        process has removed it."""
        state = watcher.state() if watcher else RunState()
        if state.role == "operator":
            self._fingers = state.fingers

    def _tolerates(self, watchdog: Watchdog, watcher: Watcher) -> bool:
        """Check the pulse once; a process that is late at vibrating is silenced from
        outside, if it can be."""
        match watchdog.check(watcher.pulse(), now=time.monotonic()):
            case Verdict.LATE:
                on_jack = self._settings.output.actuator == "jack"
                silenced = on_jack and disconnect_from_jack(self.pid)
                if not silenced:
                    return False
                # It stays, and goes on by itself once it can: it joins the JACK server
                # again and waits for fresh sound.
                self._say(f"! {self.name} was late and is silent until it goes on")
            case Verdict.RESUMED:
                self._say(f"{self.name} goes on")
            case Verdict.STALLED:
                return False
        return True

    def watcher(self) -> Watcher | None:
        """Return a watcher of the process; ``None`` while it has no memory, and where
        another run has its name."""
        # The memory of a process that was killed stays until its successor replaces it.
        watcher = Watcher.find(self.name)
        return watcher if watcher and watcher.pid == self.pid else None

    def _end(self) -> None:
        if self._child:
            self._enter("ended")
            if math.isinf(self._started) and not self.watcher():
                # A starting process cannot answer yet, and killing it loses no data.
                self._child.kill()
            self._child.terminate()
            self._child.end(SIDE_END_TIMEOUT)
            remove_memory(self.name)
            self._words.put(None)
            self._speaker.join(LAST_WORDS)
            if _sides.get(self.name) is self:
                del _sides[self.name]


_sides: dict[str, Supervisor] = {}
"""The sides of this process from their begin to their end, by name."""


def side_of(name: str) -> Supervisor | None:
    """Return this process's own side of that name, from its begin to its end; ``None``
    before and afterwards. A run of another process may have the name too."""
    return _sides.get(name)


@contextlib.contextmanager
def left_by_sigterm() -> Iterator[None]:
    """Let SIGTERM leave this block of the main thread in order, as Ctrl-C does."""
    before = signal.signal(signal.SIGTERM, _leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def supervised(*sides: Supervisor) -> Iterator[tuple[Supervisor, ...]]:
    """Start several sides at once, which takes as long as one does, and wait for all;
    ends them, the last first.

    In the main thread, SIGTERM leaves the block while it lasts, as Ctrl-C does, and
    Ctrl-Z is an emergency stop.
    """

    def stop() -> None:
        for side in sides:
            side.stop_emergency()

    with contextlib.ExitStack() as stack:
        if threading.current_thread() is threading.main_thread():
            stack.enter_context(left_by_sigterm())
            stack.enter_context(never_suspended(stop))
        for side in sides:
            stack.push(side)
            side.begin()
        for side in sides:
            side.await_start()
        yield sides


def _leave(*_: object) -> None:
    # Only the first signal counts: what is left to do takes a few seconds, and a second
    # one would cut it short.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(0)


def _run(
    parent: Parent, main: Main, settings: Settings, info: ProcessInfo, version: str
) -> None:
    def tell(text: str) -> None:
        parent.tell(("progress", text))

    # Silence waits for nothing: SIGTERM ends a side, whoever sends it.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    if version != __version__:
        # The process that began the run would not understand this one.
        raise TactophoneError(
            f"tactophone {version} was replaced by {__version__} during the run: "
            "end the run and start it again"
        )
    main(settings, replace(info, progress=tell))


def _processor_time(pid: int) -> int:
    """Return the clock ticks that a process has used (Linux; elsewhere 0: only its
    messages count as progress)."""
    try:
        # The fields after the command in brackets, which may hold spaces: utime and
        # stime are the 14th and 15th of the line, so the 12th and 13th of these.
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return int(fields[11]) + int(fields[12])
    except (OSError, IndexError, ValueError):
        return 0


class Side:
    """Base of the operator's and the robot's side while they run: their telemetry,
    their threads, and how they end."""

    interval: float
    """Seconds between two calls of `housekeep`."""

    def __init__(self, settings: Settings, info: ProcessInfo, *, role: str) -> None:
        self.ended = threading.Event()
        self.failure: BaseException | None = None
        self._settings = settings
        self._info = info
        self._role = role
        self._resources = contextlib.ExitStack()
        self._warnings: tuple[Fault, ...] = ()
        read = files_of(settings)
        self._files = HeldFiles(read, info.files)
        self._held: dict[str, tuple[Fault, ...]] = {}
        """What has become of the run's files and peers; each is written by the thread
        that watches it."""
        self._budgeted_at = 0.0
        self._ends_at = math.inf

    @property
    def period(self) -> float:
        """Seconds of a period of the sound device; 0 where there is none."""
        raise NotImplementedError

    def housekeep(self, now: float) -> None:
        """Apply requests and update telemetry; ``now`` is in s of the monotonic
        clock."""
        raise NotImplementedError

    def stop(self) -> None:
        """Stop all vibration until a person arms, where there is any."""

    def run(self, terminated: threading.Event) -> None:
        """Keep house in the main thread of the side's process, until the side or the
        parent ends or it is terminated.

        Raises what ended the side, if it was an error.
        """
        settle()
        collected = time.monotonic()
        priority = self._settings.process.priority
        prioritize_thread(min(MAIN_PRIORITY, priority))
        if priority:
            self._resources.enter_context(cores_awake())
        while not (terminated.is_set() or self.ended.is_set() or orphaned()):
            if parent_is_stopped():
                self.stop()  # nobody would see it stall
            now = time.monotonic()
            self.housekeep(now)
            follow_period(self.period)
            collected = collect_garbage(collected, now)
            self.ended.wait(self.interval)
        if self.failure is not None:
            raise self.failure

    def _end_soon(self, now: float) -> None:
        """End the side once whoever watches has had time to see why."""
        self._ends_at = min(self._ends_at, now + LAST_WORDS)
        if now >= self._ends_at:
            self.ended.set()

    def _watch_outside(
        self,
        trust: Callable[[Peers], None] | None,
        look: Callable[[], None] | None = None,
    ) -> None:
        """Watch the files of the run and its peers, and call ``look``, each
        `FILES_INTERVAL`.

        Each has a thread of its own: the disk of a model may hang, and so may what
        ``look`` asks, but whoever is no longer trusted must lose the connection at
        once. ``trust`` is called with the trusted peers when they change; in a call,
        whose other end is the only peer, there is none.
        """
        peers = HeldPeers(self._settings, trust) if trust else None

        def see(what: str, faults: Callable[[], Iterable[Fault]]) -> None:
            self._held[what] = tuple(faults())

        watched: dict[str, Callable[[], None]] = {
            "files": partial(see, "files", self._files.faults)
        }
        if peers:
            watched["peers"] = partial(see, "peers", peers.look)
        if look:
            watched["names"] = look
        for name, work in watched.items():
            threading.Thread(
                target=self._repeat, args=(work,), name=name, daemon=True
            ).start()

    def _repeat(self, work: Callable[[], None]) -> None:
        while not self.ended.wait(FILES_INTERVAL):
            work()

    @property
    def _file_faults(self) -> tuple[Fault, ...]:
        return (*self._held.get("files", ()), *self._held.get("peers", ()))

    def _open_telemetry(self) -> None:
        name = self._info.name
        fingers = len(self._settings.fingers)
        self._telemetry = self._resources.enter_context(
            Telemetry(name, fingers=fingers)
        )
        self._telemetry.count("process_restarts", self._info.restarts)
        # Opened once: whoever removes the file from the file system takes the watchers
        # away, not this process.
        self._watcher = Watcher(name)
        self._recorder = SessionRecorder(
            self._telemetry, self._settings, role=self._role
        )

    def _start(self, work: Callable[[], None]) -> threading.Thread:
        """Start a thread whose end, whatever the reason, ends the whole side in
        silence."""

        def run() -> None:
            try:
                work()
            except BaseException as error:
                self.failure = error
            # In this order: once `ended` is set, the main thread takes everything down.
            self._silence()
            self.ended.set()

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        return thread

    def _silence(self) -> None:
        """Stop all vibration, where there is any."""

    def _prepare_thread(self, name: str, **warnings: str) -> None:
        """Name and prioritise the calling thread; what the system refuses is a fault
        from now on, as are warnings."""
        name_thread(name)
        warnings["priority"] = prioritize_thread(self._settings.process.priority)
        self._warnings = tuple(
            Fault(code, warning) for code, warning in warnings.items() if warning
        )

    def _count(self, totals: Mapping[str, int]) -> None:
        for name, total in totals.items():
            self._telemetry.count(name, total - self._telemetry.counter(name))

    def _update_budget(
        self, now: float, stages: Callable[[], Mapping[str, float]]
    ) -> None:
        """Show how long sound spends in each stage, once a second."""
        if now - self._budgeted_at >= BUDGET_INTERVAL:
            self._budgeted_at = now
            for stage, duration in stages().items():
                self._telemetry.gauge(f"latency_{stage}", duration)
