"""The shared memory of a run: a mapped file in the memory file system, laid out as
`live.telemetry.layout` says.

`multiprocessing.shared_memory` is not used because its resource tracker (before Python
3.13) unlinks the memory of a running process when a process that only read it exits.
"""

import contextlib
import os
import re
import stat
import struct
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import TactophoneError
from tactophone.core.processes import hold
from tactophone.core.types import MOST_FINGERS
from tactophone.live.telemetry.layout import HEAD_SIZE, fingerprint_of, layout_of

PREFIX = "tactophone-"
"""Prefix of the file names."""

LONGEST_NAME = 150
"""Bytes of a run's name. With `PREFIX`, and the process number of an unfinished file,
they fit a file name of 255."""

LEFT_AFTER = 60.0
"""Seconds after the last heartbeat of a killed process from which its memory is a
leftover: time to look at it."""


_OPENED = re.compile(
    rf"(\.{PREFIX}(?P<draft>.+)-\d+-[0-9a-f]+|{PREFIX}(?P<name>.+?))( \(deleted\))?",
    re.DOTALL,
)
"""What the system calls an open memory file: its writer by the name that it had before
it was complete."""


class Memory:
    """One run's shared memory as NumPy arrays, by field name: ``memory["steps"]``.

    ``fingers``: as many as the run was created with; a reader finds the number in the
    memory. ``lost`` leads a reader to memory that may have lost its name
    (`open_memories`).
    """

    def __init__(
        self, name: str, *, create: bool, fingers: int = 1, lost: Path | None = None
    ) -> None:
        fits = 0 < len(name.encode(errors="replace")) <= LONGEST_NAME
        if not fits or re.search(r"[/\x00-\x1f\x7f\ud800-\udfff]", name):
            raise TactophoneError(
                f"the name of a run has up to {LONGEST_NAME} bytes of UTF-8, no slash "
                f"and no control character, unlike {name[:80]!r}: choose another --name"
            )
        self._path = folder() / f"{PREFIX}{name}"
        self._created = create
        draft = self._path.with_name(f".{self._path.name}-{os.getpid()}-{id(self):x}")
        opened = (
            _created(draft, self._path, fingers)
            if create
            else _opened(lost or self._path, lost=lost is not None)
        )
        with opened as file:
            self._inode = os.fstat(file.fileno()).st_ino
            self.fingers = fingers if create else _fingers_of(file)
            layout = layout_of(self.fingers)
            whole: NDArray[np.void] = np.memmap(file, layout, mode="r+", shape=(1,))
        # The views are made once: making one costs as much as a write through it.
        self._views = {
            name: np.asarray(whole[name]).reshape(layout[name].shape)
            for name in layout.names or ()
        }
        if create:
            self["gauges"][:] = np.nan
            self.sign()
            # The complete file gets its name now, if nobody else has taken that
            # meanwhile.
            try:
                os.link(draft, self._path)
            except OSError as error:
                raise TactophoneError(
                    f"{self._path} cannot be made ({error.strerror}): "
                    "stop what uses it, or choose another --name"
                ) from None
            finally:
                draft.unlink(missing_ok=True)

    def __getitem__(self, field: str) -> NDArray[Any]:
        return self._views[field]

    def sign(self) -> None:
        """Write what readers recognise the memory by. The writer does so again and
        again, as somebody may have overwritten it."""
        self["pid"][...] = os.getpid()
        self["fingers"][...] = self.fingers
        self["fingerprint"][...] = fingerprint_of(self.fingers)

    @property
    def inode(self) -> int:
        """Number of the mapped file, under whatever name it was found."""
        return self._inode

    @property
    def written(self) -> bool:
        """Whether the process that writes it lives."""
        return _writes(int(self["pid"]), self._inode)

    @property
    def replaced(self) -> bool:
        """Whether another memory has this name now."""
        with contextlib.suppress(OSError):
            return self._path.lstat().st_ino != self._inode
        return False

    def unlink(self) -> None:
        """Remove the file, if this process created it; readers that have it open see
        the last state, and that nobody writes it any more."""
        if not self._created:
            return
        self["pid"][...] = 0
        with contextlib.suppress(OSError):
            # The name may lead to the file of a successor by now.
            if self._path.lstat().st_ino == self._inode:
                self._path.unlink()


