"""How a name in a manifest is found, and where a link may lead.

A manifest comes from another machine: written on Windows, unpacked on a Mac, typed by a
person. Its names are found as a person would find them. A data set comes from a
stranger: a link in it must not lead a reader to the reader's own files, nor a writer
through it. One kind of link is ordinary: the client of Hugging Face keeps every file in
``blobs/`` and fills ``snapshots/REVISION/`` with links to them. Any other link that
leaves the folder is foreign. What it leads to is read only by a reader who asked for
it, who may have made the link; it is never copied, and nothing is written through it.
"""

import functools
import os
import unicodedata
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.sound_file import SOUND_SUFFIXES

SNAPSHOTS = "snapshots"
BLOBS = "blobs"
"""Names of the two folders side by side in a cache of Hugging Face's client."""


def find_file(folder: Path, name: str) -> Path | None:
    r"""Return the path of a file that a manifest names; ``None`` for a name that leads
    out of the folder.

    Where there is no such file, the name is read as a person would read it. Backslashes
    part folders, as on Windows. Folders of the machine that wrote the manifest, or the
    data set's own folder, may stand before the rest. Letters may be written as a web
    address writes them (``%20``). Upper and lower case, composed and decomposed letters
    are the same, as on Windows and a Mac, and the sound may have been converted, so
    that its name ends differently, if only one file is then meant. A file that is
    nowhere keeps its name.
    """
    if not name or "\0" in name:  # Python refuses even to look for a NUL
        return None
    spellings = list(_spellings(name))
    paths = [path for each in spellings if (path := _path_below(folder, each))]
    for path in paths:
        if os.path.exists(path):
            return path
    for path in paths:
        if found := _alike(folder, path.relative_to(folder)):
            return found
    return _path_below(folder, spellings[min(1, len(spellings) - 1)])


def _spellings(name: str) -> Iterator[str]:
    r"""Yield what a name in a manifest may mean, the likeliest first.

    >>> list(_spellings("D:\\set\\rough\\a.wav"))[1:]
    ['D:/set/rough/a.wav', 'set/rough/a.wav', 'rough/a.wav', 'a.wav']
    >>> list(_spellings("set/rough/a.wav"))
    ['set/rough/a.wav', 'rough/a.wav']
    """
    yield name
    plain = name.replace("\\", "/")
    if plain != name:
        yield plain
    decoded = unquote(plain, errors="surrogateescape")
    if decoded != plain:
        yield decoded
    parts = decoded.removeprefix("file://").split("/")
    if os.pardir in parts:
        return
    # A whole path of another machine may lose all of its folders. A path from some
    # folder keeps one of its own, so that a/1.wav and b/1.wav stay two files.
    whole = decoded.startswith("/") or ":" in parts[0] or decoded.startswith("file:")
    for first in range(1, len(parts) if whole else len(parts) - 1):
        yield "/".join(parts[first:])


def _path_below(folder: Path, name: str) -> Path | None:
    path = folder / name
    if not path.is_relative_to(folder):
        return None  # an absolute name replaces the folder that it is joined to
    below = Path(os.path.normpath(path.relative_to(folder)))
    return path if below.parts and below.parts[0] != os.pardir else None


def _alike(folder: Path, name: Path) -> Path | None:
    """Return the only file whose name differs by case, by the form of its letters, or
    by the ending of another kind of sound."""
    found = folder
    for part in name.parts:
        if os.path.exists(found / part):
            found = found / part
            continue
        try:
            names, stems = _entries(found, found.stat().st_mtime_ns)
        except OSError:
            return None
        wanted = _folded(part)
        same = names.get(wanted, [])
        if not same and part == name.parts[-1]:
            wanted_stems = {wanted, _folded(Path(part).stem)}
            same = [path for stem in wanted_stems for path in stems.get(stem, [])]
        if len(same) != 1:
            return None
        found = same[0]
    return found


@functools.lru_cache(maxsize=64)
def _entries(
    folder: Path, changed: int
) -> tuple[dict[str, list[Path]], dict[str, list[Path]]]:
    """Return what a folder holds by its folded names, and sound by its folded stems.

    A manifest may name thousands of files that are not there, so a folder is read once
    until it has ``changed``, in ns since 1970.
    """
    names: dict[str, list[Path]] = {}
    stems: dict[str, list[Path]] = {}
    for entry in folder.iterdir():
        names.setdefault(_folded(entry.name), []).append(entry)
        if entry.suffix.lower() in SOUND_SUFFIXES:
            stems.setdefault(_folded(entry.stem), []).append(entry)
    return names, stems


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold().strip()


def foreign_target(path: Path, folder: Path) -> Path | None:
    """Return where a path below a folder leads, if that is outside of what belongs to
    the folder; ``None`` for all that may be read.

    To it belong the folder itself and, for a snapshot of Hugging Face's client, the
    regular files in the ``blobs/`` beside it.
    """
    target = path.resolve()
    whole = folder.resolve()
    if target.is_relative_to(whole):
        return None
    blobs = _blobs_of(whole)
    if blobs and target.parent == blobs and target.is_file():
        return None
    return target


def _blobs_of(folder: Path) -> Path | None:
    for revision in (folder, *folder.parents):
        if revision.parent.name == SNAPSHOTS:
            blobs = revision.parent.parent / BLOBS
            # Itself no link: it would make any folder part of the snapshot.
            return blobs if blobs.is_dir() and not blobs.is_symlink() else None
    return None


def link_fault(path: Path, folder: Path, *, follow: bool = False) -> str:
    """Say where a path below a folder leads and what to do, where it may not be read;
    empty where it may.

    ``follow``: the reader asked for what foreign links lead to.
    """
    target = None if follow else foreign_target(path, folder)
    if target is None:
        return ""
    return (
        f"a link to {target}, outside {folder}; put the file itself there, as `cp -rL` "
        "does, or read it where it is with --follow-links"
    )


def refuse_to_read(path: Path, folder: Path, *, follow: bool = False) -> None:
    """Raise `DatasetError` if a table below a folder may not be read, as for
    `link_fault`."""
    if fault := link_fault(path, folder, follow=follow):
        raise DatasetError(f"{path}: {fault}")


def refuse_foreign(path: Path, folder: Path) -> None:
    """Raise `DatasetError` if a path below a folder leads to a file that is not the
    folder's, and would be copied."""
    if target := foreign_target(path, folder):
        raise DatasetError(
            f"{path}: a link to {target}, outside {folder}, which is not copied; put "
            "the file itself there, as `cp -rL` does"
        )


def refuse_link(path: Path, folder: Path) -> None:
    """Raise `DatasetError` if a path below a folder leads out of it over a link, and
    would be written."""
    if not path.resolve().is_relative_to(folder.resolve()):
        raise DatasetError(
            f"{path}: a link that leaves {folder}; put the file itself there, or name "
            "another folder"
        )


def name_below(path: Path, folder: Path) -> Path:
    """Return a path's name from a folder, by the names that lead to it and not by where
    links lead.

    Raises `ValueError` if the path is not below the folder.
    """
    plain = Path(os.path.abspath(path))
    whole = Path(os.path.abspath(folder))
    if plain.is_relative_to(whole):
        return plain.relative_to(whole)
    return path.resolve().relative_to(folder.resolve())
