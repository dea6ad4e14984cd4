import os
import signal
import threading
from functools import partial
from typing import Self

import pytest

from tactophone.faces.bridges.process import BridgeProcess


class Idle:
    """A bridge that passes nothing on."""

    interval, missed = 0.05, 0

    def __init__(self, answer: int = 0) -> None:
        self._answer = answer

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

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
    assert lines[0].startswith(f"Idle ended ({how}): the run goes on")


@pytest.mark.slow
def test_a_bridge_that_ends_with_the_run_is_not_reported() -> None:
    lines: list[str] = []
    with BridgeProcess(Idle, report=lines.append):
        pass
    assert lines == []
