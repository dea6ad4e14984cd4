"""Real-time priority and other measures against late sound; where the system refuses one, a warning says so once.

Measured (docs/guide/latency.md): under load an unprioritised network thread waits up to 93 ms, one with SCHED_FIFO
0.15 ms. A full garbage collection takes 42 ms after the imports and 2 us once they are frozen. Locking memory made no
difference, and is off by default.
"""

import ctypes
import gc
import os

_MCL_CURRENT_AND_FUTURE = 3
"""``MCL_CURRENT | MCL_FUTURE`` of Linux's ``sys/mman.h``."""


def freeze_garbage_collector() -> None:
    """Exclude everything imported and built so far from garbage collection; call it after all is set up."""
    gc.collect()
    gc.freeze()


def prioritize_thread(priority: int) -> str:
    """Give the calling thread SCHED_FIFO; returns a warning, or an empty text."""
    if priority == 0:
        return ""
    if not hasattr(os, "sched_setscheduler"):
        return "this system has no SCHED_FIFO: expect late sound when it is busy"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return (
            f"no right to real-time priority {priority}: expect late sound when the machine is busy "
            "(put this user into the group audio with rtprio 95 in /etc/security/limits.d, or set process.priority=0)"
        )
    return ""


def lock_memory() -> str:
    """Lock this process in memory; returns a warning, or an empty text."""
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, "mlockall") or libc.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
        return "memory could not be locked: raise the limit memlock, or set process.lock_memory=false"
    return ""
