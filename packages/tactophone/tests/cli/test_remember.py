"""What an end of a call remembers of the other one."""

from pathlib import Path

import pytest

from tactophone.cli.call import _remember
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
