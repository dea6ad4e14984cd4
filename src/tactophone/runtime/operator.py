"""The operator's side: datagrams come in, are opened, judged and felt.

The network thread does everything from datagram to command, on arrival. The actuator's own thread renders the newest
command. They meet in one slot, and neither ever waits for the other. The main thread shows how things are, and does
what is asked through telemetry's mailbox, as far as the guard allows.
"""

import dataclasses
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import numpy as np

from tactophone.config import Settings
from tactophone.endpoints import OperatorEndpoint
from tactophone.link import DecodedAudio, PredictionReceived, ReceiveEvent, ReceiveSession, UdpSocket
from tactophone.runtime import latency_budget as budget
from tactophone.runtime import realtime_priority as tuning
from tactophone.runtime.latency_budget import LocalPeer
from tactophone.runtime.output_gate import RESTARTED, STARTED_MUTED, OutputGate
from tactophone.runtime.requests import RequestHandler
from tactophone.runtime.supervisor import ProcessInfo
from tactophone.runtime.wiring import (
    SAMPLE_RATE,
    open_actuator,
    open_pipeline_for,
    open_renderer,
    open_session,
    post,
    sensor_faults,
)
from tactophone.telemetry import MARKS, Fault, State, Telemetry, Watcher
from tactophone.types import FloatArray, HapticCommand, PipelineStep, Prediction, Touch

HOUSEKEEPING = 0.02
"""Seconds between two looks at mailbox, devices and counters."""

LONGEST_RECEIVE = 0.005
"""Seconds that the network thread waits for a datagram, before it gives up on a missing packet: a packet's length."""

BUDGET_EVERY = 1.0
"""Seconds between two reckonings of the latency budget."""

LONGEST_CALL = 2.0
"""Seconds that a robot is given to call, before its absence is told as a fault."""

SILENT_LINK = 0.5
"""Seconds without sound or belief after which the line counts as silent, in words."""

_RECEIVED, _RELEASED, _DECODED, _JUDGED, _RENDERED = map(MARKS.index, MARKS[2:])


