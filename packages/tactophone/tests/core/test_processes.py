"""Children end with their parent on Ctrl-C and not by themselves; files appear whole or
not at all."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from tactophone.core import processes
from tactophone.core.processes import (
    atomic_write,
    began,
    flush_open_file,
    hold,
    make_private,
)

SCRIPT = """
import os, signal, sys
from tactophone.core.processes import Child

def blocked():
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())

def work(parent):
    os.kill(os.getpid(), signal.SIGINT)
    parent.tell(("progress", blocked()))

if __name__ == "__main__":
    for _ in range(2):  # the first child starts a process of multiprocessing's own, too
        child = Child(work, name="test")
        print(next(child.messages(None))[1], blocked(), child.how_ended())
"""


@pytest.mark.slow
def test_ctrl_c_is_blocked_in_a_child_from_its_start_and_not_in_its_parent(
    tmp_path: Path,
) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("True False \n" * 2, "")


def run_script(folder: Path, code: str) -> "subprocess.CompletedProcess[str]":
    """Run a script that starts processes, which import it by its file."""
    script = folder / "script.py"
    script.write_text(code)
    return subprocess.run(
        [sys.executable, str(script)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


BLOCKED = """
import os, signal
from tactophone.core.processes import Child

def work(parent):
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # as the sides do
    parent.tell(("progress", ""))
    parent.wants_end(60)

if __name__ == "__main__":
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    child = Child(work, name="test")
    next(child.messages(None))
    os.kill(child.pid, signal.SIGTERM)
    print(child.wait(5.0) and child.how_ended())
    child.kill()
"""


@pytest.mark.slow
def test_what_the_starter_of_a_run_blocked_ends_its_children_all_the_same(
    tmp_path: Path,
) -> None:
    """The sides waited for a kill after Ctrl-C, and vibrated for 3 s."""
    done = run_script(tmp_path, BLOCKED)
    assert (done.stdout, done.stderr) == ("signal SIGTERM\n", "")


SERVICE = """
import os, signal
from tactophone.core.processes import Child

def work(parent):
    parent.tell(("progress", ""))
    parent.wants_end(60)
    print("in order", flush=True)

if __name__ == "__main__":
    for started in (True, False):
        child = Child(work, name="test")
        if started:
            next(child.messages(None))
        for number in (signal.SIGTERM, signal.SIGHUP):
            os.kill(child.pid, number)
        if started:
            child.ask_to_end()
            child.how_ended()
    # The other one ends though nobody ends it, as where Ctrl-C cut its start short.
"""


@pytest.mark.slow
def test_what_ends_a_service_leaves_its_children_to_their_parent(
    tmp_path: Path,
) -> None:
    """A bridge that `systemctl stop` killed left what it drove vibrating."""
    done = run_script(tmp_path, SERVICE)
    assert (done.stdout, done.stderr) == ("in order\n" * 2, "")


SUSPENDED = """
import os, signal, sys, time
from pathlib import Path
from tactophone.core.processes import Child, parent_is_stopped

def work(parent, path):
    parent.tell(("progress", signal.pthread_sigmask(signal.SIG_BLOCK, ())))
    while not parent_is_stopped():
        time.sleep(0.01)
    Path(path).touch()
    parent.wants_end(60)

if __name__ == "__main__":
    child = Child(work, sys.argv[1], name="test")
    # JACK's library blocks SIGPIPE in the process that starts this one.
    blocked = set(next(child.messages(None))[1]) - {signal.SIGPIPE}
    print(*sorted(each.name for each in blocked), parent_is_stopped(), flush=True)
    os.killpg(0, signal.SIGSTOP)
    child.ask_to_end()
    print(child.how_ended())
"""


@pytest.mark.slow
def test_what_stops_a_process_group_leaves_its_children_running_and_knowing(
    tmp_path: Path,
) -> None:
    """A side that stood still with its watchdog vibrated without end."""
    script, seen = tmp_path / "script.py", tmp_path / "seen"
    script.write_text(SUSPENDED)
    with subprocess.Popen(
        [sys.executable, str(script), str(seen)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            assert process.stdout is not None
            said = process.stdout.readline()
            end = time.monotonic() + 20.0
            while not seen.exists() and time.monotonic() < end:
                time.sleep(0.02)
            assert seen.exists()
            assert said == "SIGINT SIGTSTP SIGTTIN SIGTTOU SIGUSR1 False\n"
            os.killpg(process.pid, signal.SIGCONT)
            assert process.stdout.read() == "\n"
        finally:
            process.kill()


HOSTILE = """
import os, sys
from pathlib import Path
from tactophone.core.processes import Child, open_pool

def work(parent):
    parent.tell(("progress", os.environ["PYTHONSAFEPATH"]))

if __name__ == "__main__":
    child = Child(work, name="test")
    print(next(child.messages(None))[1], child.how_ended())
    with open_pool(1) as pool:
        print(pool.submit(abs, -2).result(), "PYTHONSAFEPATH" in os.environ)
"""


@pytest.mark.slow
def test_no_process_runs_the_modules_of_the_current_folder(tmp_path: Path) -> None:
    script, folder = tmp_path / "script.py", tmp_path / "downloaded"
    script.write_text(HOSTILE)
    for name in ("multiprocessing", "os", "signal", "tactophone"):
        (folder / name).mkdir(parents=True)
        (folder / name / "__init__.py").write_text("open('executed', 'w')\n1 / 0\n")
    done = subprocess.run(
        [sys.executable, script], cwd=folder, capture_output=True, text=True, timeout=60
    )
    assert (done.stdout, done.stderr) == ("1 \n2 False\n", "")
    assert not (folder / "executed").exists()


DEAF = """
import os, signal, sys
from pathlib import Path
from tactophone.core import processes

