"""How long from a click at the microphones to the first vibration, and where the time goes.

A client of the same JACK graph plays clicks into the robot's ports (or into a loudspeaker before its microphones) and
records what the operator's port gives (or a sensor on the actuator). Two independent measures come of it, taken with
different clocks, which must agree (:mod:`tactophone.measurement.impulse_latency`): *end to end*, by counting samples, and *the
budget*, by following the very packet that made the finger vibrate.
"""

import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from tactophone.config import Settings
from tactophone.devices import JackClient
from tactophone.errors import TactophoneError
from tactophone.measurement.impulse_latency import Clicker, Measured, analyse
from tactophone.runtime import Supervisor, run_operator, run_robot
from tactophone.runtime.pairing import on_one_machine
from tactophone.runtime.wiring import OpenSource, open_device
from tactophone.telemetry import MARKS, Watcher

COLLECT_EVERY = 1.0
"""Seconds between two looks at the marks, of which ten seconds' worth are kept."""


@dataclass(frozen=True, slots=True)
class Graph:
    """Where the clicks go and where the vibration comes from; empty names mean the sides' own JACK ports."""

    server: str = ""
    click_to: str = ""
    felt_from: str = ""

    @property
    def through_air(self) -> bool:
        """Whether the way leads over hardware outside the graph."""
        return bool(self.click_to)


@dataclass(frozen=True, slots=True)
class Sides:
    """Robot and operator while they run."""

    robot: Supervisor
    operator: Supervisor


def measure(
    settings: Settings,
    graph: Graph,
    *,
    clicks: int = 100,
    seed: int = 0,
    progress: Callable[[float], None] = lambda share: None,
) -> Measured:
    """Run both sides on this machine, click, and measure.

    Raises
    ------
    TactophoneError
        When a side does not start, or the two do not connect.
    """
    with running_sides(settings, graph) as sides:
        clicker = Clicker(clicks, seed=seed)
        robot = sides.robot.name
        clicks_to = {"contact": f"{robot}:contact", "air": f"{robot}:air"}
        if graph.through_air:
            clicks_to = {"click": graph.click_to}
        felt = {"felt": felt_port(graph, sides)}
        client = JackClient("tactophone-clicker", clicker.process, inputs=felt, outputs=clicks_to, server=graph.server)
        client.open()
        try:
            marks = _collect(clicker, Watcher(sides.robot.name), Watcher(sides.operator.name), progress)
            period = client.period
        finally:
            client.close()
        restarts = sides.robot.restarts + sides.operator.restarts
    return replace(analyse(clicker, marks, period=period), restarts=restarts)


def _collect(
    clicker: Clicker, robot: Watcher, operator: Watcher, progress: Callable[[float], None]
) -> dict[str, NDArray[np.void]]:
    """Wait until the clicker is done, and gather marks before they are written over."""
    kept: dict[str, list[NDArray[np.void]]] = {name: [] for name in MARKS}
    while not clicker.done:
        time.sleep(COLLECT_EVERY)
        progress(clicker.position / len(clicker.played))
        for name, found in kept.items():
            found.append((robot if name in ("captured", "sent") else operator).marks(name))
    return {name: _joined(found) for name, found in kept.items()}


def _joined(parts: list[NDArray[np.void]]) -> NDArray[np.void]:
    whole = np.unique(np.concatenate(parts))  # the same mark is often seen twice; two packets at one moment stay two
    return whole[np.argsort(whole["time"], kind="stable")]


@contextmanager
def running_sides(settings: Settings, graph: Graph, *, open_source: OpenSource = open_device) -> Iterator[Sides]:
    """Run both sides, each in its process, from when they are connected; the robot hears ``open_source``."""
    capture, output, process = settings.capture, settings.output, settings.process
    if not graph.through_air:
        capture, output = replace(capture, contact="-", air="-"), replace(output, port="-")
    settings = replace(
        settings,
        judge=replace(settings.judge, watch=False),
        capture=replace(capture, source="jack"),
        output=replace(output, actuator="jack"),
        process=replace(process, jack_server=graph.server or process.jack_server),
    )
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="tactophone-")))
        robot, operator = on_one_machine(settings, folder, name=f"{process.name or 'latency'}-{secrets.token_hex(3)}")
        receive = partial(run_operator, robot=robot.process.name)
        send = partial(run_robot, open_source=open_source)
        receiving = stack.enter_context(Supervisor(receive, operator, name=operator.process.name))
        sending = stack.enter_context(Supervisor(send, robot, name=robot.process.name))
        _await_connection(operator.process.name)
        yield Sides(sending, receiving)


def felt_port(graph: Graph, sides: Sides) -> str:
    """Give the JACK port at which the vibration can be heard."""
    return graph.felt_from or f"{sides.operator.name}:vibration"


def _await_connection(operator: str) -> None:
    watcher = Watcher(operator)
    for _ in range(500):
        if watcher.snapshot().counters["packets_received"] > 10:
            return
        time.sleep(0.02)
    raise TactophoneError("robot and operator did not connect within 10 s: run `tactophone loopback` to see why")
