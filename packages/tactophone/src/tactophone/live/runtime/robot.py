"""The robot's side: takes sound, encodes, encrypts and sends it.

One thread follows the sound, and one for each operator the network. They share the
sessions under one lock, each for well under a millisecond at a time, whatever arrives.
The main thread does the housekeeping.
"""

import itertools
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Self

from msgspec.structs import replace

from tactophone.core.errors import ConfigError, DeviceError
from tactophone.core.hand import channels_of, each_finger, names_of
from tactophone.core.microphones import MICROPHONES
from tactophone.core.settings import Settings
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    AudioBlock,
    LabelledSource,
    PipelineStep,
    Rehearsed,
    joined,
)
from tactophone.live.audio.pacing import paced
from tactophone.live.audio.sources import LiveSource, open_device
from tactophone.live.runtime import sessions, wiring
from tactophone.live.runtime.latency import robot_stages
from tactophone.live.runtime.priority import name_thread, prioritize_thread
from tactophone.live.runtime.recorder import LONGEST_DEFERRAL
from tactophone.live.runtime.supervisor import MOVING, NO_ANSWER, ProcessInfo, Side
from tactophone.live.runtime.wiring import OpenSource
from tactophone.live.telemetry.layout import MARKS, Fault, FingerState, RunState
from tactophone.live.telemetry.records import ARRIVAL_DIGITS
from tactophone.net.endpoints import RobotEndpoint
from tactophone.net.link.call_socket import AgentSocket, CallSocket
from tactophone.net.link.events import Event
from tactophone.net.link.identity import Peers
from tactophone.net.link.udp import UdpSocket, host_towards, resolve

ROBOT_HOUSEKEEPING = 0.05
"""Seconds between two checks of devices, counters and the parent process."""

ROBOT_RECEIVE = 0.05
"""Seconds that the network thread waits for a datagram before it polls the session."""

MOST_AT_ONCE = 8
"""Datagrams of one operator that are processed before the sound may be sent: about half
a millisecond."""

MOST_UNCHECKED = 1 << 14
"""Blocks that may wait for the check of the microphones: seconds of sound, where the
main thread is late."""

START_OPERATOR = (
    "start `tactophone receive` there; "
    "or a router blocks the port: use `tactophone call`"
)
"""Advice where an operator never answers."""

LOOK_UP_INTERVAL = 5.0
"""Seconds between two looks for the addresses of an operator that does not answer."""

# Places of this side's marks among all.
_CAPTURED = MARKS.index("captured")
_SENT = MARKS.index("sent")


