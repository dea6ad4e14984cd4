"""Plays a source that is available at once (a file, the simulated finger) at the pace of a microphone."""

import time
from collections.abc import Callable, Iterator

from tactophone.types import AudioBlock, Source

LONGEST_DELAY = 0.1
"""Seconds behind the clock beyond which the pace starts anew, rather than hurry through all that was missed."""


def paced(
    source: Source, *, clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
) -> Iterator[AudioBlock]:
    """Yield each block at the time of its last sample."""
    due = clock()
    for block in source:
        due += block.duration
        wait = due - clock()
        if wait > 0:
            sleep(wait)
        elif wait < -LONGEST_DELAY:
            due = clock()
        yield block
