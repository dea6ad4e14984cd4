import pytest

from tactophone.core.types import Touch
from tactophone.signal.perception.decision import (
    FORGET_AFTER,
    Decision,
    DecisionRule,
    rough_share,
)


def shares(decision: Decision, *values: float) -> list[Touch]:
    return [
        decision.decide((0.0, 1 - value, value), contact=True)[0] for value in values
    ]


def test_the_papers_rule_takes_the_likelier() -> None:
    assert shares(Decision(DecisionRule()), 0.4, 0.6, 0.4) == [
        Touch.SMOOTH,
        Touch.ROUGH,
        Touch.SMOOTH,
    ]


def test_no_contact_overrides_and_the_networks_none_is_not_used() -> None:
    decision = Decision(DecisionRule())
    assert decision.decide((0.0, 0.0, 1.0), contact=False) == (Touch.NONE, 0.0)
    assert decision.decide((0.98, 0.005, 0.015), contact=True)[0] is Touch.ROUGH


def test_hysteresis_holds_a_decision_between_its_thresholds() -> None:
    decision = Decision(DecisionRule(rough_on=0.7, rough_off=0.3))
    assert shares(decision, 0.6, 0.8, 0.4, 0.2) == [
        Touch.SMOOTH,
        Touch.ROUGH,
        Touch.ROUGH,
        Touch.SMOOTH,
    ]


def test_rough_must_be_confirmed_and_is_not_rendered_before() -> None:
    decision = Decision(DecisionRule(confirm=3))
    decisions = [decision.decide((0.0, 0.0, 1.0), contact=True) for _ in range(3)]
    assert [touch for touch, _ in decisions] == [
        Touch.SMOOTH,
        Touch.SMOOTH,
        Touch.ROUGH,
    ]
    assert [roughness < 0.5 for _, roughness in decisions] == [True, True, False]


def test_predictions_without_contact_confirm_nothing() -> None:
    decision = Decision(DecisionRule(confirm=3))
    for _ in range(10):
        decision.decide((0.0, 0.4, 0.6), contact=False)
    assert shares(decision, 0.6, 0.6, 0.6) == [Touch.SMOOTH, Touch.SMOOTH, Touch.ROUGH]


@pytest.mark.parametrize(
    ("still", "expected"),
    [(FORGET_AFTER - 1, Touch.ROUGH), (FORGET_AFTER, Touch.SMOOTH)],
)
def test_a_stroke_that_turns_on_a_rough_surface_is_confirmed_already(
    still: int, expected: Touch
) -> None:
    decision = Decision(DecisionRule(confirm=3))
    assert shares(decision, 0.9, 0.9, 0.9)[-1] is Touch.ROUGH
    assert {
        decision.decide((0.0, 0.1, 0.9), contact=False)[0] for _ in range(still)
    } == {Touch.NONE}
    assert shares(decision, 0.9) == [expected]


@pytest.mark.parametrize(
    ("length", "expected"),
    [(FORGET_AFTER - 1, Touch.ROUGH), (FORGET_AFTER, Touch.SMOOTH)],
)
def test_unknown_sound_is_smooth_and_refutes_a_rough_touch_only_where_it_lasts(
    length: int, expected: Touch
) -> None:
    decision = Decision(DecisionRule(confirm=3, abstain_from=0.5))
    assert shares(decision, 0.9, 0.9, 0.9)[-1] is Touch.ROUGH
    assert {decision.decide((0.6, 0.0, 0.4), contact=True) for _ in range(length)} == {
        (Touch.SMOOTH, 0.0)
    }
    assert shares(decision, 0.9) == [expected]


def test_the_threshold_lies_at_half_roughness() -> None:
    decision = Decision(DecisionRule(rough_on=0.8, rough_off=0.8))
    assert decision.decide((0.0, 0.2, 0.8), contact=True)[1] == pytest.approx(0.5)


def test_an_impossible_rule_is_refused() -> None:
    with pytest.raises(ValueError, match="rough_off <= rough_on"):
        DecisionRule(rough_on=0.3, rough_off=0.6)


@pytest.mark.parametrize(
    ("on", "off", "share", "expected"),
    [
        (0.8, 0.8, 0.4, 0.25),
        (0.8, 0.8, 0.0, 0.0),
        (0.8, 0.8, 0.9, 0.75),
        (0.8, 0.8, 1.0, 1.0),
        (0.5, 0.5, 0.25, 0.25),
    ],
)
def test_roughness_is_piecewise_linear_on_both_sides_of_the_threshold(
    on: float, off: float, share: float, expected: float
) -> None:
    decision = Decision(DecisionRule(rough_on=on, rough_off=off))
    assert decision.decide((0.0, 1 - share, share), contact=True)[1] == pytest.approx(
        expected
    )


def test_a_share_on_the_threshold_is_rough_and_counts_towards_confirmation() -> None:
    decision = Decision(DecisionRule(rough_on=0.75, rough_off=0.5, confirm=2))
    assert shares(decision, 0.75, 0.75, 0.5, 0.25) == [
        Touch.SMOOTH,
        Touch.ROUGH,
        Touch.ROUGH,
        Touch.SMOOTH,
    ]
    exact = Decision(DecisionRule(rough_on=0.75, rough_off=0.75))
    assert exact.decide((0.0, 0.25, 0.75), contact=True) == (Touch.ROUGH, 0.5)


def test_a_share_under_the_threshold_begins_the_confirmation_anew() -> None:
    decision = Decision(DecisionRule(confirm=2))
    assert shares(decision, 0.9, 0.1, 0.9, 0.9) == [
        Touch.SMOOTH,
        Touch.SMOOTH,
        Touch.SMOOTH,
        Touch.ROUGH,
    ]


def test_sound_just_as_unlike_any_in_training_as_the_rule_says_is_unknown() -> None:
    decision = Decision(DecisionRule(abstain_from=0.5))
    assert decision.decide((0.5, 0.0, 0.5), contact=True) == (Touch.SMOOTH, 0.0)
    assert decision.decide((0.49, 0.0, 0.51), contact=True)[0] is Touch.ROUGH


def test_the_papers_rule_takes_no_sound_for_unknown() -> None:
    assert (
        Decision(DecisionRule()).decide((1.0, 0.0, 0.0), contact=True)[0] is Touch.ROUGH
    )
    assert rough_share((1.0, 0.0, 0.0)) == 0.5


def test_a_touch_is_forgotten_after_a_quarter_of_a_second() -> None:
    assert FORGET_AFTER == 25


@pytest.mark.parametrize(
    "wrong", [{"rough_off": 0.0}, {"rough_on": 1.0}, {"confirm": 0}]
)
def test_a_rule_that_would_always_or_never_be_rough_is_refused(
    wrong: dict[str, float],
) -> None:
    with pytest.raises(ValueError, match="must "):
        DecisionRule(**wrong)  # type: ignore[arg-type]
