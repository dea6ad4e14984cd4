"""The operator's side: receives datagrams, runs the pipeline on their sound and drives the actuator.

The network thread does everything from datagram to command, on arrival. The actuator's own thread renders the newest
command. They share one slot, and neither ever waits for the other. The main thread updates telemetry, and applies the
requests in telemetry's mailbox as far as the output gate allows.
"""

import itertools
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Self

from tactophone.config import Settings
from tactophone.endpoints import OperatorEndpoint
from tactophone.errors import ModelError
from tactophone.link import Codec, DecodedAudio, PredictionReceived, ReceiveEvent, ReceiveSession, UdpSocket
from tactophone.pipeline import Pipeline
from tactophone.runtime.deferred_telemetry import DeferredTelemetry
from tactophone.runtime.latency_budget import LocalPeer, operator_stages
from tactophone.runtime.output_gate import RESTARTED, STARTED_MUTED, OutputGate
from tactophone.runtime.realtime_priority import freeze_garbage_collector, lock_memory, prioritize_thread
from tactophone.runtime.rehearsal import (
    open_rehearsed_pipeline,
    rehearse_decoders,
    rehearse_renderer,
    rehearse_statistics,
)
from tactophone.runtime.requests import RequestHandler
from tactophone.runtime.session_recorder import SessionRecorder
from tactophone.runtime.supervisor import ProcessInfo
from tactophone.runtime.wiring import (
    actuator_response,
    microphone_faults,
    open_actuator,
    open_renderer,
    open_session,
    send_outgoing,
    tip_warning,
)
from tactophone.telemetry import MARKS, Fault, State, Telemetry, Watcher
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray, HapticCommand, PipelineStep, Prediction, Touch

HOUSEKEEPING_INTERVAL = 0.02
"""Seconds between two checks of the mailbox."""

COUNTING_INTERVAL = 0.1
"""Seconds between two updates of counters, gauges and state: no page is drawn more often."""

LONGEST_RECEIVE = 0.005
"""Seconds that the network thread waits for a datagram before it gives up on a missing packet: a packet's length."""

BUDGET_INTERVAL = 1.0
"""Seconds between two updates of the latency budget."""

LONGEST_CALL = 2.0
"""Seconds that a robot may take to connect before its absence is reported as a fault."""

SILENT_LINK = 0.5
"""Seconds without sound or predictions after which the connected link is reported as silent."""

SENT_AWAY_SHOWN = 10.0
"""Seconds for which a second robot is reported after its call; it calls every few seconds."""

_RECEIVED, _RELEASED, _DECODED, _DETECTED, _RENDERED = map(MARKS.index, MARKS[2:])


