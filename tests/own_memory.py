"""A ``/dev/shm`` for each process of tests alone, where the system allows that (Linux,
root).

JACK keeps one database there for all servers and clients of a user. One that ends while
another begins may damage it, and from then on every JACK program of that user crashes.
Users run one server; the tests start hundreds, several at once.
"""

import ctypes
import sys

_NEW_MOUNTS = 0x0002_0000
"""CLONE_NEWNS."""

_PRIVATE = 1 << 18 | 1 << 14
"""MS_PRIVATE, MS_REC: what is mounted here is mounted nowhere else."""


def separate() -> bool:
    """Give this process, and those it starts, an empty ``/dev/shm``; returns whether
    that could be done."""
    if sys.platform != "linux":
        return False
    library = ctypes.CDLL(None)
    return (
        library.unshare(_NEW_MOUNTS) == 0
        and library.mount(b"none", b"/", None, _PRIVATE, None) == 0
        and library.mount(b"tmpfs", b"/dev/shm", b"tmpfs", 0, b"mode=1777") == 0
    )
