"""``tactophone fetch authors``: the recordings of the paper's authors, downloaded and
unpacked; an interrupted download goes on."""

import hashlib
import urllib.error
import urllib.request
import zipfile
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from tactophone.core.errors import DatasetError

ARCHIVE = "https://cloud.vi.cs.uni-bonn.de/index.php/s/KmKSncpDzQ7i3je/download"
"""The authors' recordings, by the README of
https://github.com/AIS-Bonn/Roughness_Sensing."""

LICENCE = (
    "BSD 3-Clause, as the authors' repository states; read what the share itself says"
)
"""What is known of the licence, printed before the download."""

CHUNK = 1 << 20
"""Bytes that are read at once: 1 MiB."""


@dataclass(frozen=True, slots=True)
class FetchedSet:
    """A data set that was downloaded and unpacked."""

    folder: Path
    """The folder that holds the sound."""
    sha256: str
    """Checksum of the archive."""


def fetch_authors(out: Path, *, archive: str = ARCHIVE, sha256: str = "") -> FetchedSet:
    """Download and unpack the authors' recordings; nothing is written outside ``out``.

    Raises `DatasetError` if the network fails, the checksum differs, or the archive is
    none or reaches outside ``out``.
    """
    out.mkdir(parents=True, exist_ok=True)
    target = out / "authors.zip"
    if not target.exists():
        _download(archive, target.with_suffix(".part"))
        target.with_suffix(".part").rename(target)
    with target.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if sha256 and found != sha256:
        raise DatasetError(
            f"{target}: its SHA-256 is {found}, not {sha256}; delete it and fetch again"
        )
    _unpack(target, out)
    inner = [
        path.parent.parent
        for path in sorted(out.rglob("stereo"))
        if path.parent.name == "opus"
    ]
    return FetchedSet(inner[0] if inner else out, found)


def _download(address: str, target: Path) -> None:
    done = target.stat().st_size if target.exists() else 0
    request = urllib.request.Request(
        address, headers={"Range": f"bytes={done}-"} if done else {}
    )
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            resumed = answer.status == 206
            done = done if resumed else 0
            total = done + int(answer.headers.get("Content-Length", 0))
            with target.open("ab" if resumed else "wb") as file:
                while chunk := answer.read(CHUNK):
                    file.write(chunk)
                    done += len(chunk)
    except (OSError, ValueError, urllib.error.URLError) as error:
        raise DatasetError(
            f"{address}: cannot be downloaded ({error}); try again: it goes on where "
            "it ended"
        ) from None
    if total and done < total:
        raise DatasetError(
            f"{address}: ended after {done} of {total} bytes; try again: it goes on "
            "there"
        )


def _unpack(archive: Path, out: Path) -> None:
    try:
        with zipfile.ZipFile(archive) as files:
            for entry in files.infolist():
                path = PurePosixPath(entry.filename)
                if path.is_absolute() or ".." in path.parts or "\\" in entry.filename:
                    raise DatasetError(
                        f"{archive}: holds {entry.filename!r}, outside its folder; do "
                        "not use it"
                    )
            files.extractall(out)
    except zipfile.BadZipFile as error:
        raise DatasetError(
            f"{archive}: is no zip archive ({error}); delete it and fetch again"
        ) from None