def work(parent, path):
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    processes.time.sleep = lambda grace: None
    Path(path).write_text(str(os.getpid()))
    signal.pause()

if __name__ == "__main__":
    processes.Child(work, sys.argv[1], name="test").how_ended()
"""


KILLED = """
import signal
from tactophone.core.processes import Child

def work(parent):
    parent.tell("ready")
    signal.pause()

if __name__ == "__main__":
    child = Child(work, name="test")
    next(child.messages(None))
    child.kill()
    print(child.alive)
"""


@pytest.mark.slow
def test_a_killed_child_is_gone_before_another_takes_its_place(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(KILLED)
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60
    )
    assert done.stdout == "False\n", done.stderr


@pytest.mark.slow
def test_a_child_that_heeds_nothing_ends_with_its_killed_parent(tmp_path: Path) -> None:
    script, path = tmp_path / "script.py", tmp_path / "pid"
    script.write_text(DEAF)
    parent = subprocess.Popen([sys.executable, script, path])
    try:
        _wait_until(lambda: path.exists() and path.read_text() != "")
        child = int(path.read_text())
        assert psutil.pid_exists(child)
    finally:
        parent.kill()
    _wait_until(lambda: not psutil.pid_exists(child))


WORKERS = """
import os, sys, time
from pathlib import Path
from tactophone.core.processes import open_pool

def work(folder):
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)

if __name__ == "__main__":
    with open_pool(2) as pool:
        list(pool.map(work, [sys.argv[1]] * 2))
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_workers_end_with_a_killed_parent(how: signal.Signals, tmp_path: Path) -> None:
    script, folder = tmp_path / "script.py", tmp_path / "pids"
    script.write_text(WORKERS)
    folder.mkdir()
    parent = subprocess.Popen([sys.executable, script, folder])
    try:
        _wait_until(lambda: len(list(folder.iterdir())) == 2)
        workers = [int(path.name) for path in folder.iterdir()]
        os.kill(parent.pid, how)
        parent.wait(10)
        _wait_until(lambda: not any(map(psutil.pid_exists, workers)))
    finally:
        parent.kill()


def _wait_until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_file_that_fails_half_way_leaves_the_old_one_and_nothing_else(
    tmp_path: Path,
) -> None:
    path = tmp_path / "file.txt"
    with atomic_write(path) as unfinished:
        unfinished.write_text("old")
    with (
        pytest.raises(UnicodeEncodeError),
        atomic_write(path) as unfinished,
        unfinished.open("w", encoding="ascii") as file,
    ):
        file.writelines(["ne", "ü"])
    assert (path.read_text(), list(tmp_path.iterdir())) == ("old", [path])


def test_what_is_written_reaches_no_file_by_a_link_at_its_unfinished_name(
    tmp_path: Path,
) -> None:
    victim, path = tmp_path / "victim", tmp_path / "table.csv"
    victim.write_text("mine")
    for link in (os.symlink, os.link):
        link(victim, tmp_path / ".table.csv.part")
        with atomic_write(path) as unfinished:
            unfinished.write_text("new")
        assert (victim.read_text(), path.read_text()) == ("mine", "new")


def test_a_private_file_is_never_one_that_another_user_made_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder that others may write to, one may appear at any moment."""
    path = tmp_path / "run.mcap"
    monkeypatch.setattr(processes, "make_room", lambda found: found.touch(0o666))
    with pytest.raises(FileExistsError):
        make_private(path)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can make another user's pipe")
def test_another_users_pipe_hears_nothing_of_what_is_written(tmp_path: Path) -> None:
    """Whoever read from it got the log of a run, with its sound."""
    for make in (make_private, _write_whole):
        path = tmp_path / "run.mcap"
        for name in (path, path.with_name(".run.mcap.part")):
            os.mkfifo(name, 0o666)
            os.chown(name, 65534, 65534)
        make(path)
        assert path.is_file()
        path.unlink()
        path.with_name(".run.mcap.part").unlink(missing_ok=True)


def _write_whole(path: Path) -> None:
    with atomic_write(path) as unfinished:
        assert not unfinished.is_fifo()
        unfinished.write_text("new")


def test_a_file_that_another_run_writes_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    make_private(path)
    with path.open("w") as file:
        hold(file.fileno())
        with pytest.raises(OSError, match="another run is writing it"):
            make_private(path)
        file.write("predictions")
    assert path.read_text() == "predictions"
    make_private(path)  # it is whoever comes next's, once it is closed
    assert path.read_text() == ""


def test_a_pipe_of_this_user_is_written_to(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "run.csv")
    make_private(tmp_path / "run.csv")
    assert (tmp_path / "run.csv").is_fifo()


def test_a_device_is_written_to_as_it_is() -> None:
    make_private(Path(os.devnull))
    assert not Path(os.devnull).is_file()


def test_what_goes_to_a_pipe_or_a_device_needs_no_disk() -> None:
    read, write = os.pipe()
    with open(os.devnull, "wb") as device:
        for descriptor in (write, device.fileno()):
            flush_open_file(descriptor)
    os.close(read)
    os.close(write)


def test_a_file_is_on_the_disk_before_it_takes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    for name in ("fsync", "replace"):
        real = getattr(os, name)

        def noted(*values, name=name, real=real):
            calls.append(name)
            return real(*values)

        monkeypatch.setattr(os, name, noted)
    with atomic_write(tmp_path / "table.csv") as unfinished:
        unfinished.write_text("new")
    assert calls == ["fsync", "replace"]


def test_when_this_process_began_is_known_by_the_monotonic_clock() -> None:
    age = time.time() - psutil.Process().create_time()
    assert time.monotonic() - began() == pytest.approx(age, abs=1.0)
