"""The promises of docs/safety.md that need real processes and a real sound server."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from tactophone import config
from tactophone.config import Settings
from tactophone.devices import DummyServer, JackClient
from tactophone.measurement.failsafe_timing import EndlessStroke, Listener, listening, outlive
from tactophone.measurement.latency import Graph, Sides, running_sides
from tactophone.runtime.output_gate import RESTARTED
from tactophone.telemetry import Watcher

from .line import eventually

pytestmark = pytest.mark.realtime

SETTINGS = config.change(Settings(), ["judge.watch=false", "process.name=test-safety"])


def kill_robot(sides: Sides) -> None:
    os.kill(sides.robot.pid, signal.SIGKILL)


def freeze_robot(sides: Sides) -> None:
    os.kill(sides.robot.pid, signal.SIGSTOP)


def kill_operator(sides: Sides) -> None:
    os.kill(sides.operator.pid, signal.SIGKILL)


def freeze_operator(sides: Sides) -> None:
    os.kill(sides.operator.pid, signal.SIGSTOP)


def stop_operator(sides: Sides) -> None:
    sides.operator.stop_emergency()


@pytest.fixture
def graph() -> Iterator[Graph]:
    """A sound server that goes on without who is late, and repeats his last period, as JACK does by default."""
    with DummyServer(128, synchronous=False) as server:
        yield Graph(server.name)


@contextmanager
def sides_felt(listener: Listener, graph: Graph) -> Iterator[tuple[Sides, JackClient]]:
    with (
        running_sides(SETTINGS, graph, open_source=EndlessStroke) as sides,
        listening(listener, graph, sides) as client,
    ):
        yield sides, client


@pytest.mark.parametrize("end", [kill_robot, freeze_robot, kill_operator, freeze_operator, stop_operator])
def test_whatever_ends_the_finger_is_silent_within_a_tenth_of_a_second(
    end: Callable[[Sides], None], graph: Graph
) -> None:
    # The machine itself may stand still for 40 ms now and then; it does not do so three times in a row.
    assert any(outlive(SETTINGS, graph, end) <= 0.1 for _ in range(3))


def test_a_frozen_operator_is_followed_by_one_that_stays_muted_until_armed(graph: Graph) -> None:
    listener = Listener()
    with sides_felt(listener, graph) as (sides, client):
        first = sides.operator.pid
        freeze_operator(sides)
        assert eventually(lambda: sides.operator.restarts == 1)
        assert eventually(lambda: Watcher(sides.operator.name).pid not in (0, first), patience=10.0)
        watcher = Watcher(sides.operator.name)
        assert eventually(lambda: client.revive() or client.fault == "")
        assert eventually(lambda: watcher.snapshot().counters["packets_received"] > 100, patience=10.0)
        assert watcher.snapshot().state.muted_because == RESTARTED
        time.sleep(0.5)
        assert listener.peak == 0.0
        watcher.ask("arm")
        assert eventually(lambda: listener.peak > 0.01)


def test_a_sound_server_that_dies_is_shown_and_its_successor_is_silent_then_felt(jack_server: DummyServer) -> None:
    with running_sides(SETTINGS, Graph(jack_server.name)) as sides:
        jack_server.kill()
        watcher = Watcher(sides.operator.name)
        assert eventually(lambda: any(fault.code == "actuator" for fault in watcher.snapshot().state.faults))
        before = watcher.snapshot().counters
        jack_server.start()
        assert eventually(lambda: watcher.snapshot().counters["callbacks"] > before["callbacks"] + 100)
        assert eventually(lambda: watcher.snapshot().counters["packets_received"] > before["packets_received"] + 100)
        assert watcher.snapshot().state.faults == ()
        assert (sides.robot.restarts, sides.operator.restarts) == (0, 0)
