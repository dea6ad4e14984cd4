"""A simulated hand: each finger as alone, plus what reaches it from its neighbours."""

import math

import numpy as np

from tactophone.core.types import FloatArray
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger, SimulatedHand
from tactophone_lab.simulation.strokes import Script

SCENE = single(find("lava stone"))


def finger(number: int, *, strokes: bool) -> SimulatedFinger:
    simulated = SimulatedFinger(SCENE, seed=number, place=(0.02, 0.03))
    script = Script(np.random.default_rng(number), x=0.02, y=0.03)
    if strokes:
        script.land(1.5)
        script.stroke(0.06, 0.4, 1.5)
    for move in script.moves:
        simulated.move(move.x, move.y, move.force, move.time)
    return simulated


def rendered(structure_db: float, size: int) -> FloatArray:
    hand = SimulatedHand(
        [finger(k, strokes=k == 0) for k in range(3)], structure_db=structure_db
    )
    return np.concatenate([hand.render(size).samples for _ in range(14_400 // size)])


def test_without_coupling_each_finger_sounds_as_alone() -> None:
    sound = rendered(-math.inf, 480)
    for number in range(3):
        alone = finger(number, strokes=number == 0)
        expected = np.concatenate([alone.render(480).samples for _ in range(30)])
        assert np.array_equal(sound[:, 2 * number : 2 * number + 2], expected)


def test_a_stroke_is_faint_in_the_next_finger_and_fainter_in_the_one_after() -> None:
    apart, together = rendered(-math.inf, 480), rendered(-26.0, 480)
    assert np.array_equal(rendered(-26.0, 96), together)
    added = (together - apart).astype(np.float64).std(axis=0)
    own = together[:, 0].std()
    assert added[0] < 0.01 * own  # the others are in the air
    assert 0 < added[4] < added[2] < 0.1 * own
    assert 0 < added[5] < added[3]
