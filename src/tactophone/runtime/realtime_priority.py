"""Ask the system for punctuality; where it refuses, say so once and go on.

Measured (docs/latency.md): under load an unprioritised network thread waits up to 93 ms, one with SCHED_FIFO 0.15 ms. A
full garbage collection takes 42 ms after the imports and 2 us once they are frozen. Locking memory made no
difference, and is off unless asked for.
"""

import ctypes
import gc
import os

_MCL_CURRENT_AND_FUTURE = 3
"""``MCL_CURRENT | MCL_FUTURE`` of Linux's ``sys/mman.h``."""


def settle() -> None:
    """Take what was imported and built so far out of the garbage collector's sight; call when all is set up."""
    gc.collect()
    gc.freeze()


def prioritize_thread(priority: int) -> str:
    """Give the calling thread SCHED_FIFO; return a warning in words, or nothing."""
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
    """Keep this process in memory; return a warning in words, or nothing."""
    libc = ctypes.CDLL(None, use_errno=True)
    if not hasattr(libc, "mlockall") or libc.mlockall(_MCL_CURRENT_AND_FUTURE) != 0:
        return "memory could not be locked: raise the limit memlock, or set process.lock_memory=false"
    return ""
