"""The time of recorded or simulated sound: each block is delivered when a microphone
would deliver it."""

import time
from collections.abc import Callable, Iterator

from msgspec.structs import replace

from tactophone.core.types import AudioBlock, Source

LONGEST_DELAY = 0.06
"""Seconds behind the clock up to which missed sound is hurried through; older sound
would be stale on arrival (`link.stream.SOUND_STALE_AFTER`)."""

LONGEST_SKIP = 2.0
"""Seconds spent on reading past missed sound, after which its times are moved
instead."""

MAX_SLOW_READS = 8
"""Blocks in a row that took longer to read than to play, after which their times are
moved instead. A busy machine may interrupt a fast source at any block, but not at each:
0.1 s of reading, the limit before, could pass in one interruption, and everything after
it lay beside its labels."""


def paced(
    source: Source,
    *,
    skip: bool = False,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Iterator[AudioBlock]:
    """Yield each block at the time of its last sample.

    After a stall of more than `LONGEST_DELAY` the times of the blocks (``start``) jump,
    as a microphone's do: time passes for them while nobody reads. A source that only
    *resumed* would lie behind its own times for ever, and the operator would take all
    of its sound for delayed by the network.

    ``skip``: whether sound that was missed is left out: right for a recording, whose
    times belong to its labels. Otherwise the source goes on where it stopped, at later
    times: right for a simulation, which is slow to compute.
    """
    # ``due`` is when the newest block should be delivered, ``asked`` when it was asked
    # for, ``moved`` by how many samples the times of the blocks have jumped, and
    # ``slow`` how many reads in a row took longer than their sound.
    due = clock()
    asked = due
    moved = 0
    slow = 0
    skipping_until: float | None = None
    for block in source:
        now = clock()
        due += block.duration
        late = now - due
        slow = slow + 1 if now - asked > block.duration else 0
        if late > LONGEST_DELAY:
            skipping_until = skipping_until or now + LONGEST_SKIP
            if skip and slow < MAX_SLOW_READS and now < skipping_until:
                asked = now
                continue
            moved += round(late * block.sample_rate)
            due += late
        elif late < 0:
            sleep(-late)
        yield replace(block, start=block.start + moved) if moved else block
        # The time that the caller took is no part of a read.
        asked = clock()
        skipping_until = None
