"""``tactophone fetch authors``: the recordings of the paper's authors, downloaded and
unpacked; an interrupted download goes on."""

import hashlib
import lzma
import shutil
import urllib.error
import urllib.request
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from tactophone.core.errors import DatasetError
from tactophone.core.processes import make_room

ARCHIVE = "https://cloud.vi.cs.uni-bonn.de/index.php/s/KmKSncpDzQ7i3je/download"
"""The authors' recordings, by the README of
https://github.com/AIS-Bonn/Roughness_Sensing."""

LICENCE = (
    "BSD 3-Clause, as the authors' repository states; read what the share itself says"
)
"""What is known of the licence, printed before the download."""

CHUNK = 1 << 20
"""Bytes that are read at once: 1 MiB."""

MOST_UNPACKED = 16 << 30
"""Bytes that the files of the archive may have: 16 GiB, and as much as is free."""

DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    NotImplementedError,  # a compression that is not known
    RuntimeError,  # encrypted
    IndexError,  # an entry without a name
    ValueError,
    OSError,
)
"""What `zipfile` raises for an archive that cannot be unpacked."""


@dataclass(frozen=True, slots=True)
class FetchedSet:
    """A data set that was downloaded and unpacked."""

    folder: Path
    """The folder that holds the sound."""
    sha256: str
    """Checksum of the archive."""


def fetch_authors(out: Path, *, archive: str = ARCHIVE, sha256: str = "") -> FetchedSet:
    """Download the authors' recordings to ``out``, and unpack them to a folder
    ``authors`` in it; nothing else is written.

    Raises `DatasetError` if the network fails, the checksum differs, or the archive
    cannot be unpacked or reaches outside its folder.
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
    folder = out / "authors"
    if not folder.exists():
        unfinished = out / "authors.unfinished"
        shutil.rmtree(unfinished, ignore_errors=True)
        _unpack(target, unfinished)
        unfinished.rename(folder)
    inner = [
        path.parent.parent
        for path in sorted(folder.rglob("stereo"))
        if path.parent.name == "opus"
    ]
    return FetchedSet(inner[0] if inner else folder, found)


def _download(address: str, target: Path) -> None:
    if target.is_symlink() or not target.is_file():
        make_room(target)  # what is resumed is a file that lies here
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


def _unpack(archive: Path, folder: Path) -> None:
    """Unpack to a new folder, of which nothing is left if that fails."""
    folder.mkdir()
    try:
        with zipfile.ZipFile(archive) as files:
            _check(archive, files.infolist(), room=shutil.disk_usage(folder).free)
            files.extractall(folder)
    except DAMAGED as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise DatasetError(
            f"{archive}: cannot be unpacked ({error}); delete it and fetch again"
        ) from None
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise


def _check(archive: Path, entries: list[zipfile.ZipInfo], *, room: int) -> None:
    """Raise `DatasetError` if an archive reaches outside its folder, or unpacks to more
    than is free or plausible."""
    for entry in entries:
        path = PurePosixPath(entry.filename)
        if path.is_absolute() or ".." in path.parts or "\\" in entry.filename:
            raise DatasetError(
                f"{archive}: holds {entry.filename[:200]!r}, outside its folder; do "
                "not use it"
            )
    # An entry that unpacks to more than its table says is refused by `zipfile`.
    size = sum(entry.file_size for entry in entries)
    most = min(MOST_UNPACKED, room)
    if size > most:
        raise DatasetError(
            f"{archive}: unpacks to {size / 1e9:.1f} GB, but {most / 1e9:.1f} GB are "
            "allowed or free; make room, or delete it and fetch again"
        )
