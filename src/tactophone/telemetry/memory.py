"""The layout of telemetry in shared memory.

One writer, many readers, no lock. Three kinds of fields make that safe:

- *counters and gauges* are single aligned 8-byte words, which are written and read atomically;
- *ring buffers* (sound, vibration, steps, predictions) are written first and counted after. A reader copies the rows,
  reads the count again and drops the rows that the writer may have overwritten meanwhile;
- *texts* (the state) have two slots: the writer fills the slot that is not current and then increments the count. A
  writer that dies half way leaves the older text intact.

The memory is a mapped file in the memory file system. `multiprocessing.shared_memory` is not used because its resource
tracker (before Python 3.13) unlinks the memory of a running process when a process that only read it exits.

Beware: readers rely on stores becoming visible in program order, which x86 guarantees. On other processors a reader may
rarely see a torn row of a ring buffer; nothing that controls vibration is read from here.
"""

import contextlib
import functools
import os
import struct
import sys
import tempfile
import time
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from tactophone.errors import TactophoneError
from tactophone.telemetry.registry import ACTIONS, COUNTERS, GAUGES, MARKS
from tactophone.types import MOST_FINGERS

PREFIX = "tactophone-"
"""Prefix of the file names."""

SOUND_CAPACITY = 1 << 17
"""Samples of sound and of vibration kept: 2.7 s at 48 kHz."""

STEP_CAPACITY = 1 << 13
"""Steps kept: 20 s at 400 a second, one for each packet of 2.5 ms."""

PREDICTION_CAPACITY = 1 << 13
"""Predictions kept: 80 s at a hundred a second."""

MARK_CAPACITY = 1 << 12
"""Marks kept of each kind: 10 s of packets of 2.5 ms."""

LOG_CAPACITY = 1 << 21
"""Bytes of the session log kept: 10 s of two microphones as PCM with all headers, and over a minute as Opus."""

LARGEST_RECORD = 1 << 16
"""Bytes of the largest record of the session log; longer ones are split."""

LARGEST_WRITE = 1 << 14
"""Samples written to a ring buffer before its count is updated: a reader must drop as many at the old end."""

STATE_SIZE = 1 << 14
"""Bytes for the state as JSON: some forty faults of 300 letters."""

STEP = np.dtype(
    [
        ("time", "f8"),
        ("sound_end", "u8"),
        ("vibration_end", "u8"),
        ("probabilities", "f4", 3),
        ("roughness", "f4"),
        ("level_dbfs", "f4"),
        ("amplitude", "f4"),
        ("frequency", "f4"),
        ("touch", "i1"),
        ("event", "i1"),
        ("truth", "i1"),
        ("concealed", "?"),
    ],
    align=True,
)
"""One pipeline step: stream time (s), the counts of sound and vibration at that time, the newest prediction and
command. ``event`` is this step's newest touch event, counted from 1 in `EVENT_KINDS`, or 0. ``truth`` is the known
`Touch`, or -1; ``probabilities`` are NaN before the first prediction."""

PREDICTION = np.dtype(
    [
        ("time", "f8"),
        ("start", "f8"),
        ("end", "f8"),
        ("probabilities", "f8", 3),
        ("roughness", "f8"),
        ("level_dbfs", "f8"),
        ("amplitude", "f8"),
        ("frequency", "f8"),
        ("event_time", "f8"),
        ("touch", "i1"),
        ("event", "i1"),
    ],
    align=True,
)
"""One prediction and the command computed from it; ``amplitude`` and ``frequency`` are NaN where there was none.
``event`` is its touch event, counted from 1 in `EVENT_KINDS`, or 0."""

MARK = np.dtype([("position", "i8"), ("time", "f8")])
"""The RTP timestamp at which a block of sound ends, and the time on the system-wide monotonic clock, in seconds."""

LEFT_AFTER = 60.0
"""Seconds after the last heartbeat of a killed process from which its memory is a leftover: time to look at it."""

_TEXT = np.dtype([("size", "u8"), ("text", "u1", STATE_SIZE)])
_REQUEST = np.dtype([("count", "u8"), ("time", "f8"), ("value", "f8"), ("size", "u8"), ("text", "u1", 64)])

