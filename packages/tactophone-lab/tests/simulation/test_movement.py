import numpy as np
import pytest

from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import (
    STROKE_PRESSURES,
    Script,
    Visit,
    explore,
    log_uniform,
    take_moves,
)
from tactophone_lab.simulation.takes import TAKES, Take

STONE = find("lava stone")


def test_the_seven_takes_have_the_authors_names() -> None:
    assert {take.name for take in TAKES} == {
        "long_light",
        "long_medium",
        "long_loud",
        "short_light",
        "short_medium",
        "short_loud",
        "wiggle",
    }


@pytest.mark.parametrize("take", TAKES, ids=lambda take: take.name)
def test_a_take_fills_its_time_in_order(take: Take) -> None:
    moves = take_moves(
        take, single(STONE).placed[0], duration=5.0, rng=np.random.default_rng(0)
    )
    times = [move.time for move in moves]
    assert times == sorted(times)
    assert times[-1] >= 4.9
    assert min(move.force for move in moves) < 0 < max(move.force for move in moves)


@pytest.mark.slow
@pytest.mark.parametrize("pressure", STROKE_PRESSURES)
def test_pressure_is_the_contact_force(pressure: str) -> None:
    scene = single(STONE)
    moves = take_moves(
        Take("short", pressure),
        scene.placed[0],
        duration=6.0,
        rng=np.random.default_rng(2),
    )
    finger = SimulatedFinger(scene, moves, place=scene.placed[0].centre)
    finger.render(6 * 48_000)
    low, high = STROKE_PRESSURES[pressure]
    assert (
        0.6 * low
        < np.median(finger.truth.force[finger.truth.object_index == 0])
        < 1.4 * high
    )


def test_a_tap_touches_and_leaves() -> None:
    scene = single(STONE)
    script = Script(np.random.default_rng(0), x=0.04, y=0.035)
    script.hover(0.2)
    script.tap(2.0)
    finger = SimulatedFinger(scene, script.moves, place=(0.04, 0.035))
    finger.render(round((script.time + 0.3) * 48_000))
    assert finger.truth.force.max() > 0.5
    assert finger.truth.object_index[-1] == -1


def test_a_visit_may_end_over_the_edge() -> None:
    scene = single(STONE)
    script = Script(np.random.default_rng(0), x=0.04, y=0.035)
    explore(script, scene.placed[0], Visit(1.0, 1.0, 0.1, slips=True))
    finger = SimulatedFinger(scene, script.moves, place=(0.04, 0.035))
    finger.render(round(script.time * 48_000))
    assert 1 in finger.truth.object_index


def test_draws_stay_within_bounds() -> None:
    rng = np.random.default_rng(0)
    drawn = [log_uniform(rng, (0.5, 2.0)) for _ in range(200)]
    assert 0.5 <= min(drawn) < 0.7
    assert 1.5 < max(drawn) <= 2.0
