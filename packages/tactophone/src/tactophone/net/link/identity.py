"""The local identity and the trusted peers: a self-signed certificate, and the pinned
fingerprints of peers.

No certificate authority is involved. Two people compare fingerprints once, as with SSH,
and each program then accepts exactly the pinned certificates (RFC 5763 section 5). The
private key never leaves its file. A key file that others may read is refused, not
repaired: others may have read it already.
"""

import datetime
import hmac
import os
import shlex
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from tactophone.core.errors import ConfigError
from tactophone.core.processes import atomic_write, flush_open_file

IDENTITY_FOLDER = Path("~/.config/tactophone")
"""Default folder of the key and the trusted peers."""

KEY_FILE = "key.pem"
"""File of the private key, which only its user may read."""

CERTIFICATE_FILE = "certificate.pem"
"""File of the certificate, whose fingerprint peers pin."""

PEERS_FILE = "peers.txt"
"""File of the trusted peers: a fingerprint and a name in each line."""


def identity_folder(chosen: str | Path = "") -> Path:
    """Return the folder of the key and the trusted peers: the chosen one, or the
    default."""
    return Path(chosen or IDENTITY_FOLDER).expanduser()


_LIFETIME = datetime.timedelta(days=365 * 30)
"""A certificate ends with its pin, not by date; OpenSSL requires a date."""

_UNREADABLE = (
    OSError,
    ValueError,
    TypeError,
    IndexError,
    UnsupportedAlgorithm,
    x509.InvalidVersion,
)
"""What the library raises for a damaged key or certificate."""


@dataclass(frozen=True, slots=True)
class Identity:
    """A private key and its self-signed certificate; ``repr`` shows neither."""

    key: ec.EllipticCurvePrivateKey = field(repr=False)
    certificate: x509.Certificate = field(repr=False)

    @classmethod
    def create(cls, name: str) -> Self:
        """Make a new identity, in memory only; raises `ConfigError` for a name that is
        none."""
        _check_name(name)
        key = ec.generate_private_key(ec.SECP256R1())
        title = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        now = datetime.datetime.now(datetime.UTC)
        builder = (
            x509.CertificateBuilder(
                title, title, key.public_key(), x509.random_serial_number()
            )
            .not_valid_before(now - datetime.timedelta(days=1))
            .not_valid_after(now + _LIFETIME)
        )
        return cls(key, builder.sign(key, hashes.SHA256()))

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Read an identity written by `save`.

        Raises `ConfigError` when it is missing or damaged, or when others may read its
        key, or put another in its place.
        """
        key_path = folder / KEY_FILE
        _check_private(key_path, forbidden=0o077)
        try:
            key = serialization.load_pem_private_key(
                key_path.read_bytes(), password=None
            )
            certificate = x509.load_pem_x509_certificate(
                (folder / CERTIFICATE_FILE).read_bytes()
            )
            # The library parses keys and names only when asked for them, so they are
            # asked for here.
            matches = key.public_key() == certificate.public_key()
            _common_name(certificate)
        except _UNREADABLE as error:
            raise ConfigError(
                f"{folder}: no usable key and certificate ({error}); run `tactophone "
                "pair init`"
            ) from error
        if not isinstance(key, ec.EllipticCurvePrivateKey) or not matches:
            raise ConfigError(
                f"{folder}: the key and the certificate do not belong together; run "
                "`tactophone pair init`"
            )
        return cls(key, certificate)

    @property
    def name(self) -> str:
        return _common_name(self.certificate)

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the certificate, as RFC 8122 has it (``4A:AD:B9:...``), for two
        people to compare."""
        return self.certificate.fingerprint(hashes.SHA256()).hex(":").upper()

    @property
    def trust_command(self) -> str:
        """The line to run on another machine, so that it trusts this one."""
        return shlex.join(["tactophone", "pair", "trust", self.name, self.fingerprint])

    def save(self, folder: Path) -> None:
        """Write certificate and key (mode 0600), the key last: on a full disk none is
        left that lacks its certificate.

        Raises `ConfigError` when a key exists: peers may have pinned its certificate.
        """
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        pem = self.key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
        if (folder / KEY_FILE).exists():
            raise ConfigError(
                f"{folder / KEY_FILE} exists and peers may have pinned it; delete it "
                "by hand to make a new one"
            )
        with atomic_write(folder / CERTIFICATE_FILE) as unfinished:
            unfinished.write_bytes(
                self.certificate.public_bytes(serialization.Encoding.PEM)
            )
        write_private(folder / KEY_FILE, pem)