_HEAD_SIZE = 32
"""Bytes of the first four fields, which lie at the same place in every layout."""


@functools.cache
def _layout(fingers: int) -> np.dtype[np.void]:
    """Return the layout for so many fingers: rings and their counts are for each, requests for all and for each."""
    return np.dtype(
        [
            ("fingerprint", "u8"),
            ("pid", "u8"),
            ("beat", "f8"),
            ("fingers", "u8"),
            ("step_count", "u8", fingers),
            ("prediction_count", "u8", fingers),
            ("sound_count", "u8", fingers),
            ("vibration_count", "u8", fingers),
            ("log_count", "u8"),
            ("state_count", "u8"),
            ("mark_counts", "u8", len(MARKS)),
            ("counters", "u8", len(COUNTERS)),
            ("gauges", "f8", len(GAUGES)),
            ("requests", _REQUEST, (len(ACTIONS), 1 + fingers)),
            ("states", _TEXT, 2),
            ("steps", STEP, (fingers, STEP_CAPACITY)),
            ("predictions", PREDICTION, (fingers, PREDICTION_CAPACITY)),
            ("sound", "f4", (fingers, SOUND_CAPACITY, 2)),
            ("vibration", "f4", (fingers, SOUND_CAPACITY)),
            ("log", "u1", LOG_CAPACITY),
            ("marks", MARK, (len(MARKS), MARK_CAPACITY)),
        ],
        align=True,
    )


@functools.cache
def _fingerprint(fingers: int) -> int:
    names = (tuple(COUNTERS), tuple(GAUGES), MARKS, ACTIONS)
    return zlib.crc32(repr((_layout(fingers), *names)).encode())


class Memory:
    """One run's shared memory as NumPy arrays, by field name: ``memory["steps"]``.

    Attributes
    ----------
    fingers
        As many as the run was created with; a reader finds the number in the memory.
    """

    def __init__(self, name: str, *, create: bool, fingers: int = 1) -> None:
        self._path = folder() / f"{PREFIX}{name}"
        self._created = create
        draft = self._path.with_name(f".{self._path.name}-{os.getpid()}-{id(self):x}")
        with _created(draft, self._path, fingers) if create else _opened(self._path) as file:
            self._inode = os.fstat(file.fileno()).st_ino
            self.fingers = fingers if create else _fingers_of(file)
            layout = _layout(self.fingers)
            whole: NDArray[np.void] = np.memmap(file, layout, mode="r+", shape=(1,))
        # The views are made once: making one costs as much as a write through it.
        self._views = {name: np.asarray(whole[name]).reshape(layout[name].shape) for name in layout.names or ()}
        if create:
            self["gauges"][:] = np.nan
            self.sign()
            _publish(draft, self._path)

    def __getitem__(self, field: str) -> NDArray[Any]:
        return self._views[field]

    def sign(self) -> None:
        """Write by what readers know the memory; also again, as somebody may have overwritten it."""
        self["pid"][...] = os.getpid()
        self["fingers"][...] = self.fingers
        self["fingerprint"][...] = _fingerprint(self.fingers)

    @property
    def writer_alive(self) -> bool:
        """Whether the writing process exists."""
        return is_alive(int(self["pid"]))

    def unlink(self) -> None:
        """Remove the file, if this process created it; readers that have it open see the last state."""
        with contextlib.suppress(OSError):
            if self._created and self._path.lstat().st_ino == self._inode:  # not the file of a successor
                self._path.unlink()


def folder() -> Path:
    """The folder of the mapped files: the memory file system on Linux, temporary files elsewhere."""
    memory = Path("/dev/shm")
    return memory if memory.is_dir() else Path(tempfile.gettempdir())


def remove_memory(name: str) -> None:
    """Remove what a run of this name left, if its process is gone."""
    path = folder() / f"{PREFIX}{name}"
    with contextlib.suppress(OSError, TactophoneError):
        if not is_alive(_left_by(path)):
            path.unlink()


