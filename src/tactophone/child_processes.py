"""Child processes that end with their parent on Ctrl-C, and not by themselves."""

import signal
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess


class ChildProcess(SpawnProcess):
    """A process that never sees Ctrl-C, not even while it imports its modules; its parent ends it.

    A terminal sends Ctrl-C to every process in it. Here the new process inherits that it is blocked, so that it shows
    no traceback; one that comes at this moment reaches the parent afterwards.
    """

    def start(self) -> None:
        """Start the process."""
        resource_tracker.ensure_running()  # which unblocks SIGINT when it begins
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class ChildContext(SpawnContext):
    """Spawns processes rather than forking: a fork would carry audio threads' locks and files along."""

    Process = ChildProcess
