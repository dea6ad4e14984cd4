"""How the callback of a JACK client stops before its client leaves.

libjack 1.9.21 cancels the thread of a client that is closed, and that of a lost one when the next joins
(``CheckContext``), wherever it is. In the middle of Python it would keep the interpreter's lock for ever. So the
callback of a client that leaves does nothing.
"""

import os
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field

from tactophone.types import FloatArray

CALLBACK_LIMIT = 0.1
"""Seconds to wait for the next callback of a client that leaves; none comes where the server has let it go."""

RETURN_TIME = 0.01
"""Seconds in which a callback that has nothing to do returns to libjack."""

THREAD_LIMIT = 2.0
"""Seconds to wait for the end of a lost client's thread."""


@dataclass(slots=True)
class Leaving:
    """Whether a client is about to leave, and whether its callback has seen that."""

    asked: bool = False
    lost: bool = False
    thread: int = 0
    seen: threading.Event = field(default_factory=threading.Event)

    def ask(self, *, lost: bool) -> None:
        """Have the callback do nothing more, and wait until it has returned; the thread of a lost client ends."""
        self.lost, self.asked = lost, True
        if self.seen.wait(CALLBACK_LIMIT) and lost:
            until = time.monotonic() + THREAD_LIMIT
            while os.path.exists(f"/proc/self/task/{self.thread}") and time.monotonic() < until:
                time.sleep(RETURN_TIME)
        time.sleep(RETURN_TIME)

    def answer(self, outputs: Iterable[FloatArray]) -> bool:
        """Silence the outputs, in the callback; returns whether its thread is to end.

        Not that of a client that is closed: a synchronous server would wait 50 ms for it.
        """
        for output in outputs:
            output[:] = 0.0
        self.thread = threading.get_native_id()
        self.seen.set()
        return self.lost