class Operator:
    """The operator's side while it runs; a context manager.

    Parameters
    ----------
    robot
        Name of the robot's run, where that is on this machine: source of the true touch and of the robot's part of
        the latency budget.
    """

    def __init__(self, settings: Settings, info: ProcessInfo, *, robot: str = "") -> None:
        self.ended = threading.Event()
        self.failure: BaseException | None = None
        self._settings, self._info = settings, info
        rendering = settings.rendering
        self._gate = OutputGate(
            ceiling=rendering.ceiling, output_level=rendering.output_level, muted_because=_muted_because(settings, info)
        )
        self._renderer = open_renderer(settings, self._pull)
        self._actuator = open_actuator(
            settings, self._render, roughness=lambda: self._roughness, ceiling=lambda: self._gate.ceiling
        )
        self._session = ReceiveSession(open_session(settings, call=False))
        info.progress("opening the models")
        # Both are opened now: a robot with other microphones must not make the network thread load a model.
        self._pipelines = {2: open_rehearsed_pipeline(settings, channels=2)}
        self._without_pipeline = ""
        try:
            self._pipelines[1] = open_rehearsed_pipeline(settings, channels=1)
        except ModelError as error:
            self._without_pipeline = str(error)
        self._tip_warning = tip_warning(settings)  # here, because it reads a model file
        self._endpoint = OperatorEndpoint(self._session, self._pipelines[2], reopen=self._pipeline_for)
        self._tip_warning = tip_warning(settings)  # reads the model's file: here, not once the side runs
        info.progress("rehearsing")
        self._rehearse()
        info.progress("opening the actuator and the port")
        self._session.bandwidth = round(self._endpoint.pipeline.bandwidth)
        self._local_robot = LocalPeer(robot)
        self._resources = ExitStack()
        self._submitted = self._rendered = self._losses = 0
        self._roughness = 0.0
        self._received_at = time.monotonic()
        self._budgeted_at = self._counted_at = 0.0
        self._counters: dict[str, int] = {}
        self._gauges: dict[str, float] = {}
        self._floor_dbfs = -math.inf
        self._warnings: tuple[Fault, ...] = ()
        self._requests = RequestHandler(self._gate, self._renderer, self._endpoint, actuator_response(settings))
        self._thread = threading.Thread(target=self._run, args=(self._follow_network,), daemon=True)

    def __enter__(self) -> Self:
        with self._resources:
            self._socket = self._resources.enter_context(UdpSocket(self._settings.link.host, self._settings.link.port))
            self._telemetry = self._resources.enter_context(Telemetry(self._info.name))
            self._telemetry.count("process_restarts", self._info.restarts)
            # Opened once: whoever removes the file from the file system takes the watchers away, not this process.
            self._watcher = Watcher(self._info.name)
            self._recorder = SessionRecorder(self._telemetry, self._settings, role="operator")
            self._deferred = DeferredTelemetry(self._telemetry, self._recorder)
            self._session.tap = self._recorder.arrival
            self._resources.enter_context(self._actuator)
            self._resources = self._resources.pop_all()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.stop()
        self.ended.set()
        self._thread.join(1.0)
        if not self._thread.is_alive():
            self._deferred.write()
        self._session.session.hang_up()
        send_outgoing(self._session, self._socket)
        self._resources.close()

    def stop(self) -> None:
        """Stop vibrating at once, and stay stopped until armed; may be called from a signal handler."""
        self._requests.stop()

    def housekeep(self, now: float) -> None:
        """Apply requests and update telemetry; call it every `HOUSEKEEPING_INTERVAL`."""
        requests = self._telemetry.requests(now)
        self._telemetry.count("requests_refused", len(self._requests.apply(requests)))
        changed = self._revive() or requests or self._gate.muted_because != self._telemetry.state.muted_because
        if not changed and now - self._counted_at < COUNTING_INTERVAL:
            return
        self._counted_at = now
        self._update_counts()
        self._update_budget(now)
        self._telemetry.update(self._state(now), now=now)

    def _revive(self) -> bool:
        """Reconnect a lost device; what it rendered last is not taken up again. Returns whether it was lost anew."""
        device = self._actuator.device
        lost = device.losses != self._losses
        if lost:
            self._losses = device.losses
            self._renderer.reset()
            # The watchdog counts as late only what vibrates.
            self._telemetry.gauge("output_amplitude", 0.0)
        device.revive()
        return lost

    def _update_counts(self) -> None:
        """Copy the counts of session, device, renderer and pipeline into telemetry."""
        device, faults = self._actuator.device, self._renderer.faults
        counts = {
            **self._counters,
            "xruns": device.xruns,
            "callback_faults": device.process_faults,
            "device_losses": device.losses,
            "command_faults": faults["command"],
            "stale_fades": faults["stale"],
            "emergency_stops": self._gate.stops,
            "sound_faults": self._endpoint.pipeline.faults["sound"],
            "model_faults": self._endpoint.pipeline.faults["model"],
        }
        for name, total in counts.items():
            self._telemetry.count(name, total - self._telemetry.counter(name))
        for name, value in {**self._gauges, "device_latency": device.latency}.items():
            self._telemetry.gauge(name, value)

    def _update_budget(self, now: float) -> None:
        if now - self._budgeted_at < BUDGET_INTERVAL:
            return
        self._budgeted_at = now
        self._local_robot.refresh()
        playout = self._session.playout
        stages = operator_stages(
            self._watcher, self._local_robot.watcher, self._actuator.device.latency,
            sound_delay=playout.controller.margin + playout.latency + self._renderer.latency if playout else 0.0,
        )  # fmt: skip
        for stage, duration in stages.items():
            self._telemetry.gauge(f"latency_{stage}", duration)

    def _state(self, now: float) -> State:
        pipeline, gate, peer = self._endpoint.pipeline, self._gate, self._session.peer
        return State(
            role="operator",
            armed=gate.armed,
            muted_because=gate.muted_because,
            ceiling=gate.ceiling,
            local_ceiling=gate.local_ceiling,
            output_level=gate.output_level,
            profile=pipeline.profile.name,
            profiles=self._requests.profiles,
            detector=pipeline.detector_name,
            threshold_dbfs=pipeline.threshold_dbfs,
            noise_floor_dbfs=round(self._floor_dbfs, 0),
            link=f"connected to {peer}" if peer else f"listening at port {self._socket.address[1]}",
            output=self._settings.output.actuator,
            faults=tuple(self._faults(now)),
        )

    def _faults(self, now: float) -> Iterator[Fault]:
        yield from self._warnings
        if self._actuator.device.fault:
            yield Fault("actuator", self._actuator.device.fault)
        yield from microphone_faults(self._endpoint.pipeline.detector)
        silent = now - self._received_at
        if self._endpoint.refusal:
            yield Fault("refused", f"the robot's sound cannot be used: {self._endpoint.refusal}")
        if self._session.peer is None and silent > LONGEST_CALL:
            failure = self._session.session.failure
            yield Fault("link", f"no robot is connected: {failure or 'start `tactophone send` there'}")
        elif self._session.peer and silent > SILENT_LINK:
            yield Fault("silence", "connected, but the robot sends no sound: check its microphones and the network")

        sent_away = self._session.session.sent_away
        if sent_away and now - sent_away[1] < SENT_AWAY_SHOWN:
            yield Fault("second_robot", f"{sent_away[0]!r} called too and was sent away: stop one of the two robots")

    def _rehearse(self) -> None:
        """Run each stage once, so that nothing is loaded while the side runs."""
        rehearse_decoders(Codec(channels=channels) for channels in self._pipelines)
        rehearse_renderer(self._renderer, period=self._settings.output.period)
        rehearse_statistics()

    def _pipeline_for(self, channels: int) -> Pipeline:
        if channels not in self._pipelines:
            raise ModelError(self._without_pipeline)
        pipeline = self._pipelines[channels]
        pipeline.reset()
        return pipeline

    def _run(self, work: Callable[[], None]) -> None:
        """Run the thread's work; its end, whatever the reason, ends the whole side in silence."""
        try:
            work()
        except BaseException as error:
            self.failure = error
        self._renderer.stop()
        self.ended.set()

    def _follow_network(self) -> None:
        process, checked_at = self._settings.process, 0.0
        warnings = {"priority": prioritize_thread(process.priority), "other_tip": self._tip_warning}
        if process.lock_memory:
            warnings["memory"] = lock_memory()
        self._warnings = tuple(Fault(code, warning) for code, warning in warnings.items() if warning)
        while not self.ended.is_set():
            datagrams = self._socket.receive(LONGEST_RECEIVE)
            received = time.monotonic()
            self._recorder.controls(*self._controls())
            steps = itertools.chain(self._endpoint.receive(datagrams, now=received), self._endpoint.poll(received))
            # Everything is decoded now. Each step is computed when the loop comes to it, so the time before is the
            # moment at which its sound was decoded and free to be processed.
            decoded = time.monotonic()
            for number, (event, step) in enumerate(steps, 1):
                self._mark_arrival(event, received=received, decoded=decoded)
                if step is not None:
                    self._submit(step)
                self._recorder.controls(*self._controls(), step=number)
                self._received_at, decoded = received, time.monotonic()
            if self._endpoint.refusal and self._session.peer:
                self._session.session.hang_up(f"the operator cannot use this sound: {self._endpoint.refusal}")
            send_outgoing(self._session, self._socket)
            # All that the commands did not need: here the thread would wait for the next packet.
            if self._deferred.due(received):
                self._deferred.write(truth=self._local_robot.truth())
            if received - checked_at >= COUNTING_INTERVAL:
                # Copied by the one thread that changes them, for the main thread to publish.
                checked_at = received
                self._counters, self._gauges = dict(self._session.counters), dict(self._session.gauges)

    def _mark_arrival(self, event: ReceiveEvent, *, received: float, decoded: float) -> None:
        if isinstance(event, DecodedAudio):
            position, waited = self._position(event.block.end), event.waited
        elif isinstance(event, PredictionReceived):
            position, waited = self._position(round(event.prediction.end * LIVE_SAMPLE_RATE)), 0.0
        else:
            return
        mark = self._deferred.mark
        mark(_RECEIVED, position, now=received - waited)
        mark(_RELEASED, position, now=received)
        mark(_DECODED, position, now=decoded)

    def _position(self, samples: int) -> int:
        """Convert samples since the stream began to the timestamp on the wire."""
        return (self._session.origin + samples) % (1 << 32)

    def _submit(self, step: PipelineStep) -> None:
        """Pass a step's newest command to the renderer, as bounded by the output gate."""
        end = self._position(step.block.end)
        commands = tuple(
            HapticCommand(self._gate.bound(command.amplitude), command.frequency, command.time)
            for command in step.commands
        )
        if commands:
            self._renderer.submit(commands[-1])
            self._submitted = end
        if step.predictions:
            self._roughness = step.predictions[-1].roughness
        for prediction in step.predictions:
            self._floor_dbfs = _noise_floor(self._floor_dbfs, prediction)
        now = time.monotonic()
        self._deferred.mark(_DETECTED, end, now=now)
        self._deferred.publish(PipelineStep(step.block, step.predictions, commands), now=now)

    def _controls(self) -> tuple[bool, float, float, float, str, float | None]:
        """Return what may be changed from outside this thread, in the order of `Controls`, for the session log."""
        gate, pipeline = self._gate, self._endpoint.pipeline
        return (
            gate.armed, gate.ceiling, gate.output_level, pipeline.limits.ceiling, pipeline.profile.name,
            None if pipeline.follows_floor else pipeline.threshold_dbfs,
        )  # fmt: skip

    def _pull(self, size: int) -> FloatArray:
        """Return sound for a renderer of the sound itself; called in the actuator's thread."""
        return self._session.pull(size, now=time.monotonic())

    def _render(self, out: FloatArray) -> None:
        """Render one period: the actuator's callback."""
        telemetry, submitted = self._telemetry, self._submitted
        self._renderer.render(out)
        telemetry.rendered(out)
        telemetry.gauge("output_amplitude", max(float(out.max()), -float(out.min())))
        telemetry.gauge("device_period", len(out) / LIVE_SAMPLE_RATE)
        telemetry.count("callbacks")
        if submitted != self._rendered:
            self._rendered = submitted
            telemetry.mark(_RENDERED, submitted, now=time.monotonic())


def run_operator(settings: Settings, info: ProcessInfo, *, robot: str = "") -> None:
    """Run the operator's side in this process until SIGTERM; SIGUSR1 is the emergency stop."""
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    with Operator(settings, info, robot=robot) as operator:
        signal.signal(signal.SIGUSR1, lambda *_: operator.stop())
        freeze_garbage_collector()
        while not (terminated.is_set() or operator.ended.is_set() or info.orphaned):
            operator.housekeep(time.monotonic())
            operator.ended.wait(HOUSEKEEPING_INTERVAL)
    if operator.failure is not None:
        raise operator.failure


def _noise_floor(floor_dbfs: float, prediction: Prediction) -> float:
    """Smooth the level over some hundred windows without contact."""
    if prediction.touch is not Touch.NONE or not math.isfinite(prediction.level_dbfs):
        return floor_dbfs
    return prediction.level_dbfs if math.isinf(floor_dbfs) else floor_dbfs + 0.01 * (prediction.level_dbfs - floor_dbfs)


def _muted_because(settings: Settings, info: ProcessInfo) -> str:
    if info.restarts:
        return RESTARTED
    return STARTED_MUTED if settings.rendering.muted else ""
