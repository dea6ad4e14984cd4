import os
import signal
import threading
import time
from functools import partial
from typing import Self

import pytest

from tactophone.core.errors import TactophoneError
from tactophone.faces.bridges import process
from tactophone.faces.bridges.process import BridgeProcess


class Idle:
    """A bridge that passes nothing on."""

    interval = 0.05
    title = "the idle bridge"

    def __init__(self, answer: int = 0) -> None:
        self._answer = answer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def lost(self) -> str:
        return ""

    def read(self) -> None:
        if self._answer:
            raise SystemExit(self._answer)


@pytest.mark.slow
@pytest.mark.parametrize(("answer", "how"), [(0, "signal SIGKILL"), (3, "exit code 3")])
def test_a_bridge_that_was_killed_or_failed_is_reported(answer: int, how: str) -> None:
    lines: list[str] = []
    ended = threading.Event()

    def report(line: str) -> None:
        lines.append(line)
        ended.set()

    with BridgeProcess(partial(Idle, answer), report=report) as bridge:
        if not answer:
            os.kill(bridge.pid, signal.SIGKILL)
        assert ended.wait(20)
    assert len(lines) == 1
    assert lines[0].startswith(f"the idle bridge ended ({how}): the run goes on")


@pytest.mark.slow
def test_a_bridge_that_ends_with_the_run_is_not_reported() -> None:
    lines: list[str] = []
    with BridgeProcess(Idle, report=lines.append):
        pass
    assert lines == []


class Slow(Idle):
    """A bridge whose start outlasts the user's patience."""

    title = "the slow bridge"

    def __enter__(self) -> Self:
        time.sleep(0.5)
        return self


class Dead(Idle):
    title = "the dead bridge"

    def __enter__(self) -> Self:
        os.kill(os.getpid(), signal.SIGKILL)
        return self


def test_a_bridge_that_is_slow_to_begin_is_named_and_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(process, "BRIDGE_START_PATIENCE", 0.1)
    lines: list[str] = []
    with BridgeProcess(Slow, report=lines.append):
        pass
    assert lines
    assert all(line.startswith("the slow bridge still starts (") for line in lines)


def test_a_bridge_that_never_begins_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        pytest.raises(
            TactophoneError, match=r"the dead bridge did not begin \(signal SIGKILL\)"
        ),
        BridgeProcess(Dead),
    ):
        pass
    monkeypatch.setattr(process, "BRIDGE_START_PATIENCE", 0.05)
    monkeypatch.setattr(process, "BRIDGE_START_TIMEOUT", 0.1)
    with (
        pytest.raises(
            TactophoneError, match=r"the slow bridge did not begin within 0\.1 s"
        ),
        BridgeProcess(Slow),
    ):
        pass


class Stuck(Idle):
    """A bridge that would take for ever to end: its disk does not answer."""

    title = "the stuck bridge"

    def __exit__(self, *_: object) -> None:
        while True:
            time.sleep(1)


@pytest.mark.slow
def test_a_bridge_that_does_not_end_in_time_is_killed_and_named() -> None:
    lines: list[str] = []
    with BridgeProcess(
        Stuck, report=lines.append, end_timeout=0.3, unfinished="a.mcap lacks its end"
    ):
        pass
    assert lines == [
        "the stuck bridge had not ended after 0.3 s and was killed: a.mcap lacks its "
        "end"
    ]


@pytest.mark.slow
def test_a_bridge_that_is_killed_while_it_ends_is_named() -> None:
    lines: list[str] = []
    with BridgeProcess(Stuck, report=lines.append, end_timeout=60) as bridge:
        killer = threading.Timer(0.5, os.kill, (bridge.pid, signal.SIGKILL))
        killer.start()
    assert len(lines) == 1
    assert "(signal SIGKILL)" in lines[0]


class Late(Idle):
    """A bridge that lost something."""

    title = "the late bridge"

    def lost(self) -> str:
        return "3 predictions"


@pytest.mark.slow
def test_what_a_bridge_lost_is_told_in_its_unit_and_names_no_class() -> None:
    lines: list[str] = []
    with BridgeProcess(Late, report=lines.append):
        pass
    assert lines == ["the late bridge came too late for 3 predictions"]
