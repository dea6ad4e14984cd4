"""What suspends a run, a terminal's Ctrl-Z or ``kill -STOP``, silences it."""

import itertools
import math
import os
import signal
import threading
import time
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tactophone.core.settings import Settings
from tactophone.live.runtime import supervisor
from tactophone.live.runtime.supervisor import (
    ProcessInfo,
    Side,
    SideState,
    Supervisor,
    side_of,
    supervised,
)
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.writer import Telemetry

STOPS = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)


class Stopped(Supervisor):
    """A side without a process, which notes its emergency stops."""

    stops = 0

    def begin(self) -> None:
        pass

    def await_start(self) -> None:
        pass

    def stop_emergency(self) -> None:
        self.stops += 1


def test_ctrl_z_stops_all_sides_and_suspends_none() -> None:
    """The watchdog stood still with the side, whose last period was played on."""
    sides = [Stopped(cast(Any, None), Settings(), name=name) for name in ("a", "b")]
    before = [signal.getsignal(number) for number in STOPS]
    with supervised(*sides):
        for number in STOPS:
            assert signal.getsignal(number) is not signal.SIG_DFL
            signal.raise_signal(number)
    assert [side.stops for side in sides] == [1, 1]
    assert [signal.getsignal(number) for number in STOPS] == before


def test_a_stop_before_and_during_the_start_reaches_the_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a stop during the start, the finger vibrated first; a successor was ended."""
    sent: list[tuple[SideState, int, int]] = []
    processes = itertools.count(1)
    monkeypatch.setattr(
        supervisor,
        "Child",
        lambda *_, **__: SimpleNamespace(pid=next(processes), close=lambda: None),
    )
    monkeypatch.setattr(
        supervisor.os,
        "kill",
        lambda pid, number: sent.append((side.state, pid, number)),
    )
    side = Supervisor(cast(Any, None), Settings(), name="test-early")
    side.stop_emergency()
    assert not sent
    side.begin()
    assert side_of("test-early") is side
    side.stop_emergency()
    assert sent == [("starting", 1, signal.SIGUSR1)] * 2
    sent.clear()
    side._enter("restarting")
    side.stop_emergency()
    assert not sent
    side.begin()
    assert sent == [("starting", 2, signal.SIGUSR1)]
    side._words.put(None)
    del supervisor._sides["test-early"]


def live(_: Settings, info: ProcessInfo) -> None:
    with Telemetry(info.name) as telemetry:
        while True:
            telemetry.update(RunState(), now=time.monotonic())
            time.sleep(0.01)


def test_a_stop_ends_no_process_that_still_starts() -> None:
    side = Supervisor(live, Settings(), name=f"test-early-{os.getpid()}")
    side.stop_emergency()
    with side:
        side.stop_emergency()
        assert side.running
        assert side.restarts == 0
    assert side_of(side.name) is None


class Watched(Side):
    """A side that keeps house three times, and notes its stops."""

    interval = 0.0
    period = 0.0

    def __init__(self) -> None:
        super().__init__(Settings(), ProcessInfo("test-watched"), role="test")
        self.did: list[str] = []

    def stop(self) -> None:
        self.did.append("stop")

    def housekeep(self, now: float) -> None:
        assert math.isfinite(now)
        self.did.append("keep house")
        if self.did.count("keep house") == 3:
            self.ended.set()


def test_a_side_whose_supervisor_is_stopped_stops_itself_within_a_look(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its watchdog and its keyboard stand still: it would vibrate with neither."""
    for name in ("settle", "prioritize_thread", "follow_period"):
        monkeypatch.setattr(supervisor, name, lambda *_: "")
    stopped = iter((False, True, False))
    monkeypatch.setattr(supervisor, "parent_is_stopped", lambda: next(stopped))
    side = Watched()
    side.run(threading.Event())
    assert side.did == ["keep house", "stop", "keep house", "keep house"]
