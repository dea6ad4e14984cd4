"""The operator's side: receives datagrams, runs the pipeline on their sound and drives
the actuator.

The network thread does everything from datagram to command, on arrival. The actuator's
own thread renders the newest command. They share one slot, and neither ever waits for
the other. The main thread updates telemetry, and applies the requests in telemetry's
mailbox as far as the output gate allows.

No lock is taken: each attribute that two threads share is written by one of them, in
one assignment.
"""

import itertools
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Self

import numpy as np

from tactophone.core.hand import each_finger, names_of
from tactophone.core.settings import Settings
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray, PipelineStep
from tactophone.live.runtime import sessions, wiring
from tactophone.live.runtime.latency import LocalPeer, operator_stages
from tactophone.live.runtime.output_gate import RESTARTED, STARTED_MUTED, FingerOutput
from tactophone.live.runtime.supervisor import MOVING, NO_ANSWER, ProcessInfo, Side
from tactophone.live.telemetry.layout import (
    MARKS,
    Action,
    Fault,
    FingerState,
    RunState,
)
from tactophone.live.telemetry.records import ARRIVAL_DIGITS
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.call_socket import AgentSocket, CallSocket
from tactophone.net.link.receive import PredictionReceived, ReceiveEvent, ReceiveSession
from tactophone.net.link.stream import DecodedAudio
from tactophone.net.link.udp import UdpSocket
from tactophone.signal.perception.opening import tip_warning

OPERATOR_HOUSEKEEPING = 0.02
"""Seconds between two checks of the mailbox."""

COUNTING_INTERVAL = 0.1
"""Seconds between two updates of counters, gauges and state: no page is drawn more
often."""

OPERATOR_RECEIVE = 0.007
"""Seconds that the network thread waits for a datagram: more than from one packet of 5
ms to the next, which is 5.3 ms where a period has 128 samples."""

OPERATOR_POLL = 0.005
"""Seconds that the network thread waits for a datagram before it gives up on a missing
packet: a packet's length."""

SESSION_INTERVAL = 0.025
"""Seconds between two polls of the session while packets come in order: its own times
are ten times as long."""

LONGEST_CALL = 5.0
"""Seconds that a robot may take to connect before its absence is reported as a fault.

A robot that starts at the same moment (`loopback`, `try`, `play`) takes 3 to 4 on a
busy machine."""

SILENT_LINK = 0.5
"""Seconds without sound or predictions after which the connected link is reported as
silent."""

SENT_AWAY_SHOWN = 10.0
"""Seconds for which a second robot is reported after its call; it calls every few
seconds."""

START_ROBOT = (
    "start `tactophone send` there; or a router blocks the port: use `tactophone call`"
)
"""Advice where no robot ever calls."""

SAME_MACHINE = (
    "the robot's process, which this command started, is still starting; "
    "a busy machine takes longer"
)
"""Advice where both sides began together: there is nothing to start."""

INHERITED: Mapping[Action, Action] = {
    "stop": "stop",
    "ceiling": "lower_ceiling",
    "lower_ceiling": "lower_ceiling",
    "output_level": "lower_output_level",
    "lower_output_level": "lower_output_level",
}
"""What a process obeys of the requests that the one before it may not have come to, and
as what: it gets no stronger by them."""

# Places of this side's marks among all.
_RECEIVED = MARKS.index("received")
_RELEASED = MARKS.index("released")
_DECODED = MARKS.index("decoded")
_DETECTED = MARKS.index("detected")
_RENDERED = MARKS.index("rendered")