class Peers:
    """Trusted peers: names by pinned fingerprint, stored in a text file of lines
    ``FINGERPRINT NAME``."""

    def __init__(self, names: Mapping[str, str] | None = None) -> None:
        self._names = {
            parse_fingerprint(pin): name for pin, name in (names or {}).items()
        }

    @classmethod
    def load(cls, folder: Path) -> Self:
        """Read the peers of ``folder``; none when there is no such file.

        Raises `ConfigError` when a line is malformed, or when others may write to the
        file, or put another in its place.
        """
        path = folder / PEERS_FILE
        if not path.exists():
            return cls()
        _check_private(path, forbidden=0o022)
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(
                f"{path} cannot be read as text ({error}); delete it and run "
                "`tactophone pair trust` again"
            ) from error
        lines = [line.split(maxsplit=1) for line in text.splitlines() if line.strip()]
        if malformed := next((line for line in lines if len(line) != 2), None):
            raise ConfigError(
                f"{path}: {malformed[0]!r} has no name; a line is `FINGERPRINT NAME`"
            )
        return cls(dict(lines))

    def save(self, folder: Path) -> None:
        """Write the peers to ``folder``, atomically."""
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        text = "".join(f"{pin} {name}\n" for pin, name in self._names.items())
        draft = folder / f".{PEERS_FILE}.{os.getpid()}"
        write_private(draft, text.encode())
        draft.replace(folder / PEERS_FILE)

    def trusting(self, name: str, fingerprint: str) -> "Peers":
        """Return the peers with one added, or with a new fingerprint for a known name.

        Raises `ConfigError` for a name that is none.
        """
        _check_name(name)
        kept = {pin: other for pin, other in self._names.items() if other != name}
        return Peers({**kept, fingerprint: name})

    def without(self, name: str) -> "Peers":
        if name not in self._names.values():
            raise ConfigError(
                f"no peer is named {name!r}; there are: "
                f"{', '.join(self._names.values()) or 'none'}"
            )
        return Peers(
            {pin: other for pin, other in self._names.items() if other != name}
        )

    def name_of(self, fingerprint: str) -> str | None:
        """Return the name for a fingerprint, or ``None``; in constant time for each
        entry."""
        matches = [
            name
            for pin, name in self._names.items()
            if hmac.compare_digest(pin, fingerprint)
        ]
        return matches[0] if matches else None

    def items(self) -> list[tuple[str, str]]:
        return [(name, pin) for pin, name in self._names.items()]


LONGEST_NAME = 64
"""Characters of a machine's name, as X.509 has it (RFC 5280, ``ub-common-name``)."""


def _check_name(name: str) -> None:
    """Raise `ConfigError` unless a name can stand in a certificate, and in a line of
    the list of peers."""
    if not 1 <= len(name) <= LONGEST_NAME or not name.isprintable() or name.isspace():
        raise ConfigError(
            f"a machine's name is a line of 1 to {LONGEST_NAME} characters, unlike "
            f"{name[: LONGEST_NAME + 1]!r}: choose another"
        )


def _common_name(certificate: x509.Certificate) -> str:
    return str(certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def parse_fingerprint(text: str) -> str:
    """Normalise a fingerprint with or without colons, in either case; `ConfigError`
    when it is malformed."""
    try:
        digest = bytes.fromhex(text.replace(":", ""))
    except ValueError:
        digest = b""
    if len(digest) != hashes.SHA256.digest_size:
        raise ConfigError(
            f"{text!r} is not a fingerprint: 32 two-digit groups as `tactophone pair "
            "show` prints them"
        )
    return digest.hex(":").upper()


def _check_private(path: Path, *, forbidden: int) -> None:
    """Raise `ConfigError` if another user may do with a file what is forbidden, or put
    another in its place."""
    _check_permissions(path, forbidden=forbidden)
    _check_permissions(path.parent, forbidden=0o022)


def _check_permissions(path: Path, *, forbidden: int) -> None:
    try:
        status = path.stat()
    except OSError as error:
        raise ConfigError(
            f"{path}: {error.strerror}; make an identity with `tactophone pair init`"
        ) from error
    if status.st_mode & forbidden:
        mode = stat.filemode(status.st_mode)
        private = "700" if path.is_dir() else "600"
        raise ConfigError(
            f"{path} has mode {mode}, but no other user may access it. Run `chmod "
            f"{private} {path}`; "
            "if somebody may have accessed it, delete it and pair again"
        )
    if status.st_uid not in (os.geteuid(), 0):
        raise ConfigError(
            f"{path} belongs to user {status.st_uid}, not to this user; run "
            "`tactophone pair init`"
        )


def write_private(path: Path, content: bytes) -> None:
    """Create a file with mode 0600 from the start, whole or not at all, and on the disk
    when this returns; `FileExistsError` when it exists."""
    file = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb")
    try:
        with file:
            file.write(content)
            file.flush()
            flush_open_file(file.fileno())
    except OSError:
        path.unlink()
        raise