class Robot(Side):
    """The robot's side while it runs; a context manager.

    - ``open_source``: opens the microphones, or what replaces them.
    - ``agent``: leads to the process that finds the path to the operator of a call; it
      replaces the addresses of the settings.
    """

    interval = ROBOT_HOUSEKEEPING

    def __init__(
        self,
        settings: Settings,
        info: ProcessInfo,
        *,
        open_source: OpenSource = open_device,
        agent: AgentSocket | None = None,
    ) -> None:
        super().__init__(settings, info, role="robot")
        self._agent = agent
        info.progress("opening the source")
        self._source = open_source(settings)
        # Asked once, as the check whether an object fits a protocol takes 25 us.
        labelled = self._source if isinstance(self._source, LabelledSource) else None
        self._truth_of: Callable[[int], int] = (
            labelled.truth_of if labelled else lambda _: -1
        )
        # A simulation compiles itself at first use.
        if isinstance(self._source, Rehearsed):
            info.progress("compiling the simulation")
            self._source.rehearse()
        if agent is None:
            # A name server may take longer to fail than a process has to start.
            info.progress(f"looking up {settings.link.peer}")
        self._group = sessions.open_send_group(
            settings, self._source.channels, in_call=agent is not None
        )
        info.progress("rehearsing")
        self._operators = sessions.operators_of(settings.link)
        fingers = each_finger(settings)
        found = self._source.channels
        wanted = len(MICROPHONES) * len(fingers)
        if settings.is_hand and found != wanted:
            raise ConfigError(
                f"the source has {found} channels, "
                f"but {len(fingers)} fingers have {wanted}, contact and air "
                "of each in turn: give --fingers as many, or another source"
            )
        channels = channels_of(settings, alone=found)
        self._microphones = MicrophoneCheck(settings, channels=channels)
        detectors = []
        if settings.link.send_predictions:
            detectors = [
                wiring.open_rehearsed_pipeline(own, channels=count).detector
                for own, count in zip(fingers, channels, strict=True)
            ]
        self._endpoint = RobotEndpoint(self._group, detectors, channels=channels)
        wiring.rehearse_encoder(self._group.encoder.codec)
        wiring.rehearse_statistics()
        # Guards the sessions, which the threads of the sound and of the network share,
        # and the log of all of them. No other lock is taken under it, and no thread
        # waits for the network or a device while it holds it.
        self._lock = threading.Lock()
        self._moving = False
        """Whether the robot moves, as the newest request says."""
        self._looked_up_at = time.monotonic()
        self._unpublished: list[AudioBlock] = []
        """Blocks that were sent and not published yet, without a gap."""

    def __enter__(self) -> Self:
        with self._resources:
            self._resources.enter_context(self._source)
            self._sockets: list[UdpSocket | CallSocket] = []
            for member in self._group.members:
                socket: UdpSocket | CallSocket = (
                    sessions.open_call(
                        self._agent, member.session, restarts=self._info.restarts
                    )
                    if self._agent
                    else UdpSocket(host_towards(member.session.callees))
                )
                self._resources.enter_context(socket)
                self._sockets.append(socket)
            self._open_telemetry()
            self._group.tap = self._log
            self._resources = self._resources.pop_all()
        networks = [
            partial(self._follow_network, operator)
            for operator in range(len(self._group.members))
        ]
        self._threads = [self._start(self._follow_sound), *map(self._start, networks)]
        if self._agent:
            self._watch_outside(None)
        else:
            self._watch_outside(self._trust, self._look_up)
        return self

    def __exit__(self, *_: object) -> None:
        self.ended.set()
        if isinstance(self._source, LiveSource):
            self._source.close()
        for thread in self._threads:
            thread.join(1.0)
        with self._lock:
            if not any(thread.is_alive() for thread in self._threads):
                self._recorder.write()
            self._group.hang_up()
            self._send_outgoing()
        self._resources.close()

    @property
    def period(self) -> float:
        return (
            self._source.device.latency if isinstance(self._source, LiveSource) else 0.0
        )

    def housekeep(self, now: float) -> None:
        for request in self._telemetry.requests(now):
            if request.action == "moving":
                self._moving = request.value > 0
        with self._lock:
            group = self._group
            counters = dict(group.counters)
            round_trip = group.round_trip
            loss = group.loss
            peers = group.peers
            link_faults = list(self._link_faults())
            hung_up = group.members[0].session.hung_up if self._agent else ""
        self._count(counters)
        self._telemetry.gauge("loss_ratio", loss)
        self._telemetry.gauge("operators", len(peers))
        if round_trip is not None:
            self._telemetry.gauge("round_trip", round_trip)
        self._update_budget(now, self._stages)
        is_hand = self._settings.is_hand
        state = RunState(
            role="robot",
            source=self._settings.capture.source,
            channels=len(MICROPHONES) if is_hand else self._source.channels,
            link=f"{hung_up} hung up" if hung_up else self._link(peers),
            faults=(
                *self._warnings,
                *self._file_faults,
                *self._device_faults(),
                *link_faults,
                *self._microphones.faults(),
            ),
            fingers=tuple(self._finger_states()),
        )
        self._telemetry.update(state, now=now)
        if hung_up:
            self._end_soon(now)

    def _trust(self, peers: Peers) -> None:
        for member in self._group.members:
            member.session.trust(peers)

    def _look_up(self) -> None:
        """Look up again the names of operators that are not connected: their machines
        may have other addresses by now."""
        now = time.monotonic()
        if now - self._looked_up_at < LOOK_UP_INTERVAL:
            return
        self._looked_up_at = now
        for member, (host, port) in zip(
            self._group.members, self._operators, strict=True
        ):
            if member.session.peer is None:
                with suppress(DeviceError):
                    addresses = resolve(host, port)
                    with self._lock:
                        member.session.call_at(addresses)

    def _stages(self) -> Mapping[str, float]:
        period = self._source.period if isinstance(self._source, LiveSource) else 0
        codec = self._group.encoder.codec
        return robot_stages(self._watcher, codec, period=period)

    def _link(self, peers: Sequence[str]) -> str:
        link = "calling"
        if peers:
            link = f"connected to {', '.join(peers)}"
            if len(self._operators) > 1:
                link += f" ({len(peers)} of {len(self._operators)} operators)"
        return link + MOVING * self._moving

    def _finger_states(self) -> Iterator[FingerState]:
        detectors = [detector.name for detector in self._endpoint.detectors]
        named = itertools.zip_longest(names_of(self._settings), detectors, fillvalue="")
        for name, detector in named:
            yield FingerState(name, muted_because="", detector=detector)

    def _link_faults(self) -> Iterator[Fault]:
        """Yield which operators are not connected, and why, which run another version,
        and what is not sent as they would have it."""
        if narrowed := self._group.narrowed:
            yield Fault("bandwidth", narrowed)
        called = zip(self._group.members, self._operators, strict=True)
        for number, (member, (host, port)) in enumerate(called, 1):
            session = member.session
            which = "" if len(self._operators) == 1 else f"-{number}"
            hung_up = self._agent and session.hung_up
            if session.peer is None and not hung_up:
                advice = NO_ANSWER if self._agent else START_OPERATOR
                reason = session.failure or advice
                where = "" if self._agent else f" at {host}:{port}"
                yield Fault(f"link{which}", f"no operator{where} yet: {reason}")
            elif conflict := session.version_conflict:
                yield Fault(f"version{which}", conflict)

    def _device_faults(self) -> Iterator[Fault]:
        if isinstance(self._source, LiveSource):
            device = self._source.device
            self._count(
                {"xruns": device.xruns, "capture_overflows": self._source.overflows}
            )
            if device.fault:
                yield Fault("microphones", device.fault)

    def _follow_sound(self) -> None:
        self._prepare_thread("tactophone-snd")
        recorded = self._settings.capture.source == "file"
        if recorded:
            self._await_operator()
        sound: Iterable[AudioBlock]
        if isinstance(self._source, LiveSource):
            # Until a packet is complete there is nothing to do, unless predictions are
            # made here.
            sound = self._source.joined(
                lambda: 1 if self._endpoint.detectors else self._group.encoder.missing
            )
        else:
            sound = paced(self._source, skip=recorded)
        for block in sound:
            if self.ended.is_set():
                return
            self._send(block)

    def _await_operator(self) -> None:
        """Hold a recording back until an operator is connected: unlike a microphone, it
        has a beginning."""
        while not self.ended.wait(ROBOT_HOUSEKEEPING):
            with self._lock:
                if self._group.connected:
                    return

    def _send(self, block: AudioBlock) -> None:
        captured = time.monotonic()
        if self._moving:
            block = replace(block, moving=True)
        with self._lock:
            steps = self._endpoint.push(block)
            self._send_outgoing()
            origin = self._group.origin
        now = time.monotonic()
        sent = self._sent_up_to(block, steps)
        if origin is not None and sent is not None:
            position = (origin + sent) % (1 << 32)
            self._recorder.mark(position, (_CAPTURED, captured), (_SENT, now))
        for step in steps if self._endpoint.detectors else self._steps_of(block):
            self._recorder.publish(step, now=now, truth=self._truth_of(step.finger))
            self._microphones.collect(step)
        if self._recorder.due(now):
            # The threads of sound and network both log the packets of the session, so
            # its lock guards the recorder too.
            with self._lock:
                self._recorder.write()

    def _sent_up_to(
        self, block: AudioBlock, steps: Sequence[PipelineStep]
    ) -> int | None:
        """Return up to which sample something was sent; ``None`` if nothing was."""
        if not self._endpoint.detectors:
            return block.end
        # A prediction is marked with the end of its window, the only time of it that
        # the operator knows.
        for step in steps:
            if step.predictions:
                return round(step.predictions[-1].end * LIVE_SAMPLE_RATE)
        return None

    def _steps_of(self, block: AudioBlock) -> list[PipelineStep]:
        """Return the steps of many blocks at once, now and then; in between, return
        none."""
        self._unpublished.append(block)
        if block.end - self._unpublished[0].start < LONGEST_DEFERRAL * LIVE_SAMPLE_RATE:
            return []
        blocks = self._unpublished
        self._unpublished = []
        return [step for part in joined(blocks) for step in self._endpoint.steps(part)]

    def _log(self, event: Event) -> None:
        """Log a packet or a change of the connection; called under the lock of the
        session."""
        self._recorder.arrival(round(time.monotonic(), ARRIVAL_DIGITS), [event])

    def _follow_network(self, operator: int) -> None:
        name_thread("tactophone-net")
        prioritize_thread(self._settings.process.priority)
        session = self._group.members[operator].session
        socket = self._sockets[operator]
        while not self.ended.is_set():
            datagrams = socket.receive(ROBOT_RECEIVE)
            now = time.monotonic()
            # The lock is given back after a few: whatever an operator sends, the sound
            # for the others waits for no more than these.
            for start in range(0, len(datagrams), MOST_AT_ONCE):
                with self._lock:
                    self._group.receive(
                        datagrams[start : start + MOST_AT_ONCE],
                        now=now,
                        operator=operator,
                    )
            with self._lock:
                self._group.poll(now, operator=operator)
                sessions.send_outgoing(session, socket)

    def _send_outgoing(self) -> None:
        for member, socket in zip(self._group.members, self._sockets, strict=True):
            sessions.send_outgoing(member.session, socket)


