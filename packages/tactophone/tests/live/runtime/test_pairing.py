import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tactophone.core.settings import Settings
from tactophone.live.runtime.pairing import pair_on_one_machine, temporary_keys
from tactophone.net.link.identity import Identity, Peers


def test_both_sides_trust_each_other_and_nobody_else(tmp_path: Path) -> None:
    robot, operator = pair_on_one_machine(Settings(), tmp_path, name="loopback")
    assert (robot.process.name, operator.process.name) == ("loopback-robot", "loopback")
    assert robot.link.port == operator.link.port != 0
    assert robot.link.peer == operator.link.host == "127.0.0.1"
    for own, other in ((robot, operator), (operator, robot)):
        known = Peers.load(Path(own.link.identity))
        assert [pin for _, pin in known.items()] == [
            Identity.load(Path(other.link.identity)).fingerprint
        ]


def test_keys_are_fresh_each_time(tmp_path: Path) -> None:
    pairs = [
        pair_on_one_machine(Settings(), tmp_path / str(number), name="loopback")[0]
        for number in range(2)
    ]
    first, second = (
        Identity.load(Path(settings.link.identity)).fingerprint for settings in pairs
    )
    assert first != second


def test_keys_of_killed_runs_are_removed_by_the_next() -> None:
    program = (
        "import os, signal; from tactophone.live.runtime.pairing import "
        "temporary_keys\n"
        "with temporary_keys() as folder: print(folder, flush=True); "
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    left = Path(
        subprocess.run(
            [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True
        ).stdout.strip()
    )
    assert left.is_dir()
    with temporary_keys() as folder:
        assert not left.exists()
        with temporary_keys():
            assert folder.is_dir()
    assert not folder.exists()


def test_a_run_whose_process_cannot_be_seen_keeps_its_keys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run in a container that shares the folder removed them."""
    # Not that of other runs of this machine.
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with temporary_keys() as folder:
        monkeypatch.setattr("tactophone.live.runtime.pairing.is_alive", lambda _: False)
        with temporary_keys():
            assert folder.is_dir()
