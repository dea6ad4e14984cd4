"""Keys and pins on disk, and what is refused."""

import contextlib
import datetime
import os
import stat
from pathlib import Path

import numpy as np
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec

from tactophone.core.errors import ConfigError
from tactophone.net.link.identity import (
    Identity,
    Peers,
    parse_fingerprint,
    write_private,
)


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


@pytest.mark.parametrize("name", ["key.pem", "peers.txt"])
def test_a_file_of_another_user_is_refused(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    Identity.create("robot").save(tmp_path)
    Peers({}).save(tmp_path)
    own = Path.stat

    def owned(path: Path, **options: bool) -> os.stat_result:
        fields = list(own(path, **options))
        fields[stat.ST_UID] += (path.name == name) * (os.geteuid() + 1001)
        return os.stat_result(fields)

    monkeypatch.setattr(Path, "stat", owned)
    with pytest.raises(ConfigError, match="belongs to user"):
        Identity.load(tmp_path) if name == "key.pem" else Peers.load(tmp_path)


def test_missing_broken_and_mismatched_keys_have_different_errors(
    tmp_path: Path,
) -> None:
    with pytest.raises(ConfigError, match="pair init"):
        Identity.load(tmp_path)
    Identity.create("robot").save(tmp_path)
    Identity.create("operator").save(tmp_path / "other")
    (tmp_path / "certificate.pem").write_bytes(
        (tmp_path / "other" / "certificate.pem").read_bytes()
    )
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


def test_keys_and_peers_are_on_the_disk_before_anybody_pins_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot that was unplugged soon after it was paired had a key of 0 bytes."""
    flushed: dict[str, int] = {}
    fsync = os.fsync

    def note(file: int) -> None:
        fsync(file)
        name = Path(os.readlink(f"/proc/self/fd/{file}")).name
        flushed[name] = os.fstat(file).st_size

    monkeypatch.setattr(os, "fsync", note)
    Identity.create("robot").save(tmp_path)
    Peers().trusting("robot one", "ab" * 32).save(tmp_path)
    key, peers = flushed["key.pem"], flushed[f".peers.txt.{os.getpid()}"]
    assert (key, peers) == tuple(
        (tmp_path / name).stat().st_size for name in ("key.pem", "peers.txt")
    )


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


@pytest.mark.parametrize("content", [b"\xff\xfe", b"\x00\x80 robot"])
def test_a_list_of_peers_that_is_not_text_is_refused_in_words(
    tmp_path: Path, content: bytes
) -> None:
    (tmp_path / "peers.txt").write_bytes(content)
    (tmp_path / "peers.txt").chmod(0o600)
    with pytest.raises(ConfigError):
        Peers.load(tmp_path)


def test_any_change_of_key_or_certificate_is_refused_in_words_or_loads(
    tmp_path: Path,
) -> None:
    """The library raises many types of its own: for a version, an algorithm or a name
    that it does not know."""
    Identity.create("robot").save(tmp_path)
    original = {path: path.read_bytes() for path in tmp_path.iterdir()}
    random = np.random.default_rng(0)
    for _ in range(400):
        path = list(original)[random.integers(len(original))]
        changed = bytearray(original[path])
        for at in random.integers(0, len(changed), 3):
            changed[at] = random.choice(list(b"ABCxyz019+/=-\n\xff"))
        path.write_bytes(changed)
        with contextlib.suppress(ConfigError):
            assert isinstance(Identity.load(tmp_path).name, str)
        path.write_bytes(original[path])


def test_a_certificate_without_a_name_is_refused_in_words(tmp_path: Path) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    now = datetime.datetime.now(datetime.UTC)
    builder = x509.CertificateBuilder(
        x509.Name([]), x509.Name([]), key.public_key(), x509.random_serial_number()
    )
    certificate = (
        builder.not_valid_before(now)
        .not_valid_after(now + datetime.timedelta(1))
        .sign(key, hashes.SHA256())
    )
    Identity(key, certificate).save(tmp_path)
    with pytest.raises(ConfigError, match="no usable key and certificate"):
        Identity.load(tmp_path)


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_peers_that_the_group_or_others_may_write_are_refused(
    tmp_path: Path, mode: int
) -> None:
    Peers().trusting("robot one", "ab" * 32).save(tmp_path)
    (tmp_path / "peers.txt").chmod(mode)
    with pytest.raises(ConfigError, match="no other user may access it"):
        Peers.load(tmp_path)


@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702])
def test_a_folder_in_which_others_may_put_another_file_is_refused(
    tmp_path: Path, mode: int
) -> None:
    Identity.create("hand").save(tmp_path)
    Peers().trusting("robot one", "ab" * 32).save(tmp_path)
    tmp_path.chmod(mode)
    for load in (Identity.load, Peers.load):
        with pytest.raises(ConfigError, match="Run `chmod 700"):
            load(tmp_path)


def test_a_private_file_is_never_written_through_what_stands_at_its_name(
    tmp_path: Path,
) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    (tmp_path / "link").symlink_to(victim)
    for name in ("victim", "link"):
        with pytest.raises(FileExistsError):
            write_private(tmp_path / name, b"key")
    assert victim.read_text() == "mine"


@pytest.mark.parametrize("kept", [Identity.create("robot"), Peers()])
def test_the_folder_of_a_key_or_of_peers_is_this_users_alone(
    kept: Identity | Peers, tmp_path: Path
) -> None:
    kept.save(tmp_path / "new")
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o700
