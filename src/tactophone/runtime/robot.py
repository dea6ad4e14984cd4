"""The robot's side: sound comes in, is coded, sealed and sent.

Two threads share the sending end under one lock, each for well under a millisecond at a time: one follows the sound,
the other the network. The main thread only looks after them.
"""

import dataclasses
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from tactophone.capture import LiveSource
from tactophone.config import Settings
from tactophone.endpoints import RobotEndpoint
from tactophone.link import UdpSocket
from tactophone.runtime import latency_budget as budget
from tactophone.runtime import realtime_priority as tuning
from tactophone.runtime.realtime_playback import paced
from tactophone.runtime.supervisor import ProcessInfo
from tactophone.runtime.wiring import (
    SAMPLE_RATE,
    OpenSource,
    open_device,
    open_pipeline_for,
    open_send_session,
    open_watch,
    post,
)
from tactophone.telemetry import MARKS, Fault, State, Telemetry, Watcher
from tactophone.types import AudioBlock

HOUSEKEEPING = 0.05
"""Seconds between two looks at devices, counters and the parent process."""

BUDGET_EVERY = 1.0
"""Seconds between two reckonings of the latency budget."""

LONGEST_RECEIVE = 0.05
"""Seconds that the network thread waits for a datagram, before it lets time pass for the session."""

_CAPTURED, _SENT = MARKS.index("captured"), MARKS.index("sent")


@runtime_checkable
class KnowsTruth(Protocol):
    """A source that knows what its finger truly touches, because it is simulated or labelled."""

    def truth_now(self) -> int:
        """Which `Touch` it was at the end of the newest block; -1 when that is not known."""
        ...


