import json
import os
import time
from contextlib import ExitStack
from pathlib import Path
from signal import SIGKILL, SIGUSR1
from typing import Any

import pytest

from tactophone.cli import main
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.memory import PREFIX, folder
from tactophone.live.telemetry.watcher import Watcher, lost_runs
from tactophone.live.telemetry.writer import Telemetry
from tests.live.runtime.live_system import LiveSystem, eventually
from tests.models import write_tiny_model


@pytest.mark.realtime
def test_stop_mute_and_arm_reach_a_running_process(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    with line.both():
        assert eventually(lambda: line.amplitude() > 0.3)
        assert main(["mute", line.names[1]]) == 0
        assert eventually(lambda: line.amplitude() == 0.0)
        assert main(["arm", line.names[1]]) == 0
        assert eventually(lambda: line.amplitude() > 0.3)
        assert capsys.readouterr().out.splitlines()[-1] == f"{line.names[1]}: armed"


def test_with_no_process_the_error_says_what_to_start(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["stop", "telephone"]) == 1
    assert "tactophone receive" in capsys.readouterr().err


def test_a_wrong_name_lists_the_runs_that_exist(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Telemetry("test-status"):
        assert main(["mute", "test-stats"]) == 1
        error = capsys.readouterr().err
        assert "test-status" in error.partition("there are ")[2]
        assert error.rstrip().endswith("did you mean test-status?")
        assert main(["status", "--json"]) == 0
        assert "test-status" in [
            run["name"] for run in json.loads(capsys.readouterr().out)
        ]
    assert main(["status", "--json"]) == 0
    assert "test-status" not in capsys.readouterr().out


def _operators(stack: ExitStack, *names: str) -> list[Telemetry]:
    """Runs that can vibrate, which nobody serves."""
    runs = [stack.enter_context(Telemetry(name)) for name in names]
    for run in runs:
        fingers = (FingerState(armed=False, muted_because="muted by a test"),)
        run.update(RunState(role="operator", fingers=fingers), now=time.monotonic())
    return runs


@pytest.mark.parametrize("verb", ["mute", "arm"])
def test_mute_as_arm_wants_a_name_where_two_runs_can_vibrate(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with ExitStack() as stack:
        _operators(stack, "test-left", "test-right")
        assert main([verb]) == 1
        said = capsys.readouterr().err
    assert "test-left, test-right" in said
    assert f"name the one to {verb}" in said


def test_a_run_that_cannot_be_signalled_keeps_no_other_from_being_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The stop ended at the first of two runs, and the second went on vibrating."""
    with ExitStack() as stack:
        first, second = _operators(stack, "test-1", "test-2")
        first._memory["pid"][...] = os.getppid()
        signalled: list[int] = []

        def kill(pid: int, number: int) -> None:
            if number:  # 0 asks whether there is such a process
                signalled.append(pid)
                raise PermissionError

        monkeypatch.setattr(
            "tactophone.cli.status.running", lambda: ["test-1", "test-2"]
        )
        monkeypatch.setattr("tactophone.cli.status.lost_runs", dict)
        monkeypatch.setattr(Watcher, "exists", True)
        monkeypatch.setattr("tactophone.cli.status.os.kill", kill)
        assert main(["stop"]) == 0
        assert signalled == [os.getppid(), os.getpid()]
        for run in (first, second):
            assert [asked.action for asked in run.requests()] == ["stop"]


def test_every_run_is_asked_to_stop_before_one_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One that stood still kept the next from its stop for a second."""
    asked: list[str] = []
    with ExitStack() as stack:
        names = ["test-1", "test-2"]
        for run in _operators(stack, *names):
            fingers = (FingerState(armed=True),)
            run.update(RunState(role="operator", fingers=fingers), now=time.monotonic())
        ask = Watcher.ask

        def note(self: Watcher, *words: Any, **options: Any) -> None:
            asked.append(self.name)
            ask(self, *words, **options)

        monkeypatch.setattr(Watcher, "ask", note)
        monkeypatch.setattr("tactophone.cli.status.lost_runs", dict)
        monkeypatch.setattr("tactophone.cli.status.running", lambda: names)
        monkeypatch.setattr("tactophone.cli.status.STATUS_TIMEOUT", 0.5)
        monkeypatch.setattr("tactophone.cli.status.os.kill", lambda *_: None)
        waited: list[int] = []
        monkeypatch.setattr(
            "tactophone.cli.status.time.sleep", lambda _: waited.append(len(asked))
        )
        assert main(["stop"]) == 1
    assert asked == names
    assert set(waited) == {2}


@pytest.mark.parametrize("obstinate", [False, True])
def test_a_process_that_does_not_stop_within_a_second_is_killed(
    obstinate: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It stood still with its watchdog, and JACK repeated its last period."""
    with ExitStack() as stack:
        (run,) = _operators(stack, "test-frozen")
        fingers = (FingerState(armed=True),)
        run.update(RunState(role="operator", fingers=fingers), now=time.monotonic())
        sent: list[tuple[int, int]] = []
        monkeypatch.setattr("tactophone.cli.status.lost_runs", dict)
        monkeypatch.setattr("tactophone.cli.status.running", lambda: ["test-frozen"])
        monkeypatch.setattr("tactophone.cli.status.STATUS_TIMEOUT", 0.05)
        monkeypatch.setattr(
            "tactophone.cli.status.os.kill",
            lambda pid, number: sent.append((pid, number)) if number else None,
        )
        killed = property(lambda _: obstinate or (os.getpid(), SIGKILL) not in sent)
        monkeypatch.setattr(Watcher, "exists", killed)
        assert main(["stop"]) == obstinate
    assert sent == [(os.getpid(), SIGUSR1), (os.getpid(), SIGKILL)]
    said = capsys.readouterr().err
    assert ("disconnect the actuator" in said) == obstinate
    assert ("was killed: it is silent" in said) != obstinate


def test_a_run_whose_memory_has_lost_its_name_is_found_and_stopped(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A system may remove it at a logout: the run vibrated on, and nothing found it."""
    name = f"test-lost-{os.getpid()}"
    with Telemetry(name) as telemetry:
        fingers = (FingerState(armed=False, muted_because="muted by a test"),)
        state = RunState(role="operator", fingers=fingers)
        telemetry.update(state, now=time.monotonic())
        (folder() / f"{PREFIX}{name}").unlink()
        assert main(["status", "--json"]) == 0
        assert name in [run["name"] for run in json.loads(capsys.readouterr().out)]
        assert main(["mute", name]) == 0
        assert [asked.action for asked in telemetry.requests()] == ["mute"]
    assert name not in lost_runs()
