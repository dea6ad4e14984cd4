"""What the main thread of either side does while its other threads work."""

import threading
import time
from typing import Protocol

from tactophone.runtime.realtime_priority import MAIN_PRIORITY, GarbageCollection, prioritize_thread, share_interpreter
from tactophone.runtime.supervisor import ProcessInfo


class Side(Protocol):
    """The operator's or the robot's side, set up."""

    ended: threading.Event
    failure: BaseException | None

    def housekeep(self, now: float) -> None:
        """Apply requests and update telemetry; ``now`` is in s of the monotonic clock."""


def run_housekeeping(
    side: Side, info: ProcessInfo, *, terminated: threading.Event, interval: float, priority: int
) -> None:
    """Do a side's housekeeping every ``interval`` seconds, until it or its parent process ends or it is ``terminated``.

    ``priority`` is that of the whole process, which the main thread does not exceed.
    """
    garbage = GarbageCollection(time.monotonic())
    share_interpreter()
    prioritize_thread(min(MAIN_PRIORITY, priority))
    while not (terminated.is_set() or side.ended.is_set() or info.orphaned):
        now = time.monotonic()
        side.housekeep(now)
        garbage.collect(now)
        side.ended.wait(interval)
