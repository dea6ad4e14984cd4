"""How a name in a manifest is found, and where a link may lead.

A manifest comes from another machine: written on Windows, unpacked on a Mac, typed by a
person. Its names are found as a person would find them. A data set comes from a
stranger: a link in it must not lead a reader to the reader's own files, nor a writer
through it. One kind of link is ordinary: the client of Hugging Face keeps every file in
``blobs/`` and fills ``snapshots/REVISION/`` with links to them. Any other link that
leaves the folder is foreign. What it leads to is read only by a reader who asked for
it, who may have made the link; it is never copied, and nothing is written through it.
"""

import os
import unicodedata
from pathlib import Path

from tactophone.core.errors import DatasetError

SNAPSHOTS = "snapshots"
BLOBS = "blobs"
"""Names of the two folders side by side in a cache of Hugging Face's client."""


def find_file(folder: Path, name: str) -> Path | None:
    r"""Return the path of a file that a manifest names; ``None`` for a name that leads
    out of the folder.

    Where there is no such file, backslashes part folders, as on Windows, and upper and
    lower case, composed and decomposed letters are the same, as on Windows and a Mac,
    if only one file is then meant. A file that is nowhere keeps its name.
    """
    if not name or "\0" in name:  # Python refuses even to look for a NUL
        return None
    path = folder / name
    if not os.path.exists(path) and "\\" in name:
        path = folder / name.replace("\\", "/")
    if not path.is_relative_to(folder):
        return None  # an absolute name replaces the folder that it is joined to
    below = Path(os.path.normpath(path.relative_to(folder)))
    if not below.parts or below.parts[0] == os.pardir:
        return None
    if not os.path.exists(path):
        path = _alike(folder, below) or path
    return path


def _alike(folder: Path, name: Path) -> Path | None:
    """Return the only file whose name differs by case or by the form of its letters."""
    found = folder
    for part in name.parts:
        if os.path.exists(found / part):
            found = found / part
            continue
        try:
            entries = list(found.iterdir())
        except OSError:
            return None
        wanted = _folded(part)
        same = [entry for entry in entries if _folded(entry.name) == wanted]
        if len(same) != 1:
            return None
        found = same[0]
    return found


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