class Operator:
    """The operator's side while it runs; a context manager.

    Parameters
    ----------
    robot
        Name of the robot's run, where that is on this machine: whence the truth and the robot's part of the budget.
    """

    def __init__(self, settings: Settings, birth: ProcessInfo, *, robot: str = "") -> None:
        self.ended = threading.Event()
        self.failure: BaseException | None = None
        self._settings, self._birth = settings, birth
        feel = settings.feel
        self._guard = OutputGate(
            ceiling=feel.ceiling, output_level=feel.output_level, muted_because=_muted_because(settings, birth)
        )
        self._renderer = open_renderer(settings, self._pull)
        self._actuator = open_actuator(settings, self._render)
        self._end = ReceiveSession(open_session(settings, call=False))
        self._channels = 2
        self._receiver = OperatorEndpoint(self._end, open_pipeline_for(settings, channels=self._channels))
        self._end.bandwidth = round(self._receiver.walk.judge.detector.bandwidth)
        self._neighbour = LocalPeer(robot)
        self._resources = ExitStack()
        self._submitted = self._rendered = 0
        self._heard_at = time.monotonic()
        self._budgeted_at = 0.0
        self._counters: dict[str, int] = {}
        self._gauges: dict[str, float] = {}
        self._floor_dbfs = -math.inf
        self._warnings: tuple[Fault, ...] = ()
        self._desk = RequestHandler(self._guard, self._renderer, self._receiver)
        self._thread = threading.Thread(target=self._guarded, args=(self._follow_network,), daemon=True)

    def __enter__(self) -> Self:
        with self._resources:
            self._socket = self._resources.enter_context(UdpSocket(self._settings.link.host, self._settings.link.port))
            self._telemetry = self._resources.enter_context(Telemetry(self._birth.name))
            self._telemetry.count("process_restarts", self._birth.restarts)
            self._resources.enter_context(self._actuator)
            self._resources = self._resources.pop_all()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._renderer.stop()
        self.ended.set()
        self._thread.join(1.0)
        self._end.session.hang_up()
        post(self._end, self._socket)
        self._resources.close()

    def stop(self) -> None:
        """Stop vibrating at once, and stay stopped until somebody arms; may be called from a signal handler."""
        self._desk.stop()

    def look_after(self, now: float) -> None:
        """Do what is asked and show how things are; call it every `HOUSEKEEPING`."""
        self._telemetry.count("requests_refused", len(self._desk.obey(self._telemetry.requests())))
        self._actuator.device.revive()
        self._show_counts()
        self._show_budget(now)
        self._telemetry.update(self._state(now), now=now)

    def _show_counts(self) -> None:
        """Carry the parts' own counts over into telemetry."""
        device, faults = self._actuator.device, self._renderer.faults
        counts = {
            **self._counters,
            "xruns": device.xruns,
            "callback_faults": device.process_faults,
            "device_losses": device.losses,
            "command_faults": faults["command"],
            "stale_fades": faults["stale"],
            "emergency_stops": self._guard.stops,
            "sound_faults": self._receiver.walk.faults["sound"],
            "model_faults": self._receiver.walk.faults["model"],
        }
        for name, total in counts.items():
            self._telemetry.count(name, total - self._telemetry.counter(name))
        for name, value in {**self._gauges, "device_latency": device.latency}.items():
            self._telemetry.gauge(name, value)

    def _show_budget(self, now: float) -> None:
        if now - self._budgeted_at < BUDGET_EVERY:
            return
        self._budgeted_at = now
        self._neighbour.look()
        playout = self._end.playout
        found = budget.operators_part(
            Watcher(self._birth.name), self._neighbour.watcher, self._actuator.device.latency,
            sound_delay=playout.pace.margin + playout.latency + self._renderer.latency if playout else 0.0,
        )  # fmt: skip
        for stage, duration in found.items():
            self._telemetry.gauge(f"latency_{stage}", duration)

    def _state(self, now: float) -> State:
        walk, guard = self._receiver.walk, self._guard
        peer = self._end.session.peer
        return State(
            role="operator",
            armed=guard.armed,
            muted_because=guard.muted_because,
            ceiling=guard.ceiling,
            local_ceiling=guard.local_ceiling,
            output_level=guard.output_level,
            profile=walk.profile.name,
            profiles=self._desk.profiles,
            detector=walk.judge.detector.name,
            threshold_dbfs=walk.judge.threshold_dbfs,
            noise_floor_dbfs=round(self._floor_dbfs, 0),
            link=f"connected to {peer}" if peer else f"listening at port {self._socket.address[1]}",
            output=self._settings.output.actuator,
            faults=tuple(self._faults(now)),
        )

    def _faults(self, now: float) -> Iterator[Fault]:
        yield from self._warnings
        if self._actuator.device.fault:
            yield Fault("actuator", self._actuator.device.fault)
        yield from sensor_faults(self._receiver.walk.judge)
        silent = now - self._heard_at
        if self._end.session.peer is None and silent > LONGEST_CALL:
            failure = self._end.session.failure
            yield Fault("link", f"no robot is connected: {failure or 'start `tactophone send` there'}")
        elif self._end.session.peer and silent > SILENT_LINK:
            yield Fault("silence", "connected, but no sound comes from the robot: look at its microphones and the line")

    def _guarded(self, work: Callable[[], None]) -> None:
        """Run the thread's work; whatever ends it ends the whole side, silently."""
        try:
            work()
        except BaseException as error:
            self.failure = error
        self._renderer.stop()
        self.ended.set()

    def _follow_network(self) -> None:
        process, looked_at = self._settings.process, 0.0
        warnings = {"priority": tuning.prioritize_thread(process.priority)}
        if process.lock_memory:
            warnings["memory"] = tuning.lock_memory()
        self._warnings = tuple(Fault(code, words) for code, words in warnings.items() if words)
        while not self.ended.is_set():
            datagrams = self._socket.receive(LONGEST_RECEIVE)
            now = time.monotonic()
            for news in (*self._end.receive(datagrams, now=now), *self._end.poll(now)):
                self._take(news, received=now)
            post(self._end, self._socket)
            if now - looked_at >= HOUSEKEEPING:
                # Copied here, by the one thread that changes them, for the main thread to show.
                looked_at, self._counters, self._gauges = now, dict(self._end.counters), dict(self._end.gauges)

    def _take(self, news: ReceiveEvent, *, received: float) -> None:
        match news:
            case DecodedAudio(block, _, waited):
                self._note_arrival(block.end, received - waited, received)
                self._match_channels(block.channels)
            case PredictionReceived(prediction):
                self._note_arrival(round(prediction.end * SAMPLE_RATE), received, received)
        tick = self._receiver.take(news)
        if tick is not None:
            self._feel(tick)
        self._heard_at = received

    def _note_arrival(self, end: int, received: float, released: float) -> None:
        position = self._position(end)
        self._telemetry.mark(_RECEIVED, position, now=received)
        self._telemetry.mark(_RELEASED, position, now=released)
        self._telemetry.mark(_DECODED, position, now=time.monotonic())

    def _position(self, samples: int) -> int:
        """Turn samples since the stream began into the timestamp on the wire."""
        return (self._end.origin + samples) % (1 << 32)

    def _match_channels(self, channels: int) -> None:
        """Have the walk for so many microphones; it changes once, when another robot calls."""
        if channels != self._channels:
            self._receiver.walk, self._channels = open_pipeline_for(self._settings, channels=channels), channels

    def _feel(self, tick: PipelineStep) -> None:
        """Hand a step's newest command to the oscillator, as the guard allows it."""
        end = self._position(tick.block.end)
        felt = tuple(self._bounded(command) for command in tick.commands)
        if felt:
            self._renderer.submit(felt[-1])
            self._submitted = end
        for belief in tick.predictions:
            self._floor_dbfs = _floor(self._floor_dbfs, belief)
        now = time.monotonic()
        self._telemetry.mark(_JUDGED, end, now=now)
        self._telemetry.publish(dataclasses.replace(tick, commands=felt), now=now, truth=self._neighbour.truth())

    def _bounded(self, command: HapticCommand) -> HapticCommand:
        return dataclasses.replace(command, amplitude=self._guard.amplitude(command.amplitude))

    def _pull(self, size: int) -> FloatArray:
        """Fetch sound for a renderer that wants it, in the actuator's thread."""
        return self._end.pull(size, now=time.monotonic())

    def _render(self, out: FloatArray) -> None:
        """Be the actuator's callback: render, tell, and leave."""
        telemetry, submitted = self._telemetry, self._submitted
        self._renderer.render(out)
        telemetry.feel(out)
        telemetry.gauge("output_amplitude", float(np.abs(out).max()))
        telemetry.gauge("device_period", len(out) / SAMPLE_RATE)
        telemetry.count("callbacks")
        if submitted != self._rendered:
            self._rendered = submitted
            telemetry.mark(_RENDERED, submitted, now=time.monotonic())


def run_operator(settings: Settings, birth: ProcessInfo, *, robot: str = "") -> None:
    """Be the operator's side, in this process, until SIGTERM; SIGUSR1 is the emergency stop."""
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    with Operator(settings, birth, robot=robot) as operator:
        signal.signal(signal.SIGUSR1, lambda *_: operator.stop())
        tuning.settle()
        while not (terminated.is_set() or operator.ended.is_set() or birth.orphaned):
            operator.look_after(time.monotonic())
            operator.ended.wait(HOUSEKEEPING)
    if operator.failure is not None:
        raise operator.failure


def _floor(floor_dbfs: float, belief: Prediction) -> float:
    """Follow the level while nothing is touched, over some hundred windows."""
    if belief.touch is not Touch.NONE or not math.isfinite(belief.level_dbfs):
        return floor_dbfs
    return belief.level_dbfs if math.isinf(floor_dbfs) else floor_dbfs + 0.01 * (belief.level_dbfs - floor_dbfs)


def _muted_because(settings: Settings, birth: ProcessInfo) -> str:
    if birth.restarts:
        return RESTARTED
    return STARTED_MUTED if settings.feel.muted else ""
