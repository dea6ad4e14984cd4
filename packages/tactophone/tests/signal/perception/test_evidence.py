from tactophone.signal.perception.decision import DecisionRule, Probabilities
from tactophone.signal.perception.evidence import TouchEvidence
from tactophone.signal.silences import LIFT

SMOOTH = (0.0, 0.9, 0.1)
ROUGH = (0.0, 0.1, 0.9)
STRANGE = (0.9, 0.05, 0.05)


def evidence_of(*windows: Probabilities) -> TouchEvidence:
    evidence = TouchEvidence(DecisionRule(abstain_from=0.5))
    for number, window in enumerate(windows):
        evidence.hear(window, 0.01 * number)
    return evidence


def test_a_touch_is_unknown_until_evidence_reaches_a_bound() -> None:
    assert evidence_of().is_unknown(0.0)
    assert not evidence_of(SMOOTH).is_unknown(0.0)
    known = [
        not evidence_of(*[ROUGH] * count).is_unknown(0.01 * count)
        for count in range(1, 15)
    ]
    assert known == sorted(known)
    assert (known[0], known[-1]) == (False, True)


def test_a_touch_that_is_felt_as_rough_is_unknown_until_it_is_certain() -> None:
    barely = evidence_of(*[ROUGH] * 6)
    assert barely.is_rough(0.06)
    assert barely.is_unknown(0.06)


def test_a_touch_is_unknown_again_where_evidence_turns() -> None:
    assert evidence_of(*[ROUGH] * 14, SMOOTH).is_unknown(0.15)


def test_sound_unlike_training_is_unknown_whatever_came_before() -> None:
    assert evidence_of(STRANGE).is_unknown(0.0)
    assert evidence_of(*[ROUGH] * 14, STRANGE).is_unknown(0.15)
    assert not evidence_of(*[ROUGH] * 14, STRANGE, ROUGH).is_unknown(0.16)


def test_nothing_is_known_of_the_next_touch_after_a_lift() -> None:
    evidence = evidence_of(*[ROUGH] * 14)
    assert not evidence.is_unknown(0.14 + LIFT / 2)
    assert evidence.is_unknown(0.14 + 2 * LIFT)
