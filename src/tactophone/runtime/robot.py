"""The robot's side: takes sound, encodes, encrypts and sends it.

One thread follows the sound, and one for each operator the network. They share the sessions under one lock, each for
well under a millisecond at a time, whatever arrives. The main thread does the housekeeping.
"""

import dataclasses
import itertools
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from functools import partial
from typing import Self

from tactophone.capture import LiveSource
from tactophone.endpoints import RobotEndpoint
from tactophone.errors import ConfigError
from tactophone.hand import channels_of, each_finger, names_of
from tactophone.link import Event, UdpSocket
from tactophone.runtime.deferred_telemetry import DeferredTelemetry
from tactophone.runtime.device_wiring import OpenSource, open_device
from tactophone.runtime.latency_budget import robot_stages
from tactophone.runtime.link_wiring import open_send_group, operators_of, send_outgoing
from tactophone.runtime.microphone_check import MicrophoneCheck
from tactophone.runtime.realtime_playback import paced
from tactophone.runtime.realtime_priority import lock_memory, name_thread, prioritize_thread
from tactophone.runtime.rehearsal import open_rehearsed_pipeline, rehearse_encoder, rehearse_statistics
from tactophone.runtime.session_recorder import SessionRecorder
from tactophone.runtime.source_abilities import RehearsableSource, truth_of
from tactophone.runtime.supervisor import ProcessInfo, run_housekeeping
from tactophone.settings import Settings
from tactophone.telemetry import ARRIVAL_DIGITS, MARKS, Fault, FingerState, State, Telemetry, Watcher
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock

HOUSEKEEPING_INTERVAL = 0.05
"""Seconds between two checks of devices, counters and the parent process."""

BUDGET_INTERVAL = 1.0
"""Seconds between two updates of the latency budget."""

LONGEST_RECEIVE = 0.05
"""Seconds that the network thread waits for a datagram before it polls the session."""

MOST_AT_ONCE = 8
"""Datagrams of one operator that are processed before the sound may be sent: about half a millisecond."""

_CAPTURED, _SENT = MARKS.index("captured"), MARKS.index("sent")


