"""The finger that strokes without end."""

import itertools

import pytest

from tactophone_lab.simulation.demonstration import StrokingFinger


@pytest.mark.slow
def test_moves_do_not_pile_up() -> None:
    """The script kept every move: a robot with this source grew by 100 MB an hour."""
    finger, kept = StrokingFinger(4_800), []
    for block in itertools.islice(finger, 300):
        kept.append(len(finger._scripts[0].moves))
        assert block.size == 4_800
    assert max(kept) == 0
    assert len(finger._hand.fingers[0]._hand._moves) < 3_000
