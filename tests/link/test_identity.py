"""Keys and pins on disk, and what is refused."""

from pathlib import Path

import pytest

from tactophone.errors import ConfigError
from tactophone.link import Identity, Peers
from tactophone.link.identity import parse_fingerprint


def test_an_identity_is_saved_and_loaded(tmp_path: Path) -> None:
    identity = Identity.create("robot")
    identity.save(tmp_path / "new" / "folder")
    loaded = Identity.load(tmp_path / "new" / "folder")
    assert (loaded.name, loaded.fingerprint) == ("robot", identity.fingerprint)


def test_every_identity_is_its_own() -> None:
    assert Identity.create("robot").fingerprint != Identity.create("robot").fingerprint


@pytest.mark.parametrize("mode", [0o604, 0o640, 0o660, 0o700 | 0o001])
def test_a_key_that_others_may_access_is_refused(tmp_path: Path, mode: int) -> None:
    Identity.create("robot").save(tmp_path)
    (tmp_path / "key.pem").chmod(mode)
    with pytest.raises(ConfigError, match="chmod 600"):
        Identity.load(tmp_path)


def test_missing_broken_and_mismatched_keys_have_different_errors(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="pair init"):
        Identity.load(tmp_path)
    Identity.create("robot").save(tmp_path)
    Identity.create("operator").save(tmp_path / "other")
    (tmp_path / "certificate.pem").write_bytes((tmp_path / "other" / "certificate.pem").read_bytes())
    with pytest.raises(ConfigError, match="do not belong together"):
        Identity.load(tmp_path)
    (tmp_path / "key.pem").write_text("nonsense")
    with pytest.raises(ConfigError, match="no usable key"):
        Identity.load(tmp_path)


def test_peers_are_saved_and_must_not_be_writable_by_others(tmp_path: Path) -> None:
    peers = Peers().trusting("robot one", "ab" * 32)
    peers.save(tmp_path)
    assert Peers.load(tmp_path).items() == peers.items()
    (tmp_path / "peers.txt").chmod(0o622)
    with pytest.raises(ConfigError, match="no other user may access it"):
        Peers.load(tmp_path)


def test_a_line_without_a_name_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "peers.txt"
    path.write_text("ab" * 32)
    path.chmod(0o600)
    with pytest.raises(ConfigError, match="has no name"):
        Peers.load(tmp_path)


def test_a_name_has_one_fingerprint() -> None:
    peers = Peers().trusting("robot", "ab" * 32).trusting("robot", "cd" * 32)
    assert [pin[:5] for _, pin in peers.items()] == ["CD:CD"]
    assert peers.name_of(parse_fingerprint("cd" * 32)) == "robot"
    assert peers.name_of(parse_fingerprint("ab" * 32)) is None


@pytest.mark.parametrize("text", ["", "AB", "zz" * 32, "ab" * 33])
def test_a_malformed_fingerprint_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="not a fingerprint"):
        parse_fingerprint(text)