def folder() -> Path:
    """Return the folder of the mapped files: the memory file system on Linux, the one
    for temporary files elsewhere."""
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else Path(tempfile.gettempdir())


def open_memories() -> Iterator[tuple[str, Path]]:
    """Yield the name of the run, and what leads to its memory, for every memory that a
    process of this user has open (Linux).

    It may have lost its name: at a logout, a system may remove all files that a user
    has in the memory file system; those of a service of that user too. The processes
    that have it open keep it.
    """
    processes = os.listdir("/proc") if os.path.isdir("/proc") else []
    for process in filter(str.isdecimal, processes):
        # Another user's, or ended by now.
        with contextlib.suppress(OSError):
            for opened in Path(f"/proc/{process}/fd").iterdir():
                with contextlib.suppress(OSError):  # closed by now
                    match = _OPENED.fullmatch(os.readlink(opened).rpartition("/")[2])
                    if match:
                        yield match["draft"] or match["name"], opened


def own_files() -> Iterator[Path]:
    """Yield this user's files of runs, unfinished ones too.

    Other users may have made any number of files of such names, and may remove them at
    any moment: these are not even opened.
    """
    with os.scandir(folder()) as entries:
        for entry in entries:
            if entry.name.removeprefix(".").startswith(PREFIX):
                with contextlib.suppress(OSError):  # removed by now
                    if entry.stat(follow_symlinks=False).st_uid == os.getuid():
                        yield Path(entry.path)


def unreadable_runs() -> Iterator[tuple[str, int]]:
    """Yield name and process id of this user's runs that another version of Tactophone
    has started, whose memory this one cannot read."""
    for path in own_files():
        if path.name.startswith("."):
            continue
        with contextlib.suppress(OSError, TactophoneError):
            pid = _left_by(path)
            if _writes(pid, path.lstat().st_ino) and not _is_readable(path):
                yield _run(path), pid


def _is_readable(path: Path) -> bool:
    try:
        _opened(path).close()
    except TactophoneError:
        return False
    return True


def remove_memory(name: str) -> None:
    """Remove what a run of this name left, if its process is gone."""
    path = folder() / f"{PREFIX}{name}"
    with contextlib.suppress(OSError, TactophoneError):
        if not _in_use(path, _left_by(path)):
            path.unlink()


def remove_leftovers() -> None:
    """Remove the memory of this user's runs that were killed.

    A run counts as killed when its process is gone and its last heartbeat is older than
    `LEFT_AFTER`: in a container that shares the folder, processes may exist that cannot
    be seen from here.
    """
    for path in own_files():
        with contextlib.suppress(OSError, TactophoneError):
            if not path.is_symlink() and _is_leftover(path):
                path.unlink()


def _is_leftover(path: Path) -> bool:
    if path.name.startswith("."):
        # It is unfinished: only its age is known.
        return time.time() - path.lstat().st_ctime > LEFT_AFTER
    with _own_file(path, os.O_RDONLY) as file:
        head = file.read(24)
    pid = int.from_bytes(head[8:16], sys.byteorder)
    if len(head) < 24 or _in_use(path, pid):
        return False
    beat = struct.unpack("=d", head[16:24])[0]
    return not abs(time.monotonic() - beat) < LEFT_AFTER


