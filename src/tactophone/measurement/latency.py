"""Latency of the running system from an impulse at the microphones to the first vibration, stage by stage.

A client of the same JACK graph plays impulses into the robot's ports (or into a loudspeaker in front of its
microphones) and records the operator's port (or a sensor on the actuator). Two independent measurements with different
clocks must agree (:mod:`tactophone.measurement.impulse_latency`): *end to end*, by counting samples, and *the budget*,
by the marks of the packet that caused the vibration.
"""

import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tactophone.devices import JackClient
from tactophone.errors import TactophoneError
from tactophone.measurement.impulse_latency import ImpulseLatency, ImpulsePlayer, analyse
from tactophone.runtime import (
    OpenSource,
    Supervisor,
    open_device,
    pair_on_one_machine,
    run_operator,
    run_robot,
    supervised,
    temporary_keys,
)
from tactophone.settings import Finger, Settings
from tactophone.telemetry import MARKS, Watcher

COLLECT_EVERY = 1.0
"""Seconds between two reads of the marks; telemetry keeps those of ten seconds."""


@dataclass(frozen=True, slots=True)
class Graph:
    """The JACK ports of impulses and vibration; empty names mean the sides' own ports."""

    server: str = ""
    impulse_port: str = ""
    vibration_port: str = ""

    @property
    def external(self) -> bool:
        """Whether the path leads over hardware outside the graph."""
        return bool(self.impulse_port)


@dataclass(frozen=True, slots=True)
class Sides:
    """Robot and operator while they run."""

    robot: Supervisor
    operator: Supervisor


def measure(
    settings: Settings,
    graph: Graph,
    *,
    impulses: int = 100,
    seed: int = 0,
    progress: Callable[[float], None] = lambda share: None,
) -> ImpulseLatency:
    """Run both sides on this machine, play impulses, and measure.

    Raises `TactophoneError` when a side does not start, or the two do not connect.
    """
    with running_sides(settings, graph) as sides:
        player = ImpulsePlayer(impulses, seed=seed)
        robot = sides.robot.name
        ports = [f"{finger.name}-{microphone}" for finger in settings.fingers for microphone in ("contact", "air")] or [
            "contact",
            "air",
        ]
        outputs = {port: f"{robot}:{port}" for port in ports}
        if graph.external:
            outputs = {"impulse": graph.impulse_port}
        # Of a hand, the last finger: its step is computed after those of all others.
        last = settings.fingers[-1].name if settings.fingers else "vibration"
        inputs = {"vibration": graph.vibration_port or f"{sides.operator.name}:{last}"}
        client = JackClient("tactophone-player", player.process, inputs=inputs, outputs=outputs, server=graph.server)
        client.open()
        try:
            marks = _collect(player, Watcher(sides.robot.name), Watcher(sides.operator.name), progress)
            period = client.period
        finally:
            client.close()
        restarts = sides.robot.restarts + sides.operator.restarts
    return replace(analyse(player, marks, period=period), restarts=restarts)


def _collect(
    player: ImpulsePlayer, robot: Watcher, operator: Watcher, progress: Callable[[float], None]
) -> dict[str, NDArray[np.void]]:
    """Wait until the player is done, and collect the marks before they are overwritten."""
    kept: dict[str, list[NDArray[np.void]]] = {name: [] for name in MARKS}
    while not player.done:
        time.sleep(COLLECT_EVERY)
        progress(player.position / len(player.played))
        for name, found in kept.items():
            found.append((robot if name in ("captured", "sent") else operator).marks(name))
    return {name: _joined(found) for name, found in kept.items()}


def _joined(parts: list[NDArray[np.void]]) -> NDArray[np.void]:
    whole = np.unique(np.concatenate(parts))  # removes marks that two reads returned; two packets at one moment differ
    return whole[np.argsort(whole["time"], kind="stable")]


@contextmanager
def running_sides(settings: Settings, graph: Graph, *, open_source: OpenSource = open_device) -> Iterator[Sides]:
    """Run both sides, each in its process, and yield once they are connected; the robot captures ``open_source``."""
    capture, output, process = settings.capture, settings.output, settings.process
    if not graph.external:
        capture, output = replace(capture, contact="-", air="-"), replace(output, port="-")
        free = dict.fromkeys(("capture.contact", "capture.air", "output.port"), "-")
        settings = replace(
            settings,
            fingers=tuple(Finger(each.name, tuple((dict(each.settings) | free).items())) for each in settings.fingers),
        )
    settings = replace(
        settings,
        detector=replace(settings.detector, check_microphones=False),
        capture=replace(capture, source="jack"),
        output=replace(output, actuator="jack"),
        process=replace(process, jack_server=graph.server or process.jack_server),
    )
    with ExitStack() as stack:
        folder = stack.enter_context(temporary_keys())
        name = f"{process.name or 'latency'}-{secrets.token_hex(3)}"
        robot, operator = pair_on_one_machine(settings, folder, name=name)
        receive = partial(run_operator, robot=robot.process.name)
        send = partial(run_robot, open_source=open_source)
        receiving = Supervisor(receive, operator, name=operator.process.name)
        sending = Supervisor(send, robot, name=robot.process.name)
        stack.enter_context(supervised(receiving, sending))
        _await_connection(operator.process.name)
        yield Sides(sending, receiving)


def vibration_port(graph: Graph, sides: Sides) -> str:
    """Return the JACK port of the vibration."""
    return graph.vibration_port or f"{sides.operator.name}:vibration"


def _await_connection(operator: str) -> None:
    watcher = Watcher(operator)
    for _ in range(500):
        if watcher.snapshot().counters["packets_received"] > 10:
            return
        time.sleep(0.02)
    raise TactophoneError("robot and operator did not connect within 10 s: run `tactophone loopback` to see why")
