"""Real-time priority and other measures against late sound; where the system refuses
one, a warning says so once.

Measured (docs/research/latency.md): under load an unprioritised network thread waits up
to 93 ms, one with SCHED_FIFO 0.15 ms. A full garbage collection takes 42 ms after the
imports and 2 us once they are frozen. Locking memory made no difference.
"""

import contextlib
import gc
import math
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

SWITCH_SHARE = 0.2
"""Of a period of the sound device: for how long a thread keeps the interpreter while
another waits for it. Python's default is 5 ms, seven periods of 32 samples and more. A
callback of ten fingers needs longer than 0.1 ms, and with so short an interval it and
the network thread interrupt each other for nothing: with 0.5 ms the operator takes 2 to
7 % less processor time at 128 samples, with no later vibration."""

LEAST_SWITCH_INTERVAL = 100e-6
"""Seconds that it is at least, and where the period is not known."""

MOST_SWITCH_INTERVAL = 1e-3
"""Seconds that it is at most: a packet of 2.5 ms must not wait for half of its
duration."""

AWAKE_WITHIN = 20
"""Microseconds within which an idle core has to run again: more than the shallow idle
states of processors take, and less than the deep ones, which can take hundreds."""

CORES_FILE = Path("/dev/cpu_dma_latency")
"""While a process holds this file open, no core sleeps more deeply than the number of
microseconds written to it allows (Linux, PM QoS)."""

MAIN_PRIORITY = 1
"""Priority of the main thread, the lowest of SCHED_FIFO. It has little to do, but holds
the interpreter while it works: without a priority it then waits for the machine, and
the threads of the sound wait for it. At a load of 21 on two cores, packets waited up to
280 ms without it, and 54 of 1,600 came too late; with it they waited 11 ms at most, and
none came too late."""

COLLECTION_INTERVAL = 10.0
"""Seconds between two collections of garbage: under 0.1 ms each once the imports are
frozen. They also free the tuples that Python keeps for reuse, up to 2,000 of each size:
a running operator filled these by 4 MB an hour for its first twenty minutes (counted
with `sys._debugmallocstats`)."""


def settle() -> None:
    """Prepare a process that is set up: its garbage collections leave out what exists
    by now, and its threads wait less."""
    gc.collect()
    gc.freeze()
    follow_period(0.0)


def follow_period(period: float) -> None:
    """Let threads take turns as the period of the sound device asks, in s; 0 where it
    is not known."""
    wanted = min(
        max(SWITCH_SHARE * period, LEAST_SWITCH_INTERVAL), MOST_SWITCH_INTERVAL
    )
    if not math.isclose(wanted, sys.getswitchinterval(), rel_tol=0.05):
        sys.setswitchinterval(wanted)


@contextlib.contextmanager
def cores_awake(file: Path = CORES_FILE) -> Iterator[bool]:
    """Let no core sleep deeply meanwhile, where the system permits it, as audio servers
    do; returns whether it did.

    On a quiet machine the cores sleep between two periods, and a deep sleep ends late.
    """
    with contextlib.ExitStack() as stack:
        try:
            held = stack.enter_context(file.open("r+b", buffering=0))
            held.write(AWAKE_WITHIN.to_bytes(4, sys.byteorder))
        except OSError:
            yield False
        else:
            yield True


def collect_garbage(last: float, now: float) -> float:
    """Collect garbage if it is time to, at any interval of calls; returns when it was
    last done, in s."""
    if now - last < COLLECTION_INTERVAL:
        return last
    gc.collect()
    return now


def name_thread(name: str) -> None:
    """Give the calling thread a name of up to 15 letters in the kernel (Linux), which
    `top -H` shows."""
    with contextlib.suppress(OSError):
        Path(f"/proc/self/task/{threading.get_native_id()}/comm").write_text(name)


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
            f"no right to real-time priority {priority}: "
            "expect late sound when the machine is busy "
            "(put this user into the group audio with rtprio 95 "
            "in /etc/security/limits.d, or set process.priority=0)"
        )
    return ""


def prepare_passing(priority: int) -> None:
    """Prepare the process of a call, which stands between the session and the network.

    It waits for no other program, and yet never holds up the sound: strangers can give
    it work, so its priority is the lowest of SCHED_FIFO. Where the system refuses it,
    the live side says so.
    """
    settle()
    prioritize_thread(min(MAIN_PRIORITY, priority))