def run_robot(
    settings: Settings,
    info: ProcessInfo,
    *,
    open_source: OpenSource = open_device,
    agent: AgentSocket | None = None,
) -> None:
    """Run the robot's side in this process until SIGTERM or the end of the sound; in a
    call, until either end hangs up."""
    terminated = threading.Event()
    note = partial(signal.signal, signal.SIGTERM, lambda *_: terminated.set())
    # A process that waits for the path of a call has nothing to end in order: SIGTERM
    # ends it at once until then.
    if agent is None:
        note()
    # The emergency stop is the operator's; on the robot nothing vibrates.
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)
    with Robot(settings, info, open_source=open_source, agent=agent) as robot:
        note()
        robot.run(terminated)


class MicrophoneCheck:
    """Checks the microphones on the robot, where no codec has changed the sound yet.

    The thread of the sound only collects blocks: to measure them takes as long as
    several packets, eight times a second. ``channels``: how many each finger has.
    """

    def __init__(self, settings: Settings, *, channels: Sequence[int]) -> None:
        fingers = zip(each_finger(settings), channels, strict=True)
        self._checks = [
            wiring.open_microphone_check(own, channels=count) for own, count in fingers
        ]
        self._names = names_of(settings)
        self._waiting: deque[PipelineStep] = deque(maxlen=MOST_UNCHECKED)

    def collect(self, step: PipelineStep) -> None:
        if self._checks[step.finger]:
            self._waiting.append(step)

    def faults(self) -> Iterator[Fault]:
        """Measure the sound since the last call, and yield what is wrong with each
        finger's microphones."""
        while self._waiting:
            step = self._waiting.popleft()
            if check := self._checks[step.finger]:
                check.push(step.block)
        for name, check in zip(self._names, self._checks, strict=True):
            if check is None:
                continue
            for fault in check.faults:
                yield wiring.finger_fault(name, fault.code, str(fault))
