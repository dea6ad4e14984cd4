"""What an end of a call remembers of the other one, and how that is forgotten."""

import argparse
import errno
import os
import signal
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest

from tactophone.cli import call
from tactophone.cli.call import _remember
from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings, change
from tactophone.net.call.process import Found
from tactophone.net.link.identity import Peers

OLD, NEW = ("AB:" * 32)[:-1], ("CD:" * 32)[:-1]


def found(fingerprint: str) -> Found:
    return Found(
        "lab", fingerprint, "robot", ["00" * 32], "192.0.2.7", False, 1.0, 0.01, False
    )


def test_a_name_that_another_machine_has_keeps_its_pin_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Peers().trusting("lab", OLD).save(tmp_path)
    _remember(tmp_path, "lab", found(NEW))
    assert dict(Peers.load(tmp_path).items()) == {"lab": OLD}
    assert not (tmp_path / "calls/lab").exists()
    assert (
        "not remembered: lab is the name of another machine" in capsys.readouterr().err
    )


def test_an_end_that_is_remembered_needs_no_code_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):  # a later call renews its secret
        _remember(tmp_path, "lab", found(NEW))
    assert dict(Peers.load(tmp_path).items()) == {"lab": NEW}
    assert (tmp_path / "calls/lab").stat().st_mode & 0o777 == 0o600
    assert "not remembered" not in capsys.readouterr().err


def test_a_full_disk_ends_no_call_and_loses_nothing_of_what_was_remembered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _remember(tmp_path, "lab", found(NEW))
    kept = (tmp_path / "calls/lab").read_text()

    def fill(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tactophone.net.link.identity.write_private", fill)
    _remember(tmp_path, "lab", replace(found(NEW), secrets=["11" * 32]))
    assert "No space left on device; the call goes on" in capsys.readouterr().err
    assert (tmp_path / "calls/lab").read_text() == kept


class Answering:
    """Stands for the process of the call and for the live side."""

    def __init__(self) -> None:
        self.answered: list[bool] = []

    def answer(self, accepted: bool) -> None:
        self.answered.append(accepted)

    def begin(self, role: str) -> None: ...


def test_who_is_forgotten_while_a_call_is_waited_for_is_not_let_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was, and was trusted again by that."""
    Peers().trusting("lab", OLD).save(tmp_path)
    waiting = cast(Any, Answering())
    args = argparse.Namespace(code="lab", yes=True)
    asked = ("asked", ["lab-pc", "operator", "0.1.0", NEW])
    for step in asked, ("found", found(NEW)):
        with pytest.raises(ConfigError, match=r"lab is not trusted any more|no other"):
            call.find_other_end(waiting, iter([step]), args, waiting, tmp_path)
    assert waiting.answered == [False]
    assert "lab is not trusted any more" in capsys.readouterr().err


def test_who_is_forgotten_during_a_call_is_hung_up_and_a_guest_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    killed = threading.Event()
    kill = os.kill

    def note(process: int, number: int) -> None:
        """Others ask with it whether a process is there."""
        if number == signal.SIGTERM:
            killed.set()
        else:
            kill(process, number)

    monkeypatch.setattr(os, "kill", note)
    monkeypatch.setattr("tactophone.live.runtime.held_files.FILES_INTERVAL", 0.01)
    settings = change(Settings(), [f"link.identity={tmp_path}"])
    Peers().trusting("other", OLD).save(tmp_path)
    threading.Thread(
        target=call.hang_up_if_forgotten, args=(settings, found(NEW)), daemon=True
    ).start()
    Peers().save(tmp_path)
    assert not killed.wait(0.1)
    _remember(tmp_path, "lab", found(NEW))
    assert not killed.wait(0.1)
    Peers.load(tmp_path).without("lab").save(tmp_path)
    assert killed.wait(5.0)