class Robot:
    """The robot's side while it runs; a context manager.

    Parameters
    ----------
    open_source
        Makes the microphones, or what stands for them.
    """

    def __init__(
        self,
        settings: Settings,
        birth: ProcessInfo,
        *,
        open_source: OpenSource = open_device,
    ) -> None:
        self.ended = threading.Event()
        self.failure: BaseException | None = None
        self._settings = settings
        self._resources = ExitStack()
        self._source = open_source(settings)
        self._end = open_send_session(settings, self._source.channels)
        judge = open_pipeline_for(settings, channels=self._source.channels).judge if settings.link.judge else None
        self._sender = RobotEndpoint(self._end, judge)
        self._watch = open_watch(settings, channels=self._source.channels)
        self._lock = threading.Lock()
        self._birth = birth
        self._budgeted_at = 0.0
        self._warnings: tuple[Fault, ...] = ()
        self._threads = [
            threading.Thread(target=self._guarded, args=(work,), daemon=True)
            for work in (self._follow_sound, self._follow_network)
        ]

    def __enter__(self) -> Self:
        with self._resources:
            self._resources.enter_context(self._source)
            self._socket = self._resources.enter_context(UdpSocket())
            self._telemetry = self._resources.enter_context(Telemetry(self._birth.name))
            self._telemetry.count("process_restarts", self._birth.restarts)
            self._resources = self._resources.pop_all()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.ended.set()
        if isinstance(self._source, LiveSource):
            self._source.close()
        for thread in self._threads:
            thread.join(1.0)
        with self._lock:
            self._end.session.hang_up()
            post(self._end, self._socket)
        self._resources.close()

    def look_after(self, now: float) -> None:
        """Show how things are; call it every `HOUSEKEEPING`."""
        with self._lock:
            counters, round_trip, loss = dict(self._end.counters), self._end.round_trip, self._end.loss
            peer, failure = self._end.session.peer, self._end.session.failure
        for name, total in counters.items():
            self._telemetry.count(name, total - self._telemetry.counter(name))
        self._telemetry.gauge("loss_ratio", loss)
        if round_trip is not None:
            self._telemetry.gauge("round_trip", round_trip)
        if now - self._budgeted_at >= BUDGET_EVERY:
            self._budgeted_at = now
            for stage, duration in budget.robots_part(Watcher(self._birth.name), self._end.codec).items():
                self._telemetry.gauge(f"latency_{stage}", duration)
        faults = [*self._warnings, *self._device_faults()]
        if self._watch:
            faults += [Fault(fault.code, str(fault)) for fault in self._watch.faults]
        if peer is None:
            words = f"no operator at {self._settings.link.peer}:{self._settings.link.port} yet"
            faults.append(Fault("link", f"{words}: {failure or 'start `tactophone receive` there'}"))
        link = f"connected to {peer}" if peer else "calling"
        self._telemetry.update(dataclasses.replace(self._state(), link=link, faults=tuple(faults)), now=now)

    def _state(self) -> State:
        capture = self._settings.capture
        return State(
            role="robot",
            muted_because="",
            source=capture.source,
            detector=self._sender.judge.detector.name if self._sender.judge else "",
            channels=self._source.channels,
        )

    def _device_faults(self) -> Iterator[Fault]:
        if isinstance(self._source, LiveSource):
            device = self._source.device
            self._telemetry.count("xruns", device.xruns - self._telemetry.counter("xruns"))
            missed = self._source.overflows - self._telemetry.counter("capture_overflows")
            self._telemetry.count("capture_overflows", missed)
            if device.fault:
                yield Fault("microphones", device.fault)

    def _guarded(self, work: Callable[[], None]) -> None:
        """Run one thread's work; whatever ends it ends the whole side, and the operator's dead-man does the rest."""
        try:
            work()
        except BaseException as error:
            self.failure = error
        self.ended.set()

    def _follow_sound(self) -> None:
        self._warn("priority", tuning.prioritize_thread(self._settings.process.priority))
        if self._settings.process.lock_memory:
            self._warn("memory", tuning.lock_memory())
        if self._settings.capture.source == "file":
            self._await_listener()
        sound = iter(self._source) if isinstance(self._source, LiveSource) else paced(self._source)
        for block in sound:
            if self.ended.is_set():
                return
            self._send(block)

    def _await_listener(self) -> None:
        """Hold a recording back until somebody hears it: unlike a microphone's, its sound has a beginning."""
        while not self.ended.wait(HOUSEKEEPING):
            with self._lock:
                if self._end.session.peer is not None:
                    return

    def _send(self, block: AudioBlock) -> None:
        captured = time.monotonic()
        with self._lock:
            tick = self._sender.push(block)
            post(self._end, self._socket)
            origin = self._end.origin
        now = time.monotonic()
        # A belief goes by its window's end, as the operator knows no other time of it.
        end = round(tick.predictions[-1].end * SAMPLE_RATE) if tick.predictions else block.end
        if origin is not None and (tick.predictions or self._sender.judge is None):
            self._telemetry.mark(_CAPTURED, (origin + end) % (1 << 32), now=captured)
            self._telemetry.mark(_SENT, (origin + end) % (1 << 32), now=now)
        truth = self._source.truth_now() if isinstance(self._source, KnowsTruth) else -1
        self._telemetry.publish(tick, now=now, truth=truth)
        if self._watch:
            self._watch.push(block)

    def _follow_network(self) -> None:
        tuning.prioritize_thread(self._settings.process.priority)
        while not self.ended.is_set():
            datagrams = self._socket.receive(LONGEST_RECEIVE)
            now = time.monotonic()
            with self._lock:
                self._end.receive(datagrams, now=now)
                self._end.poll(now)
                post(self._end, self._socket)

    def _warn(self, code: str, words: str) -> None:
        if words:
            self._warnings = (*self._warnings, Fault(code, words))


def run_robot(settings: Settings, birth: ProcessInfo, *, open_source: OpenSource = open_device) -> None:
    """Be the robot's side, in this process, until SIGTERM or the sound's end."""
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # the emergency stop is the operator's; here nothing vibrates
    with Robot(settings, birth, open_source=open_source) as robot:
        tuning.settle()
        while not (terminated.is_set() or robot.ended.is_set() or birth.orphaned):
            robot.look_after(time.monotonic())
            robot.ended.wait(HOUSEKEEPING)
    if robot.failure is not None:
        raise robot.failure
