"""The contract of every source; ``make`` returns a source of at least 50 ms."""

import itertools
from collections.abc import Callable

import numpy as np

from tactophone.core.types import Source

DURATION = 0.05
"""Seconds of sound that each test reads."""


def blocks_are_as_announced(make: Callable[[], Source]) -> None:
    source = make()
    with source:
        block = next(iter(source))
    assert block.samples.dtype == np.float32
    assert (block.channels, block.sample_rate) == (source.channels, source.sample_rate)
    assert block.size > 0


def blocks_follow_one_another(make: Callable[[], Source]) -> None:
    source = make()
    with source:
        blocks, size = [], 0
        for block in source:
            blocks.append(block)
            size += block.size
            if size >= DURATION * source.sample_rate:
                break
    assert all(
        after.start == before.end for before, after in itertools.pairwise(blocks)
    )


def yielded_blocks_do_not_change(make: Callable[[], Source]) -> None:
    with make() as source:
        blocks = iter(source)
        first = next(blocks)
        kept = first.samples.copy()
        next(blocks)
        np.testing.assert_array_equal(first.samples, kept)


def it_can_be_exited_in_the_middle(make: Callable[[], Source]) -> None:
    for _ in range(2):
        with make() as source:
            next(iter(source))


ALL = (
    blocks_are_as_announced,
    blocks_follow_one_another,
    yielded_blocks_do_not_change,
    it_can_be_exited_in_the_middle,
)

__all__ = ["ALL", "DURATION"]
