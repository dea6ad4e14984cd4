"""What watchers are shown of the operator's side: its counts, its latency budget, its state and its faults."""

import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from tactophone.endpoints import OperatorEndpoint
from tactophone.haptics import Actuator
from tactophone.runtime.finger_output import FingerOutput
from tactophone.runtime.latency_budget import LocalPeer, operator_stages
from tactophone.runtime.microphone_check import microphone_faults
from tactophone.settings import Settings
from tactophone.telemetry import Fault, State, Telemetry, Watcher

BUDGET_INTERVAL = 1.0
"""Seconds between two updates of the latency budget."""

LONGEST_CALL = 2.0
"""Seconds that a robot may take to connect before its absence is reported as a fault."""

SILENT_LINK = 0.5
"""Seconds without sound or predictions after which the connected link is reported as silent."""

SENT_AWAY_SHOWN = 10.0
"""Seconds for which a second robot is reported after its call; it calls every few seconds."""


class OperatorStatus:
    """Copies what has become of the operator's side into telemetry; the main thread updates it.

    Attributes
    ----------
    counters, gauges
        Of the session, as the network thread has copied them.
    received_at
        When that thread received sound or a prediction last, in s.
    warnings
        What it found wrong when it began.
    """

    def __init__(
        self,
        settings: Settings,
        endpoint: OperatorEndpoint,
        fingers: Sequence[FingerOutput],
        actuator: Actuator,
        telemetry: Telemetry,
        *,
        own: Watcher,
        robot: LocalPeer,
        port: int,
    ) -> None:
        self.counters: Mapping[str, int] = {}
        self.gauges: Mapping[str, float] = {}
        self.received_at = time.monotonic()
        self.warnings: tuple[Fault, ...] = ()
        self._settings, self._endpoint, self._session = settings, endpoint, endpoint.session
        self._fingers, self._actuator = fingers, actuator
        self._telemetry, self._own, self._robot, self._port = telemetry, own, robot, port
        self._budgeted_at = 0.0

    def update(self, now: float) -> None:
        """Write everything into telemetry, the latency budget once a second."""
        self._update_counts()
        if now - self._budgeted_at >= BUDGET_INTERVAL:
            self._budgeted_at = now
            self._update_budget()
        self._telemetry.update(self._state(now), now=now)

    def _update_counts(self) -> None:
        """Copy the counts of session, device, renderers and pipelines."""
        device, faults, invalid = self._actuator.device, Counter[str](), Counter[str]()
        for finger in self._fingers:
            faults.update(finger.renderer.faults)
            invalid.update(finger.pipeline.detector.faults)
        counts = {
            **self.counters,
            "xruns": device.xruns,
            "callback_faults": device.process_faults,
            "device_losses": device.losses,
            "command_faults": faults["command"],
            "stale_fades": faults["stale"],
            "emergency_stops": max(finger.gate.stops for finger in self._fingers),
            "sound_faults": invalid["sound"],
            "model_faults": invalid["model"],
        }
        for name, total in counts.items():
            self._telemetry.count(name, total - self._telemetry.counter(name))
        for name, value in {**self.gauges, "device_latency": device.latency}.items():
            self._telemetry.gauge(name, value)

    def _update_budget(self) -> None:
        self._robot.refresh()
        playout = self._session.playout
        stages = operator_stages(
            self._own, self._robot.watcher, self._actuator.device.latency,
            sound_delay=(
                playout.controller.margin + playout.latency + self._fingers[0].renderer.latency if playout else 0.0
            ),
        )  # fmt: skip
        for stage, duration in stages.items():
            self._telemetry.gauge(f"latency_{stage}", duration)

    def _state(self, now: float) -> State:
        peer, states = self._session.peer, tuple(finger.state() for finger in self._fingers)
        return State(
            role="operator",
            profiles=self._fingers[0].requests.profiles,
            link=f"connected to {peer}" if peer else f"listening at port {self._port}",
            output=self._settings.output.actuator,
            faults=tuple(self._faults(now)),
            fingers=states,
        )

    def _faults(self, now: float) -> Iterator[Fault]:
        yield from self.warnings
        if self._actuator.device.fault:
            yield Fault("actuator", self._actuator.device.fault)
        for finger in self._fingers:
            yield from microphone_faults(finger.pipeline.detector, finger=finger.name)
        silent = now - self.received_at
        if self._endpoint.refusal:
            yield Fault("refused", f"the robot's sound cannot be used: {self._endpoint.refusal}")
        if self._session.peer is None and silent > LONGEST_CALL:
            failure = self._session.session.failure
            yield Fault("link", f"no robot is connected: {failure or 'start `tactophone send` there'}")
        elif self._session.peer and silent > SILENT_LINK and (reason := self._why_silent()):
            yield Fault("silence", reason)

        if conflict := self._session.session.version_conflict:
            yield Fault("version", conflict)
        sent_away = self._session.session.sent_away
        if sent_away and now - sent_away[1] < SENT_AWAY_SHOWN:
            yield Fault("second_robot", f"{sent_away[0]!r} called too and was sent away: stop one of the two robots")

    def _why_silent(self) -> str:
        """Return why no sound comes; empty until a page is the microphone for the first time."""
        if self._settings.capture.source != "browser":
            return "connected, but the robot sends no sound: check its microphones and the network"
        began = self._telemetry.counter("packets_received")
        return "no page sends sound: press Use this microphone on the one that listens" if began else ""
