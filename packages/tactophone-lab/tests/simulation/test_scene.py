from itertools import pairwise

import pytest

from tactophone.core.types import Touch
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.modes import Mounting
from tactophone_lab.simulation.motion import five_stones, row, single
from tactophone_lab.simulation.takes import shuffled


def test_an_object_lies_at_the_origin_as_it_is_mounted() -> None:
    scene = single(find("lava stone"), Mounting.BOX)
    assert scene.placed[0].object.mounting is Mounting.BOX
    assert scene.placed[0].centre == pytest.approx((0.04, 0.035))


def test_footprints_in_a_row_do_not_overlap() -> None:
    prints = row([find("lava stone")] * 4).field.footprints
    assert all(
        left + width < after for (left, _, width, _), (after, *_) in pairwise(prints)
    )


def test_alike_stones_are_not_the_same() -> None:
    scene = five_stones(shuffled(0))
    assert len({placed.object.surface for placed in scene.placed}) == 5


def test_orders_repeat_and_vary_by_seed() -> None:
    assert shuffled(7) == shuffled(7)
    assert len({shuffled(seed) for seed in range(40)}) > 5
    assert shuffled(1).count(Touch.ROUGH) == 2