def _created(draft: Path, path: Path, fingers: int) -> BinaryIO:
    """Make the file under a name that no reader looks for, until it is complete."""
    if os.path.lexists(path):
        pid = _left_by(path)
        if _in_use(path, pid):
            raise TactophoneError(
                f"{_run(path)} runs already (process {pid}): "
                "stop it, or choose another --name"
            )
        path.unlink()
    size = layout_of(fingers).itemsize
    # Exclusive and for this user only: other users can neither place a link here nor
    # read the sound.
    file = os.fdopen(os.open(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600), "r+b")
    try:
        hold(file.fileno())
        # The system must give all pages now: one that it could not give later would end
        # the process by a signal.
        file.truncate(size)
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, size)
    except OSError as error:
        file.close()
        draft.unlink()
        raise TactophoneError(
            f"no room for {size / 1e6:.1f} MB of telemetry in {path.parent} "
            f"({error.strerror}): remove files there"
        ) from None
    return file


def _in_use(path: Path, pid: int) -> bool:
    with _own_file(path, os.O_RDONLY) as file:
        return _writes(pid, path.lstat().st_ino) or not hold(file.fileno())


def _left_by(path: Path) -> int:
    """Return the process id of the writer, which lies at the same offset in every
    version."""
    with _own_file(path, os.O_RDONLY) as file:
        return int.from_bytes(file.read(16)[8:], sys.byteorder)


def _own_file(path: Path, mode: int, *, follow: bool = False) -> BinaryIO:
    """Open what has the name of a run; raises `TactophoneError` unless it is this
    user's regular file.

    In the memory file system every user may make a file, pipe, folder or link of any
    name.
    """
    foreign = TactophoneError(
        f"cannot reach {_run(path)}: {path} belongs to another user or program: "
        "remove it, or name another run"
    )
    try:
        # This neither waits for the other end of a pipe nor follows a link.
        stay = 0 if follow else os.O_NOFOLLOW
        descriptor = os.open(path, mode | os.O_NONBLOCK | stay)
        file = os.fdopen(descriptor, "rb" if mode == os.O_RDONLY else "r+b")
    except FileNotFoundError:
        raise TactophoneError(
            f"cannot reach {_run(path)} (there is no such run): "
            "start `tactophone receive` (or send, loopback), "
            "or name another with --name"
        ) from None
    except OSError:
        raise foreign from None
    status = os.fstat(file.fileno())
    if not stat.S_ISREG(status.st_mode) or status.st_uid != os.getuid():
        file.close()
        raise foreign
    return file


def _opened(path: Path, *, lost: bool = False) -> BinaryIO:
    file = _own_file(path, os.O_RDWR, follow=lost)
    whole = os.fstat(file.fileno())
    fingers = _fingers_of(file)
    # What another version wrote may state any number of fingers, for which no layout
    # must be made.
    fits = 1 <= fingers <= MOST_FINGERS and whole.st_size == layout_of(fingers).itemsize
    fingerprint = int.from_bytes(file.read(8), sys.byteorder)
    if not fits or fingerprint != fingerprint_of(fingers):
        file.close()
        raise TactophoneError(
            f"{_run(path)} was started by another version of Tactophone; "
            "install the same version on both sides"
        )
    return file


def _fingers_of(file: BinaryIO) -> int:
    """Return the number of fingers that a file states, without moving its position."""
    return int.from_bytes(os.pread(file.fileno(), HEAD_SIZE, 0)[24:], sys.byteorder)


def _run(path: Path) -> str:
    return path.name.removeprefix(PREFIX)


def _writes(pid: int, inode: int) -> bool:
    """Return whether a process lives and has the memory file mapped.

    The number of a killed process may belong to another program by now. Where the
    system does not tell what a process has mapped, any process of the number counts.
    """
    if not is_alive(pid):
        return False
    try:
        lines = Path(f"/proc/{pid}/maps").read_text(errors="replace").splitlines()
    except OSError:
        return True
    # Address, rights, offset, device, inode, path (proc_pid_maps(5)).
    mapped = [line.split(maxsplit=5) for line in lines if PREFIX in line]
    return any(int(fields[4]) == inode for fields in mapped)


def is_alive(pid: int) -> bool:
    """Return whether a process of this user has this number.

    Overwritten memory states numbers that no process can have; none of these is alive.
    The number of a killed run may belong to another user's process by now, which this
    user may not signal.
    """
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, PermissionError, OverflowError):
        return False
    return pid > 0
