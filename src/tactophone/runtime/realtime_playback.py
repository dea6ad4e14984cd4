"""Plays a source that is available at once (a file, the simulated finger) at the pace of a microphone."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from tactophone.types import AudioBlock, Source

LONGEST_DELAY = 0.06
"""Seconds behind the clock up to which missed sound is hurried through; older sound would be stale on arrival
(`link.depacketizer.STALENESS`)."""

LONGEST_SKIP = 0.1
"""Seconds spent on reading past missed sound, after which its times are moved instead."""


def paced(
    source: Source,
    *,
    skip: bool = False,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[AudioBlock]:
    """Yield each block at the time of its last sample.

    After a stall of more than `LONGEST_DELAY` the times of the blocks (``start``) jump, as a microphone's do: time
    passes for them while nobody reads. A source that only *resumed* would lie behind its own times for ever, and the
    operator would take all of its sound for delayed by the network.

    Parameters
    ----------
    skip
        Whether sound that was missed is left out: right for a recording, whose times belong to its labels. Otherwise
        the source goes on where it stopped, at later times: right for a simulation, which is slow to compute.
    """
    due = clock()
    moved, skipping_until = 0, None
    for block in source:
        due += block.duration
        late = clock() - due
        if late > LONGEST_DELAY:
            skipping_until = skipping_until or clock() + LONGEST_SKIP
            if skip and clock() < skipping_until:
                continue
            moved, due = moved + round(late * block.sample_rate), due + late
        elif late < 0:
            sleep(-late)
        skipping_until = None
        yield replace(block, start=block.start + moved) if moved else block
