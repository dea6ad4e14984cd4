import os
import stat
import subprocess
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import TactophoneError
from tactophone.core.types import AudioBlock, PipelineStep
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.memory import (
    PREFIX,
    Memory,
    folder,
    is_alive,
    remove_leftovers,
    remove_memory,
)
from tactophone.live.telemetry.watcher import Watcher, running
from tactophone.live.telemetry.writer import Telemetry

STEP_OF_SILENCE = PipelineStep(
    AudioBlock(np.zeros((240, 2), np.float32), 48_000), (), ()
)


@pytest.fixture
def name() -> str:
    return f"test-{uuid.uuid4().hex[:8]}"


def test_the_memory_is_private_and_is_removed_with_the_run(name: str) -> None:
    path = folder() / f"{PREFIX}{name}"
    with Telemetry(name):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert name in running()
    assert not path.exists()
    assert name not in running()


def test_a_name_is_taken_while_its_process_lives(name: str) -> None:
    with Telemetry(name), pytest.raises(TactophoneError, match="runs already"):
        Telemetry(name)


def test_a_name_is_taken_while_its_process_lives_where_it_cannot_be_seen(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run in a container that shares the folder took it."""
    with Telemetry(name):
        monkeypatch.setattr(
            "tactophone.live.telemetry.memory.is_alive", lambda _: False
        )
        with pytest.raises(TactophoneError, match="runs already"):
            Telemetry(name)
        remove_memory(name)
        assert (folder() / f"{PREFIX}{name}").exists()
    with Telemetry(name):
        pass


def test_the_memory_of_a_killed_process_is_replaced(name: str) -> None:
    killed = (
        "import os, sys; from tactophone.live.telemetry.writer import Telemetry; "
        "Telemetry(sys.argv[1]).count('xruns'); os.abort()"
    )
    subprocess.run([sys.executable, "-c", killed, name])
    watcher = Watcher(name)
    assert watcher.snapshot().counters["xruns"] == 1
    assert not watcher.snapshot().alive
    with Telemetry(name):
        assert Watcher(name).snapshot().counters["xruns"] == 0


@pytest.mark.parametrize("wrong", ["a/b", "../x"])
def test_a_name_with_a_slash_is_one_line(wrong: str) -> None:
    with pytest.raises(TactophoneError, match="--name"):
        Memory(wrong, create=True)
    with pytest.raises(TactophoneError, match="--name"):
        Watcher(wrong)


def test_watching_a_missing_run_names_the_command_to_start(name: str) -> None:
    with pytest.raises(TactophoneError, match="tactophone receive"):
        Watcher(name)


def test_another_version_is_refused(name: str) -> None:
    with Telemetry(name):
        with (folder() / f"{PREFIX}{name}").open("r+b") as file:
            file.write(os.urandom(4))
        with pytest.raises(TactophoneError, match="another version"):
            Watcher(name)


def test_the_memory_of_another_version_is_replaced(name: str) -> None:
    (folder() / f"{PREFIX}{name}").write_bytes(b"\0" * 1000)
    with Telemetry(name):
        assert Watcher(name).snapshot().step_end == 0


def test_a_symbolic_link_is_not_opened(name: str) -> None:
    path = folder() / f"{PREFIX}{name}"
    path.symlink_to(os.devnull)
    try:
        with pytest.raises(TactophoneError, match="cannot reach"):
            Watcher(name)
    finally:
        path.unlink()


OUT_OF_SPACE = """
import os, sys
from tactophone.live.telemetry.writer import Telemetry
def refuse(*_):
    raise OSError(28, "No space left on device")
os.posix_fallocate = refuse
Telemetry(sys.argv[1])
"""


def test_a_full_memory_file_system_is_one_clear_line_and_leaves_nothing(
    name: str,
) -> None:
    """Without pages of its own, the first write into a full file system would end the
    process by SIGBUS."""
    result = subprocess.run(
        [sys.executable, "-c", OUT_OF_SPACE, name], capture_output=True, text=True
    )
    assert "no room for" in result.stderr
    assert "No space left on device" in result.stderr
    assert not (folder() / f"{PREFIX}{name}").exists()


def test_all_pages_exist_from_the_beginning(name: str) -> None:
    with Telemetry(name):
        found = (folder() / f"{PREFIX}{name}").stat()
        assert found.st_blocks * 512 >= found.st_size


@pytest.mark.parametrize("byte", [0x00, 0x01, 0xFF, 0xA5])
def test_a_run_goes_on_when_its_memory_is_overwritten_and_repairs_it(
    name: str, byte: int
) -> None:
    path = folder() / f"{PREFIX}{name}"
    with Telemetry(name) as telemetry:
        telemetry.update(RunState(role="test"), now=time.monotonic())
        telemetry.count("xruns", 3)
        watcher = Watcher(name)
        with path.open("r+b") as file:
            file.write(bytes([byte]) * path.stat().st_size)
        # Whoever watches meanwhile sees nonsense, and gets no exception.
        for _ in range(3):
            (
                watcher.snapshot(),
                watcher.pulse(),
                watcher.newest_step(),
                watcher.marks("captured"),
                watcher.predictions(),
            )
        asked = telemetry.requests(time.monotonic())
        assert {request.action for request in asked} <= {"stop", "mute"}
        telemetry.count("xruns")
        telemetry.publish(STEP_OF_SILENCE, now=time.monotonic())
        telemetry.rendered(np.zeros(128, np.float32))
        telemetry.mark((0, 240, 1.0))
        telemetry.update(RunState(role="test"), now=time.monotonic())
        snapshot = Watcher(name).snapshot()
        assert (snapshot.counters["xruns"], snapshot.state.role, snapshot.alive) == (
            4,
            "test",
            True,
        )


def test_a_run_goes_on_when_its_memory_is_removed_and_takes_nobody_elses(
    name: str,
) -> None:
    path = folder() / f"{PREFIX}{name}"
    first = Telemetry(name)
    path.unlink()
    with Telemetry(name):
        with first:
            first.count("xruns")
        assert path.exists()
        assert Watcher(name).snapshot().counters["xruns"] == 0


def test_what_killed_runs_left_is_removed_after_a_while(name: str) -> None:
    path = folder() / f"{PREFIX}{name}"
    killed = (
        "import os, sys, time; from tactophone.live.telemetry.layout import RunState; "
        "from tactophone.live.telemetry.writer import Telemetry; "
        "Telemetry(sys.argv[1]).update(RunState(), now=time.monotonic() - "
        "float(sys.argv[2])); os.abort()"
    )
    subprocess.run([sys.executable, "-c", killed, name, "1"])
    remove_leftovers()
    path.unlink()
    subprocess.run([sys.executable, "-c", killed, name, "100"])
    remove_leftovers()
    assert not path.exists()
    with Telemetry(name):
        remove_leftovers()
        assert path.exists()


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what is mapped")
def test_a_process_that_took_over_the_number_of_a_killed_run_is_not_the_run(
    name: str,
) -> None:
    """`tactophone stop` signalled it."""
    with Telemetry(name) as telemetry:
        watcher = Watcher(name)
        assert watcher.exists
        assert name in running()
        with subprocess.Popen(["sleep", "60"]) as other:
            telemetry._memory["pid"][...] = other.pid
            assert not watcher.exists
            assert name not in running()
            other.kill()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can play another user")
def test_another_users_process_with_the_number_of_a_killed_run_is_not_the_run(
    name: str,
) -> None:
    """What it has mapped cannot be read, and that was taken for the run's memory."""
    with Telemetry(name) as telemetry, subprocess.Popen(["sleep", "60"]) as other:
        telemetry._memory["pid"][...] = other.pid
        path = folder() / f"{PREFIX}{name}"
        os.chown(path, 65534, 65534)
        os.setresuid(65534, 65534, 0)
        try:
            assert not is_alive(other.pid)
            assert not Watcher(name).exists
        finally:
            os.setresuid(0, 0, 0)
            os.chown(path, 0, 0)
            other.kill()


@pytest.mark.parametrize("odd", ["", "a/b", 300 * "x", 60 * "\u2603", "a\x1b[2J"])
def test_a_name_that_no_file_can_have_is_refused_in_words(odd: str) -> None:
    with pytest.raises(TactophoneError, match="the name of a run has up to") as error:
        Telemetry(odd)
    assert "\x1b" not in str(error.value)


def test_no_process_has_the_number_that_overwritten_memory_states() -> None:
    assert is_alive(os.getpid())
    assert not any(is_alive(number) for number in (0, 1 << 31, 1 << 40, (1 << 64) - 1))


def test_memory_that_another_run_is_just_making_is_no_leftover(name: str) -> None:
    draft = folder() / f".{PREFIX}{name}"
    draft.write_bytes(bytes(64))
    try:
        remove_leftovers()
        assert draft.exists()
    finally:
        draft.unlink(missing_ok=True)


def _pipe(path: Path) -> None:
    os.mkfifo(path, 0o666)


def _other_users_file(path: Path) -> None:
    path.write_bytes(bytes(8) + (4_000_000).to_bytes(8, "little") + bytes(100))
    path.chmod(0o644)
    os.chown(path, 65534, 65534)


def _link(path: Path) -> None:
    path.symlink_to("/etc/hostname")


@pytest.mark.parametrize("squat", [_pipe, Path.mkdir, _link, _other_users_file])
def test_a_name_that_another_user_took_is_one_line_and_never_waits(
    name: str, squat: Callable[[Path], None]
) -> None:
    if squat is _other_users_file and os.getuid() != 0:
        pytest.skip("only root can make a file of another user")
    path = folder() / f"{PREFIX}{name}"
    squat(path)
    try:
        with pytest.raises(
            TactophoneError,
            match="another user or program: remove it, or name another run",
        ):
            Telemetry(name)
        with pytest.raises(TactophoneError, match="another user or program"):
            Watcher(name)
        remove_memory(name)
        remove_leftovers()
        assert os.path.lexists(path)
    finally:
        path.rmdir() if path.is_dir() else path.unlink()


def test_the_memory_of_a_run_that_was_cut_off_is_refused(name: str) -> None:
    """Whoever read beyond its end would be ended by the system."""
    with Telemetry(name):
        path = folder() / f"{PREFIX}{name}"
        os.truncate(path, path.stat().st_size - 4096)
        with pytest.raises(TactophoneError, match="another version"):
            Memory(name, create=False)


def test_a_name_that_is_no_utf8_is_refused_in_words() -> None:
    with pytest.raises(TactophoneError, match=r"bytes of UTF-8.*choose another --name"):
        Memory("run\udcff", create=True)