class Robot:
    """The robot's side while it runs; a context manager.

    Parameters
    ----------
    open_source
        Opens the microphones, or what replaces them.
    """

    def __init__(self, settings: Settings, info: ProcessInfo, *, open_source: OpenSource = open_device) -> None:
        self.ended = threading.Event()
        self.failure: BaseException | None = None
        self._settings = settings
        self._resources = ExitStack()
        info.progress("opening the source")
        self._source = open_source(settings)
        self._truth_of = truth_of(self._source)
        if isinstance(self._source, RehearsableSource):
            info.progress("compiling the simulation")
            self._source.rehearse()
        info.progress("rehearsing")
        self._group = open_send_group(settings, self._source.channels)
        self._operators = operators_of(settings.link)
        fingers = self._check_fingers()
        channels = channels_of(settings, alone=self._source.channels)
        self._microphones = MicrophoneCheck(settings, channels=channels)
        predicting = zip(fingers, channels, strict=True) if settings.link.send_predictions else ()
        detectors = [open_rehearsed_pipeline(own, channels=count).detector for own, count in predicting]
        self._endpoint = RobotEndpoint(self._group, detectors, channels=channels)
        rehearse_encoder(self._group.codec)
        rehearse_statistics()
        self._lock = threading.Lock()
        self._info = info
        self._budgeted_at = 0.0
        self._warnings: tuple[Fault, ...] = ()
        networks = [partial(self._follow_network, operator) for operator in range(len(self._group.members))]
        self._threads = [
            threading.Thread(target=self._run, args=(work,), daemon=True) for work in (self._follow_sound, *networks)
        ]

    def __enter__(self) -> Self:
        with self._resources:
            self._resources.enter_context(self._source)
            self._sockets = [self._resources.enter_context(UdpSocket()) for _ in self._operators]
            self._telemetry = self._resources.enter_context(
                Telemetry(self._info.name, fingers=len(self._settings.fingers))
            )
            self._telemetry.count("process_restarts", self._info.restarts)
            # Opened once: whoever removes the file from the file system takes the watchers away, not this process.
            self._watcher = Watcher(self._info.name)
            self._recorder = SessionRecorder(self._telemetry, self._settings, role="robot")
            self._deferred = DeferredTelemetry(self._telemetry, self._recorder)
            self._group.tap = self._log
            self._resources = self._resources.pop_all()
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        if isinstance(self._source, LiveSource):
            self._source.close()
        for thread in self._threads:
            thread.join(1.0)
        with self._lock:
            if not any(thread.is_alive() for thread in self._threads):
                self._deferred.write()
            self._group.hang_up()
            self._send_outgoing()
        self._resources.close()

    def housekeep(self, now: float) -> None:
        """Update telemetry; call it every `HOUSEKEEPING_INTERVAL`."""
        with self._lock:
            group = self._group
            counters, round_trip, loss = dict(group.counters), group.round_trip, group.loss
            peers, link_faults = group.peers, list(self._link_faults())
        for name, total in counters.items():
            self._telemetry.count(name, total - self._telemetry.counter(name))
        self._telemetry.gauge("loss_ratio", loss)
        self._telemetry.gauge("operators", len(peers))
        if round_trip is not None:
            self._telemetry.gauge("round_trip", round_trip)
        if now - self._budgeted_at >= BUDGET_INTERVAL:
            self._budgeted_at = now
            period = self._source.period if isinstance(self._source, LiveSource) else 0
            for stage, duration in robot_stages(self._watcher, self._group.codec, period=period).items():
                self._telemetry.gauge(f"latency_{stage}", duration)
        faults = (*self._warnings, *self._device_faults(), *link_faults, *self._microphones.faults())
        of_all = f" ({len(peers)} of {len(self._operators)} operators)" if len(self._operators) > 1 else ""
        link = f"connected to {', '.join(peers)}{of_all}" if peers else "calling"
        self._telemetry.update(dataclasses.replace(self._state(), link=link, faults=faults), now=now)

    def _link_faults(self) -> Iterator[Fault]:
        """Yield which operators are not connected, and why, and which run another version."""
        for number, (member, (host, port)) in enumerate(zip(self._group.members, self._operators, strict=True), 1):
            which = "" if len(self._operators) == 1 else f"-{number}"
            if member.session.peer is None:
                reason = member.session.failure or "start `tactophone receive` there"
                yield Fault(f"link{which}", f"no operator at {host}:{port} yet: {reason}")
            elif conflict := member.session.version_conflict:
                yield Fault(f"version{which}", conflict)

    def _state(self) -> State:
        capture, detectors = self._settings.capture, [each.name for each in self._endpoint.detectors]
        return State(
            role="robot",
            source=capture.source,
            channels=self._source.channels if not self._settings.is_hand else 2,
            fingers=tuple(
                FingerState(name, muted_because="", detector=detector)
                for name, detector in itertools.zip_longest(names_of(self._settings), detectors, fillvalue="")
            ),
        )

    def _check_fingers(self) -> list[Settings]:
        """Return the settings of each finger; `ConfigError` where the source has the sound of another number."""
        fingers, found = each_finger(self._settings), self._source.channels
        if self._settings.is_hand and found != 2 * len(fingers):
            raise ConfigError(
                f"the source has {found} channels, but {len(fingers)} fingers have {2 * len(fingers)}, contact and air "
                "of each in turn: give --fingers as many, or another source"
            )
        return fingers

    def _device_faults(self) -> Iterator[Fault]:
        if isinstance(self._source, LiveSource):
            device = self._source.device
            self._telemetry.count("xruns", device.xruns - self._telemetry.counter("xruns"))
            missed = self._source.overflows - self._telemetry.counter("capture_overflows")
            self._telemetry.count("capture_overflows", missed)
            if device.fault:
                yield Fault("microphones", device.fault)

    def _run(self, work: Callable[[], None]) -> None:
        """Run one thread's work; its end ends the whole side, and the operator's renderer fades to silence."""
        try:
            work()
        except BaseException as error:
            self.failure = error
        self.ended.set()

    def _follow_sound(self) -> None:
        name_thread("tactophone-snd")
        self._warn("priority", prioritize_thread(self._settings.process.priority))
        if self._settings.process.lock_memory:
            self._warn("memory", lock_memory())
        if self._settings.capture.source == "file":
            self._await_operator()
        recorded = self._settings.capture.source == "file"
        sound: Iterable[AudioBlock]
        if isinstance(self._source, LiveSource):
            # Until a packet is complete there is nothing to do, unless predictions are made here.
            sound = self._source.joined(lambda: 1 if self._endpoint.detectors else self._group.missing)
        else:
            sound = paced(self._source, skip=recorded)
        for block in sound:
            if self.ended.is_set():
                return
            self._send(block)

    def _await_operator(self) -> None:
        """Hold a recording back until an operator is connected: unlike a microphone, it has a beginning."""
        while not self.ended.wait(HOUSEKEEPING_INTERVAL):
            with self._lock:
                if self._group.connected:
                    return

    def _send(self, block: AudioBlock) -> None:
        captured = time.monotonic()
        with self._lock:
            steps = self._endpoint.push(block)
            self._send_outgoing()
            origin = self._group.origin
        now = time.monotonic()
        # A prediction is marked with the end of its window, the only time of it that the operator knows.
        ends = [round(step.predictions[-1].end * LIVE_SAMPLE_RATE) for step in steps if step.predictions]
        if origin is not None and (ends or not self._endpoint.detectors):
            position = (origin + (ends[0] if ends else block.end)) % (1 << 32)
            self._deferred.mark(position, (_CAPTURED, captured), (_SENT, now))
        for step in steps:
            self._deferred.publish(step, now=now, truth=self._truth_of(step.finger))
            self._microphones.collect(step)
        if self._deferred.due(now):
            # The lock is that of the session, whose packets of both threads are logged.
            with self._lock:
                self._deferred.write()

    def _log(self, event: Event) -> None:
        """Log a packet or a change of the connection; called under the lock of the session."""
        self._recorder.arrival(round(time.monotonic(), ARRIVAL_DIGITS), [event])

    def _follow_network(self, operator: int) -> None:
        name_thread("tactophone-net")
        prioritize_thread(self._settings.process.priority)
        session, socket = self._group.members[operator].session, self._sockets[operator]
        while not self.ended.is_set():
            datagrams = socket.receive(LONGEST_RECEIVE)
            now = time.monotonic()
            # A few at a time: whatever an operator sends, the sound for the others waits for no more than these.
            for start in range(0, len(datagrams), MOST_AT_ONCE):
                with self._lock:
                    self._group.receive(datagrams[start : start + MOST_AT_ONCE], now=now, operator=operator)
            with self._lock:
                self._group.poll(now, operator=operator)
                send_outgoing(session, socket)

    def _send_outgoing(self) -> None:
        for member, socket in zip(self._group.members, self._sockets, strict=True):
            send_outgoing(member.session, socket)

    def _warn(self, code: str, warning: str) -> None:
        if warning:
            self._warnings = (*self._warnings, Fault(code, warning))


def run_robot(settings: Settings, info: ProcessInfo, *, open_source: OpenSource = open_device) -> None:
    """Run the robot's side in this process until SIGTERM or the end of the sound."""
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # the emergency stop is the operator's; here nothing vibrates
    with Robot(settings, info, open_source=open_source) as robot:
        run_housekeeping(
            robot, terminated=terminated, interval=HOUSEKEEPING_INTERVAL, priority=settings.process.priority
        )
    if robot.failure is not None:
        raise robot.failure
