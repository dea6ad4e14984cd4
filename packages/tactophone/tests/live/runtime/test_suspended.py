"""What suspends a run, a terminal's Ctrl-Z or ``kill -STOP``, silences it."""

import math
import os
import signal
import threading
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
    supervised,
)

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


def test_a_stop_during_the_start_waits_for_the_process_and_does_not_end_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """SIGUSR1 ends a process that does not handle it yet."""
    sent: list[tuple[SideState, int]] = []
    side = Supervisor(cast(Any, None), Settings(), name="test-early")
    child: Any = SimpleNamespace(pid=os.getpid(), alive=True, messages=lambda: ())
    watcher: Any = SimpleNamespace(pulse=lambda: SimpleNamespace(beat=1.0))
    monkeypatch.setattr(side, "_child", child)
    monkeypatch.setattr(side, "_watcher", lambda: watcher)
    monkeypatch.setattr(
        supervisor.os, "kill", lambda _, number: sent.append((side.state, number))
    )
    side.state = "starting"
    side.stop_emergency()
    side._await_start()
    assert sent == [("running", signal.SIGUSR1)]


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
