"""The stone box's finger, moved by messages."""

import itertools
import time
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import numpy as np
import pytest

from tactophone.core.types import Touch
from tactophone_lab.game.player_finger import StoneBoxSource

BLOCK = 128
FIRST = (0.0425, 0.035)
"""The middle of the leftmost stone, in m."""


@pytest.fixture
def moved() -> tuple[StoneBoxSource, Connection]:
    inbox, outbox = Pipe(duplex=False)
    return StoneBoxSource(inbox, block_size=BLOCK), outbox


@pytest.mark.slow
def test_it_is_a_source_whose_blocks_follow_one_another(
    moved: tuple[StoneBoxSource, Connection],
) -> None:
    with moved[0] as box:
        blocks = list(itertools.islice(box, 5))
    assert (box.sample_rate, box.channels) == (48_000, 2)
    assert [block.start for block in blocks] == [BLOCK * k for k in range(5)]


@pytest.mark.slow
@pytest.mark.parametrize("tip", ["pad", "stylus"])
def test_a_press_becomes_a_touch_while_the_finger_comes_down(tip: str) -> None:
    inbox, outbox = Pipe(duplex=False)
    box = StoneBoxSource(inbox, block_size=BLOCK, tip=tip)
    blocks = iter(box)
    outbox.send(("move", *FIRST, 1.5))
    touched = next(k for k, _ in enumerate(blocks) if box.truth_of() != Touch.NONE)
    assert 0.03 < touched * BLOCK / box.sample_rate < 0.15


def test_a_lift_ends_the_touch_and_the_noise(
    moved: tuple[StoneBoxSource, Connection],
) -> None:
    box, outbox = moved
    blocks = iter(box)
    for force, truth in ((1.5, Touch.SMOOTH), (-1.0, Touch.NONE)):
        outbox.send(("move", *FIRST, force))
        list(itertools.islice(blocks, 200))
        assert box.truth_of() == truth


@pytest.mark.slow
def test_replaced_stones_are_touched_and_the_sound_goes_on(
    moved: tuple[StoneBoxSource, Connection],
) -> None:
    box, outbox = moved
    blocks = iter(box)
    outbox.send(("lay", (2, 1, 1, 2, 1), 5))
    first, until = next(blocks), time.monotonic() + 20
    before = box._finger
    while box._finger is before and time.monotonic() < until:
        last = next(blocks)
    outbox.send(("move", *FIRST, 1.5))
    touched = list(itertools.islice(blocks, 200))
    assert box.truth_of() == Touch.ROUGH
    assert touched[0].start == last.start + BLOCK
    assert first.start == 0
    assert np.isfinite(touched[-1].samples).all()
