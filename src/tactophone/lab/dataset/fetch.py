"""Published data sets by name: downloads one into a folder, shows its licence, and unpacks nothing outside it."""

import hashlib
import urllib.error
import urllib.request
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from types import MappingProxyType

from tactophone.core.errors import DatasetError

CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class Share:
    """Where a data set is: its page, its archive, a SHA-256 if one was published, and its licence as far as known."""

    page: str
    archive: str
    licence: str
    sha256: str = ""


SHARES = MappingProxyType(
    {
        "authors": Share(
            "https://github.com/AIS-Bonn/Roughness_Sensing",
            "https://cloud.vi.cs.uni-bonn.de/index.php/s/KmKSncpDzQ7i3je/download",
            "BSD 3-Clause, as their repository states; read what the share itself says",
        )
    }
)
"""By name; the authors' address is that of their README."""


def fetch(
    name: str, out: Path, *, archive: str = "", sha256: str = "", progress: Callable[[int, int], None] = lambda *_: None
) -> tuple[Path, str]:
    """Download and unpack a data set; return the folder with its sound, and the archive's SHA-256.

    An interrupted download goes on where the server allows it. ``archive`` replaces the address. Raises `DatasetError`
    if the network fails, the checksum differs, or the archive is none or reaches outside ``out``.
    """
    share = SHARES[name]
    out.mkdir(parents=True, exist_ok=True)
    target = out / f"{name}.zip"
    if not target.exists():
        _download(archive or share.archive, target.with_suffix(".part"), progress)
        target.with_suffix(".part").rename(target)
    with target.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    wanted = sha256 or share.sha256
    if wanted and found != wanted:
        raise DatasetError(f"{target}: its SHA-256 is {found}, not {wanted}; delete it and fetch again")
    _unpack(target, out)
    inner = [path.parent.parent for path in sorted(out.rglob("stereo")) if path.parent.name == "opus"]
    return (inner[0] if inner else out), found


def _download(address: str, target: Path, progress: Callable[[int, int], None]) -> None:
    done = target.stat().st_size if target.exists() else 0
    request = urllib.request.Request(address, headers={"Range": f"bytes={done}-"} if done else {})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            resumed = answer.status == 206
            done = done if resumed else 0
            total = done + int(answer.headers.get("Content-Length", 0))
            with target.open("ab" if resumed else "wb") as file:
                while chunk := answer.read(CHUNK):
                    file.write(chunk)
                    done += len(chunk)
                    progress(done, total)
    except (OSError, ValueError, urllib.error.URLError) as error:
        raise DatasetError(f"{address}: cannot be downloaded ({error}); try again: it goes on where it ended") from None
    if total and done < total:
        raise DatasetError(f"{address}: ended after {done} of {total} bytes; try again: it goes on there")


def _unpack(archive: Path, out: Path) -> None:
    try:
        with zipfile.ZipFile(archive) as files:
            for entry in files.infolist():
                path = PurePosixPath(entry.filename)
                if path.is_absolute() or ".." in path.parts or "\\" in entry.filename:
                    raise DatasetError(f"{archive}: holds {entry.filename!r}, outside its folder; do not use it")
            files.extractall(out)
    except zipfile.BadZipFile as error:
        raise DatasetError(f"{archive}: is no zip archive ({error}); delete it and fetch again") from None
