"""The name of a demonstration's run is free, whatever another user made."""

import os
import tempfile
from pathlib import Path

import pytest

from tactophone_lab.app import demo
from tactophone_lab.app.demo import free_name


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(demo, "running", list)


def test_two_demonstrations_have_two_names() -> None:
    with free_name() as first, free_name() as second:
        assert (first, second) == ("demo", "demo-2")
    with free_name() as again:
        assert again == "demo"


def test_a_lock_that_cannot_be_opened_keeps_no_demonstration_from_starting(
    tmp_path: Path,
) -> None:
    """As another user's, in a folder that all may write to."""
    lock = tmp_path / f"tactophone-{os.getuid()}-demo.lock"
    lock.symlink_to("/dev/null")
    with free_name() as name:
        assert name == "demo"


@pytest.mark.skipif(os.getuid() != 0, reason="only root can make another user's file")
def test_another_users_lock_says_nothing(tmp_path: Path) -> None:
    import fcntl

    lock = tmp_path / f"tactophone-{os.getuid()}-demo.lock"
    with lock.open("w") as held:
        os.chown(lock, 65534, 65534)
        fcntl.flock(held, fcntl.LOCK_EX)
        with free_name() as name:
            assert name == "demo"
