import errno
import math
import os
import re
import signal
import threading
import time
import uuid
from collections.abc import Callable
from typing import ClassVar

import pytest

from tactophone.core.errors import DeviceError, TactophoneError
from tactophone.core.settings import Settings
from tactophone.live.runtime.supervisor import (
    SIDE_END_TIMEOUT,
    SIDE_TRANSITIONS,
    ProcessInfo,
    SideState,
    Supervisor,
    supervised,
)
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry

from .live_system import writer_of

pytestmark = pytest.mark.realtime


def live(settings: Settings, info: ProcessInfo, *, stall_after: int = 0) -> None:
    """Act as a side that vibrates; the first process stalls after ``stall_after``
    periods."""
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    with Telemetry(info.name) as telemetry:
        telemetry.count("process_restarts", info.restarts)
        telemetry.gauge("output_amplitude", 0.5)
        while not terminated.wait(0.003):
            telemetry.count("callbacks")
            telemetry.update(RunState(role="test"), now=time.monotonic())
            if (
                stall_after
                and info.restarts == 0
                and telemetry.counter("callbacks") == stall_after
            ):
                os.kill(os.getpid(), signal.SIGSTOP)


def live_and_stall(settings: Settings, info: ProcessInfo) -> None:
    live(settings, info, stall_after=30)


def fail_to_open(settings: Settings, info: ProcessInfo) -> None:
    raise DeviceError("there is no such device: choose another")


def end_at_once(settings: Settings, info: ProcessInfo) -> None:
    with Telemetry(info.name) as telemetry:
        telemetry.update(RunState(), now=time.monotonic())
        time.sleep(0.2)


@pytest.fixture
def name() -> str:
    return f"test-{uuid.uuid4().hex[:8]}"


def eventually(condition: Callable[[], bool]) -> bool:
    for _ in range(1000):
        if condition():
            return True
        time.sleep(0.01)
    return False


def test_a_stalled_process_is_killed_and_replaced(name: str) -> None:
    with Supervisor(live_and_stall, Settings(), name=name) as supervisor:
        first = supervisor.pid
        assert eventually(lambda: supervisor.restarts == 1)
        assert eventually(lambda: writer_of(name) not in (0, first))
        assert eventually(
            lambda: Watcher(name).snapshot().counters["process_restarts"] == 1
        )
        assert supervisor.running
        last = supervisor.pid
    assert not os.path.exists(f"/proc/{last}")


class Followed(Supervisor):
    """Notes each change of its state."""

    moves: ClassVar[set[tuple[SideState, SideState]]] = set()

    def __setattr__(self, name: str, value: object) -> None:
        before = getattr(self, "state", value)
        super().__setattr__(name, value)
        if name == "state" and self.state != before:
            self.moves.add((before, self.state))


def fail_twice(settings: Settings, info: ProcessInfo) -> None:
    """Run, die; die before telemetry; then run on."""
    if info.restarts == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    live(settings, info, stall_after=30)


def test_every_row_of_the_table_of_states_is_walked_and_no_other(name: str) -> None:
    with Followed(fail_twice, Settings(), name=name) as supervisor:
        assert eventually(
            lambda: supervisor.restarts == 2 and supervisor.state == "running"
        )
        os.kill(supervisor.pid, signal.SIGKILL)
        assert eventually(lambda: supervisor.state == "restarting")
    with (
        pytest.raises(TactophoneError),
        Followed(fail_to_open, Settings(), name=f"{name}-2"),
    ):
        pass
    with Followed(end_at_once, Settings(), name=f"{name}-3") as supervisor:
        assert supervisor.wait(20.0)
    assert Followed.moves == {
        (state, after) for state, others in SIDE_TRANSITIONS.items() for after in others
    }


def test_an_error_at_the_start_is_raised_in_one_line(name: str) -> None:
    with (
        pytest.raises(TactophoneError, match="no such device: choose another"),
        Supervisor(fail_to_open, Settings(), name=name),
    ):
        pass


def test_a_process_whose_sound_has_ended_is_not_restarted(name: str) -> None:
    with Supervisor(end_at_once, Settings(), name=name) as supervisor:
        assert supervisor.wait(5.0)
        assert not supervisor.running
        assert supervisor.restarts == 0


def fail_after_a_moment(settings: Settings, info: ProcessInfo) -> None:
    with Telemetry(info.name) as telemetry:
        telemetry.update(RunState(), now=time.monotonic())
        time.sleep(0.3)
        raise DeviceError("the model needs two channels: choose another")


def test_the_reason_of_a_restart_is_reported_and_restarts_back_off(name: str) -> None:
    lines: list[str] = []
    with Supervisor(fail_after_a_moment, Settings(), name=name, report=lines.append):
        assert eventually(lambda: sum(line.startswith("!") for line in lines) >= 2)
    first, second, *_ = [line for line in lines if line.startswith("!")]
    assert "the model needs two channels" in first
    assert first.endswith("starts again in 0.5 s")
    assert second.endswith("starts again in 1 s")
    assert lines[lines.index(first) + 1] == f"{name} runs again"


