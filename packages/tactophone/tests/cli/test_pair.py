"""Pairing two machines, as two people would."""

import json
import shlex
import stat
from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.net.link.identity import Identity, Peers


def pair(*words: str | Path) -> int:
    return main(["pair", *map(str, words)])


def test_two_machines_trust_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, operator = tmp_path / "robot", tmp_path / "operator"
    lines = []
    for folder in (robot, operator):
        assert pair("init", "--name", folder.name, "--identity", folder) == 0
        lines.append(capsys.readouterr().out.split()[1:])
    assert main([*lines[0], "--identity", str(operator)]) == 0
    assert main([*lines[1], "--identity", str(robot)]) == 0
    assert Peers.load(operator).name_of(Identity.load(robot).fingerprint) == "robot"
    assert Peers.load(robot).name_of(Identity.load(operator).fingerprint) == "operator"


def test_show_prints_json_and_never_the_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair("init", "--name", "robot", "--identity", tmp_path)
    pair("trust", "operator", "ab" * 32, "--identity", tmp_path)
    capsys.readouterr()
    assert pair("show", "--json", "--identity", tmp_path) == 0
    shown = capsys.readouterr().out
    assert json.loads(shown)["trusted"] == {"operator": ":".join(["AB"] * 32)}
    assert pair("show", "--identity", tmp_path) == 0
    assert "trusted: operator AB:AB" in capsys.readouterr().out
    assert "PRIVATE" not in shown


def test_only_the_owner_can_read_the_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair("init", "--identity", tmp_path / "keys")
    key = tmp_path / "keys" / "key.pem"
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert stat.S_IMODE(key.parent.stat().st_mode) == 0o700
    key.chmod(0o640)
    assert pair("show", "--identity", tmp_path / "keys") == 1
    assert "if somebody may have accessed it" in capsys.readouterr().err


def test_a_key_is_never_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair("init", "--identity", tmp_path)
    before = (tmp_path / "key.pem").read_bytes()
    assert pair("init", "--identity", tmp_path) == 1
    assert "peers may have pinned it" in capsys.readouterr().err
    assert (tmp_path / "key.pem").read_bytes() == before


def test_a_malformed_fingerprint_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pair("trust", "robot", "AB:CD", "--identity", tmp_path) == 1
    assert "is not a fingerprint" in capsys.readouterr().err


def test_a_peer_can_be_forgotten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair("trust", "robot", "ab" * 32, "--identity", tmp_path)
    assert pair("forget", "nobody", "--identity", tmp_path) == 1
    assert "there are: robot" in capsys.readouterr().err
    assert pair("forget", "robot", "--identity", tmp_path) == 0
    assert Peers.load(tmp_path).items() == []


@pytest.mark.parametrize(
    "name", ["", " ", "a" * 65, "robot\n" + "cd" * 32 + " evil", "a\u2028b", "a\udcff"]
)
def test_a_name_that_is_no_line_is_refused_and_spoils_no_list_of_peers(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert pair("init", "--name", name, "--identity", tmp_path) == 1
    assert pair("trust", name, "ab" * 32, "--identity", tmp_path) == 1
    assert "a machine's name is a line of 1 to 64 characters" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_the_line_to_copy_quotes_a_name_with_spaces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair("init", "--name", "arm; touch x", "--identity", tmp_path)
    words = shlex.split(capsys.readouterr().out)
    assert words[:4] == ["tactophone", "pair", "trust", "arm; touch x"]
