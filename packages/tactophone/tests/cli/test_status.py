import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from signal import SIGKILL, SIGUSR1
from typing import Any

import pytest

from tactophone.cli import main
from tactophone.live.telemetry.layout import Action, FingerState, RunState
from tactophone.live.telemetry.memory import PREFIX, folder
from tactophone.live.telemetry.watcher import Watcher, running, runs
from tactophone.live.telemetry.writer import Telemetry
from tests.live.runtime.live_system import LiveSystem, eventually
from tests.models import write_tiny_model


@pytest.mark.realtime
def test_stop_mute_and_arm_reach_a_running_process(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("tactophone.cli.status.began", time.monotonic)
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


def _only(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Hide all other runs of this machine from a stop of every run."""
    monkeypatch.setattr("tactophone.cli.status.runs", lambda _: map(Watcher, names))


@pytest.mark.parametrize("silenced", ["stop", "mute"])
def test_arm_releases_nothing_that_came_while_it_started(
    silenced: Action,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """On a busy machine it undid what was stopped up to 4 s after it was entered."""
    monkeypatch.setattr("tactophone.cli.status.STATUS_TIMEOUT", 0.0)
    with ExitStack() as stack:
        (run,) = _operators(stack, "test-arm")
        Watcher("test-arm").ask(silenced)
        assert main(["arm", "test-arm"]) == 1
        assert "enter it again" in capsys.readouterr().err
        assert [asked.action for asked in run.requests()] == [silenced]
        monkeypatch.setattr("tactophone.cli.status.began", time.monotonic)
        main(["arm", "test-arm"])
        assert [asked.action for asked in run.requests()] == ["arm"]


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

        _only(monkeypatch, "test-1", "test-2")
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
        _only(monkeypatch, *names)
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
        _only(monkeypatch, "test-frozen")
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
    assert name not in running()


def test_a_run_that_took_the_name_of_a_lost_one_keeps_neither_from_being_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The first one vibrated on, as its name led to the second."""
    name = f"test-heir-{os.getpid()}"
    with ExitStack() as stack:
        (lost,) = _operators(stack, name)
        (folder() / f"{PREFIX}{name}").unlink()
        (heir,) = _operators(stack, name)
        _signal_nobody(monkeypatch)
        assert main(["stop", name]) == 0
        for run in (lost, heir):
            assert [asked.action for asked in run.requests()] == ["stop"]


def _signal_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactophone.cli.status.os.kill", lambda *_: None)


@pytest.fixture
def listed(monkeypatch: pytest.MonkeyPatch) -> dict[str, Callable[[], None]]:
    """What happens when a folder was listed, and before anybody looks at its files."""
    happens: dict[str, Callable[[], None]] = {}
    scan, names = os.scandir, os.listdir

    @contextmanager
    def scandir(path: Any) -> Iterator[Iterator[os.DirEntry[str]]]:
        with scan(path) as entries:
            every = list(entries)
        happens.get(os.fspath(path), lambda: None)()
        yield iter(every)

    def listdir(path: Any) -> list[str]:
        every = names(path)
        happens.get(os.fspath(path), lambda: None)()
        return every

    monkeypatch.setattr(os, "scandir", scandir)
    monkeypatch.setattr(os, "listdir", listdir)
    return happens


def test_files_that_are_removed_meanwhile_keep_no_run_from_being_found(
    listed: dict[str, Callable[[], None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any user may make and remove them there: `tactophone stop` ended in an error."""
    name = f"test-files-{os.getpid()}"
    gone = folder() / f"{PREFIX}{name}-gone"
    gone.touch()
    listed[str(folder())] = lambda: gone.unlink(missing_ok=True)
    with ExitStack() as stack:
        _operators(stack, name)
        _signal_nobody(monkeypatch)
        assert main(["stop", name]) == 0
        assert name in running()
    assert not gone.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="only there are processes listed")
def test_processes_that_end_meanwhile_keep_no_run_from_being_stopped(
    listed: dict[str, Callable[[], None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"test-processes-{os.getpid()}"

    def end() -> None:
        raise ProcessLookupError

    with ExitStack() as stack:
        (run,) = _operators(stack, name)
        # It ends with its input, as nothing here is signalled.
        other = stack.enter_context(subprocess.Popen(["cat"], stdin=subprocess.PIPE))
        listed[f"/proc/{other.pid}/fd"] = end
        _signal_nobody(monkeypatch)
        assert main(["stop", name]) == 0
        assert [asked.action for asked in run.requests()] == ["stop"]
        assert name in running()


def test_a_folder_that_others_have_filled_delays_no_stop(
    listed: dict[str, Callable[[], None]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """200,000 empty files of another user delayed it by 14 s."""
    name = f"test-filled-{os.getpid()}"

    def look() -> None:
        raise AssertionError("looked at all files before the run was asked")

    listed[str(folder())] = look
    with ExitStack() as stack:
        (run,) = _operators(stack, name)
        _signal_nobody(monkeypatch)
        assert main(["stop", name]) == 0
        assert [asked.action for asked in run.requests()] == ["stop"]
        if sys.platform == "linux":  # which tells what processes have open
            assert name in (found.name for found in runs())


def test_every_run_is_asked_to_stop_as_soon_as_it_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with ExitStack() as stack:
        names = ["test-1", "test-2"]
        operators = _operators(stack, *names)

        def found(_: str) -> Iterator[Watcher]:
            for name, run in zip(names, operators, strict=True):
                yield Watcher(name)
                assert [asked.action for asked in run.requests()] == ["stop"]

        _signal_nobody(monkeypatch)
        monkeypatch.setattr("tactophone.cli.status.runs", found)
        assert main(["stop"]) == 0


def test_a_run_of_another_version_is_named_and_gets_the_stop_as_a_signal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was passed over: "no run", and the finger vibrated on."""
    signalled: list[tuple[int, int]] = []

    def kill(pid: int, number: int) -> None:
        signalled.append((pid, number))

    with Telemetry("test-old") as run:
        run._memory["fingerprint"][...] = 7
        with monkeypatch.context() as patch:
            patch.setattr("tactophone.cli.status.os.kill", kill)
            assert main(["stop", "test-old"]) == 1
        said = capsys.readouterr().err
        assert main(["mute", "test-old"]) == 1
        assert "another version of Tactophone" in capsys.readouterr().err
        assert main(["status", "--json"]) == 0
        shown = {run["name"]: run for run in json.loads(capsys.readouterr().out)}
    assert (os.getpid(), SIGUSR1) in signalled
    assert f"test-old (process {os.getpid()})" in said
    assert f"`kill {os.getpid()}` ends it" in said
    assert "another version" in shown["test-old"]["vibration"]
