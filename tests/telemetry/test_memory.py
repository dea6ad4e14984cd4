import os
import stat
import subprocess
import sys
import uuid

import pytest

from tactophone.errors import TactophoneError
from tactophone.telemetry import Telemetry, Watcher, running
from tactophone.telemetry.memory import PREFIX, folder


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


def test_the_memory_of_a_killed_process_is_replaced(name: str) -> None:
    killed = (
        "import os, sys; from tactophone.telemetry import Telemetry; Telemetry(sys.argv[1]).count('xruns'); os.abort()"
    )
    subprocess.run([sys.executable, "-c", killed, name])
    watcher = Watcher(name)
    assert watcher.snapshot().counters["xruns"] == 1
    assert not watcher.snapshot().alive
    with Telemetry(name):
        assert Watcher(name).snapshot().counters["xruns"] == 0


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
        with pytest.raises(TactophoneError, match="cannot watch"):
            Watcher(name)
    finally:
        path.unlink()