def remove_leftovers() -> list[str]:
    """Remove the memory of this user's runs that were killed; returns their names.

    A run counts as killed when its process is gone and its last heartbeat is older than `LEFT_AFTER`: in a container
    that shares the folder, processes may exist that cannot be seen from here.
    """
    removed = []
    for path in (*folder().glob(f"{PREFIX}*"), *folder().glob(f".{PREFIX}*")):
        with contextlib.suppress(OSError, TactophoneError):
            if path.lstat().st_uid == os.getuid() and not path.is_symlink() and _is_leftover(path):
                path.unlink()
                removed.append(_run(path))
    return removed


def _is_leftover(path: Path) -> bool:
    if path.name.startswith("."):  # unfinished: nothing is known of it but its age
        return time.time() - path.lstat().st_ctime > LEFT_AFTER
    with path.open("rb", buffering=0) as file:
        head = file.read(24)
    if len(head) < 24 or is_alive(int.from_bytes(head[8:16], sys.byteorder)):
        return False
    beat = struct.unpack("=d", head[16:24])[0]
    return not abs(time.monotonic() - beat) < LEFT_AFTER


def _created(draft: Path, path: Path, fingers: int) -> BinaryIO:
    """Make the file under a name that no reader looks for, until it is complete."""
    if path.exists():
        pid = _left_by(path)
        if is_alive(pid):
            raise TactophoneError(f"{_run(path)} runs already (process {pid}): stop it, or choose another --name")
        path.unlink()
    # Exclusive and for this user only: other users can neither place a link here nor read the sound.
    file = os.fdopen(os.open(draft, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600), "r+b")
    try:
        _allocate(file, _layout(fingers).itemsize)
    except OSError as error:
        file.close()
        draft.unlink()
        needed = _layout(fingers).itemsize / 1e6
        raise TactophoneError(
            f"no room for {needed:.1f} MB of telemetry in {path.parent} ({error.strerror}): remove files there"
        ) from None
    return file


def _publish(draft: Path, path: Path) -> None:
    """Give the complete file its name, if nobody else has taken it meanwhile."""
    try:
        os.link(draft, path)
    except OSError as error:
        raise TactophoneError(
            f"{path} cannot be made ({error.strerror}): stop what uses it, or choose another --name"
        ) from None
    finally:
        draft.unlink(missing_ok=True)


def _allocate(file: BinaryIO, size: int) -> None:
    """Give the file its size, and its pages now: a page that is missing later would end the process by a signal."""
    file.truncate(size)
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), 0, size)


def _left_by(path: Path) -> int:
    """Return the pid of the writer; it lies at the same offset in every version."""
    try:
        with path.open("rb", buffering=0) as file:
            return int.from_bytes(file.read(16)[8:], sys.byteorder)
    except PermissionError:
        raise TactophoneError(f"{path} belongs to another user: choose another --name") from None


def _opened(path: Path) -> BinaryIO:
    try:
        file = os.fdopen(os.open(path, os.O_RDWR | getattr(os, "O_NOFOLLOW", 0)), "r+b")
    except OSError as error:
        raise TactophoneError(
            f"cannot watch {_run(path)} ({error.strerror}): start `tactophone receive` (or send, loopback), "
            "or name another with --name"
        ) from None
    whole = os.fstat(file.fileno())
    fingers = _fingers_of(file)
    fits = 1 <= fingers <= MOST_FINGERS and whole.st_size == _layout(fingers).itemsize
    if not fits or int.from_bytes(file.read(8), sys.byteorder) != _fingerprint(fingers):
        file.close()
        raise TactophoneError(f"{_run(path)} is of another version of Tactophone: use one version for both sides")
    if whole.st_uid not in (0, os.getuid()):
        file.close()
        raise TactophoneError(f"{path} belongs to another user: remove it, or choose another --name")
    return file


def _fingers_of(file: BinaryIO) -> int:
    """Return the number of fingers that a file states, without moving its position."""
    return int.from_bytes(os.pread(file.fileno(), _HEAD_SIZE, 0)[24:], sys.byteorder)


def _run(path: Path) -> str:
    return path.name.removeprefix(PREFIX)


def is_alive(pid: int) -> bool:
    """Return whether a process exists."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):  # overwritten memory states numbers that no process has
        return False
    except PermissionError:
        return True
    return pid > 0
