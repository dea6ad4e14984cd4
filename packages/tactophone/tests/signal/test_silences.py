from tactophone.signal.perception.decision import FORGET_AFTER
from tactophone.signal.silences import (
    FADED_PAUSE,
    LIFT,
    LONGEST_TURN,
    PAUSE,
    SLIDE_HOLD,
    TOUCH_HOLD,
)


def test_what_costs_most_if_it_is_wrong_ends_first() -> None:
    steps = [PAUSE, FADED_PAUSE, TOUCH_HOLD, SLIDE_HOLD, LONGEST_TURN, LIFT]
    assert steps == sorted(set(steps))


def test_a_verdict_without_a_gate_lasts_over_the_longest_turn() -> None:
    hop = 0.01
    assert FORGET_AFTER * hop == LONGEST_TURN
