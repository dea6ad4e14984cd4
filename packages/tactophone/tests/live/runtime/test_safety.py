"""The promises of docs/reference/safety.md that need real processes and a real sound
server."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from benchmarks.failsafe import (
    ENDLESS_TONE,
    EndlessStroke,
    PeakRecorder,
    freeze_operator,
    freeze_robot,
    kill_operator,
    kill_robot,
    measure_time_to_silence,
    recording,
)
from tactophone.core.settings import Settings, change
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient
from tactophone.live.runtime.output_gate import RESTARTED
from tactophone.live.runtime.pairing import Sides
from tactophone.live.telemetry.watcher import Watcher
from tactophone_lab.measurement.impulses import Graph, running_sides

from .live_system import eventually, writer_of

pytestmark = pytest.mark.realtime

SETTINGS = change(
    Settings(),
    [*ENDLESS_TONE, "process.name=test-safety"],
)


def stop_operator(sides: Sides) -> None:
    sides.operator.stop_emergency()


@pytest.fixture
def graph() -> Iterator[Graph]:
    """A sound server that goes on without a late client and repeats its last period, as
    JACK does by default."""
    with DummyServer(128, synchronous=False) as server:
        yield Graph(server.name)


@contextmanager
def sides_monitored(
    recorder: PeakRecorder, graph: Graph
) -> Iterator[tuple[Sides, JackClient]]:
    with (
        running_sides(SETTINGS, graph, open_source=EndlessStroke) as sides,
        recording(recorder, graph, sides) as client,
    ):
        yield sides, client


@pytest.mark.timed
@pytest.mark.parametrize(
    "end", [kill_robot, freeze_robot, kill_operator, freeze_operator, stop_operator]
)
def test_whatever_ends_the_actuator_is_silent_within_a_tenth_of_a_second(
    end: Callable[[Sides], None], graph: Graph
) -> None:
    # The machine itself may stand still for 40 ms now and then, but not twice of three
    # times.
    if (first := measure_time_to_silence(SETTINGS, graph, end)) > 0.1:
        again = [measure_time_to_silence(SETTINGS, graph, end) for _ in range(2)]
        assert max(again) <= 0.1, first


def test_a_frozen_operator_is_followed_by_one_that_stays_muted_until_armed(
    graph: Graph,
) -> None:
    recorder = PeakRecorder()
    with sides_monitored(recorder, graph) as (sides, client):
        first = sides.operator.pid
        Watcher(sides.operator.name).ask("ceiling", 0.2)
        time.sleep(0.1)
        freeze_operator(sides)
        assert eventually(lambda: sides.operator.restarts == 1)
        assert eventually(
            lambda: writer_of(sides.operator.name) not in (0, first), timeout=10.0
        )
        watcher = Watcher(sides.operator.name)
        assert eventually(lambda: client.revive() or client.fault == "")
        assert eventually(
            lambda: watcher.snapshot().counters["packets_received"] > 100, timeout=10.0
        )
        assert watcher.snapshot().state.muted_because == RESTARTED
        time.sleep(0.5)
        assert recorder.peak == 0.0
        watcher.ask("arm")
        assert eventually(lambda: recorder.peak > 0.01)
        # Nor is it stronger than what was allowed before.
        time.sleep(0.5)
        assert recorder.peak < 0.21


@pytest.mark.timed
def test_an_operator_that_was_only_late_is_silent_meanwhile_and_goes_on_by_itself(
    graph: Graph,
) -> None:
    """Half a second is far beyond what a busy machine is late by; before, the process
    was killed and muted."""
    recorder = PeakRecorder()
    with sides_monitored(recorder, graph) as (sides, client):
        watcher = Watcher(sides.operator.name)
        first = sides.operator.pid
        moment = time.monotonic()
        freeze_operator(sides)
        time.sleep(0.5)
        assert recorder.peak == 0.0
        assert recorder.time_to_silence(moment) < 0.3  # how fast, the test above asks
        os.kill(first, signal.SIGCONT)
        assert eventually(lambda: (client.revive(), recorder.peak > 0.01)[1])
        assert (sides.operator.restarts, sides.operator.pid) == (0, first)
        assert watcher.snapshot().state.armed
        # A busy machine may make the device late once more.
        assert watcher.snapshot().counters["device_losses"] >= 1


def test_a_sound_server_that_dies_is_shown_and_its_successor_is_silent_then_vibrates(
    jack_server: DummyServer,
) -> None:
    # Nothing is played to the ports, which the check would call dead microphones.
    settings = change(SETTINGS, ["detector.check_microphones=false"])
    with running_sides(settings, Graph(jack_server.name)) as sides:
        jack_server.kill()
        watcher = Watcher(sides.operator.name)
        assert eventually(
            lambda: any(
                fault.code == "actuator" for fault in watcher.snapshot().state.faults
            )
        )
        before = watcher.snapshot().counters
        jack_server.start()
        assert eventually(
            lambda: watcher.snapshot().counters["callbacks"] > before["callbacks"] + 100
        )
        assert eventually(
            lambda: (
                watcher.snapshot().counters["packets_received"]
                > before["packets_received"] + 100
            )
        )
        assert watcher.snapshot().state.faults == ()
        assert (sides.robot.restarts, sides.operator.restarts) == (0, 0)
