"""What C libraries print on their own.

libmpg123, with which libsndfile reads MP3, prints what it finds odd in a file, several
lines in its own words, and libsndfile has no switch for that. What concerns a user is
an error of ours, or is in the sound.
"""

import contextlib
import ctypes
import functools
import os
import threading
from collections.abc import Iterator

_lock = threading.Lock()
_silent = 0
"""How many threads are within `without_c_stderr`."""
_printing: int | None = None
"""The stream that C libraries print on outside of it."""


@contextlib.contextmanager
def without_c_stderr() -> Iterator[None]:
    """Discard what C libraries print on ``stderr`` meanwhile, from any thread.

    What Python prints does not pass through that stream, and appears. Only where the C
    library is glibc: others do not let the stream be exchanged.
    """
    global _silent, _printing
    if (exchanged := _streams()) is None:
        yield
        return
    stderr, nowhere = exchanged
    with _lock:
        if not _silent:
            _printing, stderr.value = stderr.value, nowhere
        _silent += 1
    try:
        yield
    finally:
        with _lock:
            _silent -= 1
            if not _silent:
                stderr.value = _printing


@functools.cache
def _streams() -> tuple[ctypes.c_void_p, int] | None:
    """Return C's variable ``stderr``, and a stream that discards all; ``None`` where
    there is no such variable to write to."""
    try:
        libc = ctypes.CDLL(None)
        libc.gnu_get_libc_version  # noqa: B018
        stderr = ctypes.c_void_p.in_dll(libc, "stderr")
    except (AttributeError, OSError, TypeError, ValueError):
        return None
    libc.fopen.restype = ctypes.c_void_p
    nowhere = libc.fopen(os.devnull.encode(), b"we")
    return (stderr, nowhere) if nowhere else None
