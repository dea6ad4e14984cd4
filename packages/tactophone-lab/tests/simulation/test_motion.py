import numpy as np
import pytest

from tactophone_lab.simulation.motion import LIFT, Field, Move, MoveFollower

RATE = 48_000


def hand(x: float = 0.0) -> MoveFollower:
    return MoveFollower(
        Field(np.array([[0.0, 0.0, 0.1, 0.07]]), height=0.012, rounding=0.005),
        x=x,
        y=0.035,
        rate=RATE,
    )


def test_the_hand_reaches_its_target_with_little_overshoot() -> None:
    moving = hand(0.02)
    moving.queue([Move(0.0, 0.05, 0.035, 1.0)])
    path = moving.follow(RATE)
    assert path.x[-1] == pytest.approx(0.05, abs=1e-5)
    assert path.x.max() < 0.0505
    assert path.motion.press[-1] == pytest.approx(1.0, abs=1e-3)


def test_moves_take_effect_at_their_time() -> None:
    moving = hand(0.02)
    moving.queue([Move(0.5, 0.05, 0.035, 1.0)])
    path = moving.follow(RATE)
    assert path.x[: RATE // 2] == pytest.approx(0.02)
    assert path.motion.press[: RATE // 2] == pytest.approx(LIFT)
    assert path.x[RATE // 2 + 4800] > 0.045


def test_a_reversal_goes_back_over_the_same_ground() -> None:
    moving = hand(0.02)
    moving.queue([Move(0.0, 0.05, 0.035, 1.0), Move(1.0, 0.02, 0.035, 1.0)])
    motion = moving.follow(2 * RATE).motion
    assert motion.position.max() == pytest.approx(0.03, abs=1e-3)
    assert motion.position[-1] == pytest.approx(0.0, abs=1e-3)
    assert motion.speed.min() < 0 < motion.speed.max()


def test_beyond_the_edge_there_is_the_ground() -> None:
    moving = hand(0.05)
    moving.queue([Move(0.0, 0.15, 0.035, 1.0)])
    motion = moving.follow(RATE).motion
    assert (motion.body[0], motion.body[-1]) == (0, 1)
    assert motion.height[-1] == -0.012
    assert np.all(np.diff(motion.height) <= 0)