def test_a_successor_that_cannot_be_started_is_tried_again(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run ended, with a traceback and exit code 0."""
    said: list[str] = []
    with Supervisor(live, Settings(), name=name, report=said.append) as side:
        begin = side.begin
        left = iter([True, True])

        def refuse_twice() -> None:
            if next(left, False):
                raise OSError(errno.EMFILE, "Too many open files")
            begin()

        monkeypatch.setattr(side, "begin", refuse_twice)
        os.kill(side.pid, signal.SIGKILL)
        assert eventually(lambda: side.restarts == 1 and side.state == "running")
        assert side.running
    assert sum("no process can be started: Too many" in line for line in said) == 2


def start_slowly(settings: Settings, info: ProcessInfo) -> None:
    info.progress("reading the model")
    until = time.monotonic() + 3.0
    while time.monotonic() < until:
        pass
    live(settings, info)


def start_never(settings: Settings, info: ProcessInfo) -> None:
    info.progress("waiting for a device")
    time.sleep(60.0)


def test_a_start_may_take_long_while_it_makes_progress(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactophone.live.runtime.supervisor.SIDE_START_TIMEOUT", 1.5)
    with Supervisor(start_slowly, Settings(), name=name) as supervisor:
        assert supervisor.running


def test_a_start_without_progress_names_what_it_was_doing(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactophone.live.runtime.supervisor.SIDE_START_TIMEOUT", 1.5)
    with (
        pytest.raises(
            TactophoneError,
            match=r"no progress within 1\.5 s; it was last waiting for a device",
        ),
        Supervisor(start_never, Settings(), name=name),
    ):
        pass


def test_a_slow_start_says_what_it_does_ever_more_rarely(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactophone.live.runtime.supervisor.SIDE_START_TIMEOUT", 1.5)
    monkeypatch.setattr("tactophone.live.runtime.supervisor.SLOW_START", 0.2)
    lines: list[str] = []
    began = time.monotonic()
    with (
        pytest.raises(TactophoneError, match="it was last waiting for a device"),
        Supervisor(start_never, Settings(), name=name, report=lines.append),
    ):
        pass
    took = time.monotonic() - began
    # Lines come 0.2, 0.4, 0.8 s ... after the beginning, however long the start takes.
    assert 3 <= len(lines) <= 1 + math.log2(took / 0.2)
    for line in lines:
        assert re.fullmatch(r"still starting \(\d+ s\): [a-z ]+\r", line)


def start_deaf(settings: Settings, info: ProcessInfo) -> None:
    """Run at first; a successor heeds SIGTERM only once it has started, which takes it
    a minute."""
    if info.restarts == 0:
        live(settings, info, stall_after=30)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    info.progress("starting")
    time.sleep(60.0)


def test_a_run_ends_at_once_while_a_successor_starts(name: str) -> None:
    with Supervisor(start_deaf, Settings(), name=name) as supervisor:
        first = supervisor.pid
        assert eventually(lambda: supervisor.pid != first)
        time.sleep(1.0)
        began = time.monotonic()
    assert time.monotonic() - began < SIDE_END_TIMEOUT / 2
    assert not os.path.exists(f"/proc/{supervisor.pid}")


def heed_nothing(settings: Settings, info: ProcessInfo) -> None:
    with Telemetry(info.name) as telemetry:
        telemetry.update(RunState(), now=time.monotonic())
        time.sleep(60.0)


def test_sigterm_ends_a_side_that_does_not_heed_it_yet(name: str) -> None:
    """Other children leave their end to their parent."""
    with Supervisor(heed_nothing, Settings(), name=name) as supervisor:
        child = supervisor._child
    assert child
    assert child.how_ended() == "signal SIGTERM"


def test_sigterm_during_the_start_leaves_no_process_behind(name: str) -> None:
    side = Supervisor(start_slowly, Settings(), name=name)
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGTERM)).start()
    with pytest.raises(SystemExit), supervised(side):
        pytest.fail("it has started")
    assert not os.path.exists(f"/proc/{side.pid}")
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_restarts_come_as_soon_as_at_first_after_a_healthy_time(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactophone.live.runtime.supervisor.SHORT_LIFE", 0.8)
    lines: list[str] = []
    with Supervisor(live, Settings(), name=name, report=lines.append) as supervisor:
        for number in range(3):
            os.kill(supervisor.pid, signal.SIGKILL)
            assert eventually(lambda number=number: supervisor.restarts > number)
            assert eventually(lambda: writer_of(name) == supervisor.pid)
            time.sleep(1.0 if number else 0.0)
    assert [line.rpartition("in ")[2] for line in lines if line.startswith("!")] == [
        "0.5 s",
        "1 s",
        "0.5 s",
    ]


def test_a_killed_run_leaves_no_shared_memory(name: str) -> None:
    with Supervisor(live, Settings(), name=name) as supervisor:
        os.kill(supervisor.pid, signal.SIGSTOP)
    with pytest.raises(TactophoneError, match="cannot reach"):
        Watcher(name)


def test_sides_start_together_and_end_together_when_one_fails(name: str) -> None:
    first, second = (
        Supervisor(live, Settings(), name=name),
        Supervisor(live, Settings(), name=f"{name}-2"),
    )
    with supervised(first, second):
        assert first.running
        assert second.running
        pids = [first.pid, second.pid]
    assert not any(os.path.exists(f"/proc/{pid}") for pid in pids)
    failing = Supervisor(fail_to_open, Settings(), name=f"{name}-3")
    running = Supervisor(live, Settings(), name=name)
    with (
        pytest.raises(TactophoneError, match="no such device"),
        supervised(running, failing),
    ):
        pass
    assert not os.path.exists(f"/proc/{running.pid}")
