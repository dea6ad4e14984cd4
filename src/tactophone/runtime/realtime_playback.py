"""Sound that is there at once (a file, the simulated finger), given out as slowly as a microphone would."""

import time
from collections.abc import Callable, Iterator

from tactophone.types import AudioBlock, Source

LONGEST_DEBT = 0.1
"""Seconds behind the clock after which the rest is forgiven: nobody wants to hear it all at once."""


def paced(
    source: Source, *, clock: Callable[[], float] = time.monotonic, sleep: Callable[[float], None] = time.sleep
) -> Iterator[AudioBlock]:
    """Give each block when its last sample would have been heard."""
    due = clock()
    for block in source:
        due += block.duration
        wait = due - clock()
        if wait > 0:
            sleep(wait)
        elif wait < -LONGEST_DEBT:
            due = clock()
        yield block
