from collections.abc import Callable

import numpy as np
import pytest

from tactophone.core.microphones import CONTACT
from tactophone.core.types import Touch
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.motion import Scene, five_stones, single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES, shuffled
from tests.live.audio import contract

PLACE = (0.04, 0.035)


def take(name: str, seconds: float = 3.0, seed: int = 1) -> SimulatedFinger:
    scene = single(find(name))
    moves = take_moves(
        TAKES[1], scene.placed[0], duration=seconds, rng=np.random.default_rng(seed)
    )
    return SimulatedFinger(scene, moves, seed=seed, duration=seconds, place=PLACE)


def render(finger: SimulatedFinger, sizes: list[int]) -> np.ndarray:
    return np.concatenate([finger.render(size).samples for size in sizes])


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 17, 480, 509])
def test_blocks_of_any_size_give_the_same_bits(size: int) -> None:
    whole = take("lava stone").render(20_000).samples
    count, rest = divmod(20_000, size)
    np.testing.assert_array_equal(
        render(take("lava stone"), [size] * count + [rest]), whole
    )


@pytest.mark.parametrize("promise", contract.ALL)
def test_the_finger_keeps_the_contract_of_all_sources(promise: Callable) -> None:
    promise(lambda: take("4", seconds=0.1))


def test_another_seed_is_another_noise() -> None:
    assert not np.array_equal(
        take("4", seed=1).render(4800).samples, take("4", seed=2).render(4800).samples
    )


def test_iteration_gives_contiguous_blocks_and_ends() -> None:
    with take("4", seconds=0.1) as finger:
        blocks = list(finger)
    assert [block.start for block in blocks] == [480 * k for k in range(10)]
    assert blocks[-1].end == 4800
    assert {block.channels for block in blocks} == {finger.channels} == {2}


def test_truth_separates_touch_from_hovering() -> None:
    finger = SimulatedFinger(single(find("lava stone")), place=PLACE)
    finger.render(4800)
    assert set(finger.truth.touch) == {Touch.NONE}
    finger.move(*PLACE, 2.0)
    finger.render(24_000)
    assert finger.truth.touch[-1] == Touch.ROUGH
    assert finger.truth.force[-4800:].mean() == pytest.approx(2.0, rel=0.1)
    finger.move(*PLACE, -0.5)
    finger.render(24_000)
    assert finger.truth.touch[-1] == Touch.NONE


def test_the_ground_is_neither_smooth_nor_rough() -> None:
    scene = five_stones(shuffled(3))
    finger = SimulatedFinger(scene, place=(-0.05, 0.035))
    finger.move(-0.05, 0.035, 1.0)
    finger.render(24_000)
    assert finger.truth.object_index[-1] == len(scene.placed)
    assert finger.truth.touch[-1] == Touch.NONE


def test_live_moves_make_sound() -> None:
    finger = SimulatedFinger(single(find("lava stone")), place=PLACE)
    finger.move(*PLACE, 1.5)
    finger.render(24_000)
    still = finger.render(12_000).samples[:, CONTACT].std()
    for k in range(50):
        finger.move(0.04 + 0.02 * np.sin(k / 3), 0.035, 1.5, time=0.75 + k / 100)
    assert finger.render(24_000).samples[:, CONTACT].std() > 3 * still


def test_extreme_forces_do_not_diverge() -> None:
    finger = SimulatedFinger(single(find("lava stone")), place=PLACE)
    finger.move(*PLACE, 1e6)
    finger.move(10.0, 10.0, 50.0, time=0.05)
    assert np.isfinite(finger.render(9600).samples).all()


def test_sessions_differ_and_repeat() -> None:
    assert (
        SessionVariation.draw(1) == SessionVariation.draw(1) != SessionVariation.draw(2)
    )


def test_a_scene_has_three_smooth_and_two_rough_stones() -> None:
    scene: Scene = five_stones(shuffled(11))
    assert (
        sorted(placed.object.label for placed in scene.placed)
        == [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2
    )
    assert len({placed.object.surface.seed for placed in scene.placed}) == 5