class Operator(Side):
    """The operator's side while it runs; a context manager.

    - ``robot``: name of the robot's run, if it is on this machine: source of the true
      touch and of the robot's part of the latency budget.
    - ``agent``: leads to the process that finds the path to the robot of a call; it
      replaces the port of the settings.
    """

    interval = OPERATOR_HOUSEKEEPING

    def __init__(
        self,
        settings: Settings,
        info: ProcessInfo,
        *,
        robot: str = "",
        agent: AgentSocket | None = None,
    ) -> None:
        super().__init__(settings, info, role="operator")
        self._agent = agent
        fingers = each_finger(settings)
        renderers = [
            wiring.open_renderer(own, self._pull, hand=settings.is_hand)
            for own in fingers
        ]
        self._actuator = wiring.open_actuator(
            settings,
            self._render,
            roughness=lambda: self._fingers[0].roughness,
            ceiling=lambda: self._fingers[0].gate.limits.ceiling,
            resume=info.restarts > 0,
        )
        self._dtls_session = sessions.open_session(settings, in_call=agent is not None)
        self._session = ReceiveSession(self._dtls_session)
        info.progress("opening the models")
        self._endpoint = wiring.open_endpoint(settings, self._session)
        # A process that replaces a failed one never vibrates by itself: its predecessor
        # may have ended because of it.
        muted_because = ""
        if info.restarts:
            muted_because = RESTARTED
        elif settings.rendering.muted:
            muted_because = STARTED_MUTED
        self._fingers = [
            FingerOutput(
                own,
                renderer,
                self._endpoint,
                index=index,
                name=name,
                muted_because=muted_because,
                before=info.fingers[index] if info.fingers else None,
            )
            for index, (own, renderer, name) in enumerate(
                zip(fingers, renderers, names_of(settings), strict=True)
            )
        ]
        warnings = [tip_warning(own) for own in fingers]
        # The fingers of a hand mostly wear one kind of tip: each warning stands once.
        self._tip_warning = "; ".join(dict.fromkeys(filter(None, warnings)))
        info.progress("rehearsing")
        # The first period takes longer than any other, so it is rendered for nobody.
        for finger in self._fingers:
            finger.renderer.render(np.zeros(settings.output.period, np.float32))
            finger.renderer.reset()
        wiring.rehearse_statistics()
        info.progress("opening the actuator and the port")
        self._session.bandwidth = round(
            max(finger.pipeline.detector.bandwidth for finger in self._fingers)
        )
        self._local_robot = LocalPeer(robot)
        self._submitted = 0
        """RTP timestamp of the sound behind the newest command; written by the network
        thread."""
        self._rendered = 0
        """RTP timestamp of the sound behind the newest command that was rendered;
        written by the actuator's thread."""
        self._stopped = False
        """Whether `stop` was called since the mailbox was last read."""
        self._losses = 0
        """How often the device was lost when it was last looked at."""
        self._period = 0
        """Samples of the newest period."""
        self._counted_at = 0.0
        self._shown: tuple[tuple[str, bool], ...] = ()
        """Of each finger, why it is muted and whether it buzzes, as shown last."""
        # Written by the network thread, whole, for the main thread to publish.
        self._counters: Mapping[str, int] = {}
        self._gauges: Mapping[str, float] = {}
        self._received_at = time.monotonic()

    def __enter__(self) -> Self:
        with self._resources:
            link = self._settings.link
            self._socket: UdpSocket | CallSocket = (
                sessions.open_call(
                    self._agent, self._dtls_session, restarts=self._info.restarts
                )
                if self._agent
                else UdpSocket(link.host, link.port, answers=True)
            )
            self._resources.enter_context(self._socket)
            name = self._info.name
            before = Watcher.find(name) if self._info.restarts else None
            self._open_telemetry()
            if before:
                self._inherit(before)
            # Whoever stops it finds it before it can vibrate. Without a beat it is
            # still starting.
            self._telemetry.update(self._starting(), now=0.0)
            self._session.tap = self._recorder.arrival
            self._resources.enter_context(self._actuator)
            self._resources = self._resources.pop_all()
        # A stop that came during the start has waited until here (`core.processes`):
        # JACK's library takes a signal for a lost server, and nothing vibrates before
        # the network's thread begins.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})
        self._thread = self._start(self._follow_network)
        self._watch_outside(None if self._agent else self._dtls_session.trust)
        return self

    def __exit__(self, *_: object) -> None:
        # Silence comes first: whatever follows may take time or fail.
        self._silence()
        self.ended.set()
        self._thread.join(1.0)
        if not self._thread.is_alive():
            self._recorder.write()
        self._dtls_session.hang_up()
        sessions.send_outgoing(self._dtls_session, self._socket)
        self._resources.close()

    def _inherit(self, before: Watcher) -> None:
        """Obey what was asked while the process before this one stood still, and until
        this one had telemetry."""
        requests = [
            replace(request, action=INHERITED[request.action])
            for request in before.left_requests()
            if request.action in INHERITED
        ]
        for finger in self._fingers:
            finger.apply(requests)

    def stop(self) -> None:
        """Stop all fingers at once, and stay stopped until armed; may be called from a
        signal handler."""
        for finger in self._fingers:
            finger.stop()
        self._stopped = True

    @property
    def period(self) -> float:
        return self._period / LIVE_SAMPLE_RATE

    def housekeep(self, now: float) -> None:
        if self._stopped:
            self._stopped = False
            # Whoever holds Resume learns of a stop from the mailbox.
            self._watcher.ask("stop")
        requests = self._telemetry.requests(now)
        refused = {
            (finger.index, action)
            for finger in self._fingers
            for action in finger.apply(requests)
        }
        self._telemetry.count("requests_refused", len(refused))
        shown = tuple(
            (finger.gate.muted_because, finger.buzzing) for finger in self._fingers
        )
        # A change is shown at once, counters and gauges only now and then.
        changed = self._revive() or requests or shown != self._shown
        self._shown = shown
        if not changed and now - self._counted_at < COUNTING_INTERVAL:
            return
        self._counted_at = now
        self._update_counts()
        self._update_budget(now, self._stages)
        self._telemetry.update(self._state(now), now=now)
        if self._hung_up:
            self._silence()
            self._end_soon(now)

    @property
    def _hung_up(self) -> str:
        """Name of the robot that has ended the call; empty while nobody has."""
        return self._dtls_session.hung_up if self._agent else ""

    def _revive(self) -> bool:
        """Reconnect a lost device; what it rendered last is not taken up again. Returns
        whether it was lost anew."""
        device = self._actuator.device
        lost = device.losses != self._losses
        if lost:
            self._losses = device.losses
            for finger in self._fingers:
                finger.renderer.reset()
            # The watchdog counts as late only what vibrates.
            self._telemetry.gauge("output_amplitude", 0.0)
        if device.lost:
            # To reconnect it may take seconds, in which somebody may stop: it renders
            # nothing until the next look at the mailbox, which releases what is armed.
            self._silence()
        device.revive()
        return lost

    def _update_counts(self) -> None:
        device = self._actuator.device
        faults = Counter[str]()
        invalid = Counter[str]()
        for finger in self._fingers:
            faults.update(finger.renderer.faults)
            invalid.update(finger.pipeline.detector.faults)
        counts = {
            **self._counters,
            "xruns": device.xruns,
            "callback_faults": device.process_faults,
            "device_losses": device.losses,
            "command_faults": faults["command"],
            "stale_fades": faults["stale"],
            "emergency_stops": max(finger.gate.stops for finger in self._fingers),
            "sound_faults": invalid["sound"],
            "model_faults": invalid["model"],
        }
        self._count(counts)
        for name, value in {**self._gauges, "device_latency": device.latency}.items():
            self._telemetry.gauge(name, value)

    def _stages(self) -> Mapping[str, float]:
        self._local_robot.refresh()
        playout = self._session.playout
        sound_delay = 0.0
        if playout:
            buffered = playout.controller.margin + playout.latency
            sound_delay = buffered + self._fingers[0].renderer.latency
        return operator_stages(
            self._watcher,
            self._local_robot.watcher,
            self._actuator.device.latency,
            sound_delay=sound_delay,
        )

    def _starting(self) -> RunState:
        """Return the state in which no device is open yet."""
        starting = FingerState().muted_because
        states = (finger.state() for finger in self._fingers)
        fingers = tuple(
            replace(each, armed=False, muted_because=each.muted_because or starting)
            for each in states
        )
        return RunState(role="operator", fingers=fingers)

    def _state(self, now: float) -> RunState:
        return RunState(
            role="operator",
            profiles=self._fingers[0].profiles,
            link=self._link(),
            output=self._settings.output.actuator,
            faults=tuple(self._faults(now)),
            fingers=tuple(finger.state() for finger in self._fingers),
        )

    def _link(self) -> str:
        if self._hung_up:
            return f"{self._hung_up} hung up"
        if peer := self._session.peer:
            return f"connected to {peer}{MOVING * self._session.moving}"
        if isinstance(self._socket, CallSocket):
            return "waiting for the robot"
        return f"listening at port {self._socket.address[1]}"

    def _faults(self, now: float) -> Iterator[Fault]:
        yield from self._warnings
        yield from self._file_faults
        if self._actuator.device.fault:
            yield Fault("actuator", self._actuator.device.fault)
        for finger in self._fingers:
            yield from wiring.microphone_faults(
                finger.pipeline.detector, finger=finger.name
            )
        silent = now - self._received_at
        if self._endpoint.refusal:
            yield Fault(
                "refused", f"the robot's sound cannot be used: {self._endpoint.refusal}"
            )
        if self._session.peer:
            reason = self._why_silent() if silent > SILENT_LINK else ""
            if reason:
                yield Fault("silence", reason)
        elif silent > LONGEST_CALL and not self._hung_up:
            reason = self._dtls_session.failure or self._why_absent()
            yield Fault("link", f"no robot is connected: {reason}")
        if conflict := self._dtls_session.version_conflict:
            yield Fault("version", conflict)
        sent_away = self._dtls_session.sent_away
        if sent_away and now - sent_away[1] < SENT_AWAY_SHOWN:
            yield Fault("second_robot", self._why_sent_away(sent_away[0]))

    def _why_sent_away(self, name: str) -> str:
        """Return which robot called beside the one that is connected, and what to
        do."""
        if name == self._session.peer:
            return (
                f"another machine called with the key of {name!r} and was sent away: "
                "delete the key of one of the two, and run `tactophone pair init` there"
            )
        return f"{name!r} called too and was sent away: stop one of the two robots"

    def _why_absent(self) -> str:
        """Return why probably no robot has connected, and what to do."""
        if self._agent:
            return NO_ANSWER
        if self._local_robot.name:
            return SAME_MACHINE
        return START_ROBOT

    def _why_silent(self) -> str:
        """Return why no sound comes; empty until a page is the microphone for the first
        time."""
        if self._settings.capture.source != "browser":
            return (
                "connected, but the robot sends no sound: "
                "check its microphones and the network"
            )
        if self._telemetry.counter("packets_received") == 0:
            return ""
        return "no page sends sound: press Use this microphone on the one that listens"

    def _silence(self) -> None:
        for finger in self._fingers:
            finger.renderer.stop()

    def _follow_network(self) -> None:
        self._prepare_thread("tactophone-net", other_tip=self._tip_warning)
        checked_at = 0.0
        polled_at = 0.0
        while not self.ended.is_set():
            # Only a packet that waits for an earlier one makes it worth waking before
            # the next arrives.
            datagrams = self._socket.receive(
                OPERATOR_POLL if self._session.waiting else OPERATOR_RECEIVE
            )
            received = round(time.monotonic(), ARRIVAL_DIGITS)
            for finger in self._fingers:
                finger.buzz(received)
                if finger.changed():
                    self._recorder.controls(*finger.controls(), finger=finger.index)
            steps = self._endpoint.receive(datagrams, now=received)
            polled = (
                not datagrams
                or self._session.waiting
                or received - polled_at >= SESSION_INTERVAL
            )
            if polled:
                polled_at = received
                steps = itertools.chain(steps, self._endpoint.poll(received))
            # Everything is decoded now. Each step is computed when the loop comes to
            # it, so ``decoded`` is the moment from which its sound could be processed.
            decoded = time.monotonic()
            origin = self._session.origin
            step: PipelineStep | None = None
            waited = False
            for number, (event, step) in enumerate(steps, 1):
                waited = step is None and isinstance(event, DecodedAudio)
                if not waited and (step is None or not step.finger):
                    self._mark_arrival(
                        event, origin, received=received, decoded=decoded
                    )
                if step is not None:
                    self._submit(step, origin)
                    finger = self._fingers[step.finger]
                    if finger.changed():
                        self._recorder.controls(
                            *finger.controls(), step=number, finger=finger.index
                        )
                self._received_at = received
                decoded = time.monotonic()
            if self._endpoint.refusal and self._session.peer:
                self._dtls_session.hang_up(
                    f"the operator cannot use this sound: {self._endpoint.refusal}"
                )
            # Sound is not answered; what else there is to send after sound may wait for
            # the next poll.
            if polled or (step is None and not waited):
                sessions.send_outgoing(self._dtls_session, self._socket)
            # What the commands did not need is written now, when the thread would only
            # wait for the next packet.
            if self._recorder.due(received):
                self._recorder.write(self._local_robot.truth)
            if received - checked_at >= COUNTING_INTERVAL:
                checked_at = received
                self._counters = dict(self._session.counters)
                self._gauges = dict(self._session.gauges)

    def _mark_arrival(
        self, event: ReceiveEvent, origin: int, *, received: float, decoded: float
    ) -> None:
        if isinstance(event, DecodedAudio):
            samples = event.block.end
            waited = event.waited
        elif isinstance(event, PredictionReceived):
            samples = round(event.prediction.end * LIVE_SAMPLE_RATE)
            waited = 0.0
        else:
            return
        position = (origin + samples) % (1 << 32)
        self._recorder.mark(
            position,
            (_RECEIVED, received - waited),
            (_RELEASED, received),
            (_DECODED, decoded),
        )

    def _submit(self, step: PipelineStep, origin: int) -> None:
        bounded = self._fingers[step.finger].submit(step)
        end = (origin + step.block.end) % (1 << 32)
        if bounded.commands:
            self._submitted = end
        now = time.monotonic()
        if step.finger == len(self._fingers) - 1:
            # A hand has passed a stage when its last finger has.
            self._recorder.mark(end, (_DETECTED, now))
        self._recorder.publish(bounded, now=now)

    def _pull(self, size: int) -> FloatArray:
        """Return sound for a renderer of the sound itself; called in the actuator's
        thread."""
        return self._session.pull(size, now=time.monotonic())

    def _render(self, outs: Sequence[FloatArray]) -> None:
        """Render one period of every finger: the actuators' one callback."""
        telemetry = self._telemetry
        submitted = self._submitted
        amplitude = 0.0
        for finger, out in zip(self._fingers, outs, strict=True):
            finger.renderer.render(out)
            telemetry.rendered(out, finger=finger.index)
            if not finger.renderer.silent:
                # `out.max()` is a function in Python around this, and slower.
                highest = float(np.maximum.reduce(out))
                lowest = float(np.minimum.reduce(out))
                amplitude = max(amplitude, highest, -lowest)
        telemetry.gauge("output_amplitude", amplitude)
        telemetry.count("callbacks")
        if len(outs[0]) != self._period:
            self._period = len(outs[0])
            telemetry.gauge("device_period", self.period)
        if submitted != self._rendered:
            self._rendered = submitted
            telemetry.mark((_RENDERED, submitted, time.monotonic()))


def run_operator(
    settings: Settings,
    info: ProcessInfo,
    *,
    robot: str = "",
    agent: AgentSocket | None = None,
) -> None:
    """Run the operator's side in this process until SIGTERM. SIGUSR1 is the emergency
    stop."""
    terminated = threading.Event()
    note = partial(signal.signal, signal.SIGTERM, lambda *_: terminated.set())
    # A process that waits for the path of a call has nothing to end in order: SIGTERM
    # ends it at once until then.
    if agent is None:
        note()
    operator = Operator(settings, info, robot=robot, agent=agent)
    signal.signal(signal.SIGUSR1, lambda *_: operator.stop())
    with operator:
        note()
        operator.run(terminated)
