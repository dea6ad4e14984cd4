import math

import pytest

from tactophone.core.types import Prediction, Touch
from tactophone.signal.perception.comparison import MeanEvidence, probability_rougher
from tactophone.signal.perception.decision import DecisionRule, share_of
from tactophone.signal.perception.evidence import CAUTION, GREATEST_STEP

RULE = DecisionRule(abstain_from=0.5)


def heard(
    evidence: float,
    *,
    at: float = 0.0,
    touch: Touch = Touch.SMOOTH,
    roughness: float = 0.3,
    none: float = 0.0,
) -> Prediction:
    rough = (1 - none) * share_of(evidence + CAUTION)
    return Prediction(
        (none, 1 - none - rough, rough),
        touch,
        roughness,
        level_dbfs=-20.0,
        start=at,
        end=at + 0.032,
    )


def mean_of(*predictions: Prediction) -> MeanEvidence:
    mean = MeanEvidence(RULE)
    for prediction in predictions:
        mean.push(prediction)
    return mean


def test_all_that_is_heard_of_an_object_counts_alike() -> None:
    early = [heard(2.0, at=0.01 * step) for step in range(100)]
    late = [heard(-1.0, at=9 + 0.01 * step) for step in range(100)]
    mean = mean_of(*early, *late)
    assert mean.value == pytest.approx(0.5, abs=0.01)
    assert mean.seconds == pytest.approx(2 * (0.032 + 0.99))


def test_a_window_that_is_told_twice_counts_once() -> None:
    mean = mean_of(heard(2.0), heard(2.0), heard(-1.0, at=0.032))
    assert mean.value == pytest.approx(0.5)


@pytest.mark.parametrize(
    "silent",
    [
        heard(2.0, at=1.0, touch=Touch.NONE),
        heard(2.0, at=1.0, roughness=0.0),
        heard(2.0, at=1.0, none=0.6),
    ],
    ids=["no contact", "held", "unlike training"],
)
def test_what_says_nothing_of_the_surface_does_not_count(silent: Prediction) -> None:
    mean = mean_of(heard(-1.0), silent)
    assert (mean.value, mean.seconds) == (pytest.approx(-1.0), pytest.approx(0.032))


def test_no_single_window_decides_an_order() -> None:
    certain = Prediction((0.0, 0.0, 1.0), Touch.ROUGH, 1.0, -20.0, 0.0, 0.032)
    assert mean_of(certain).value == GREATEST_STEP


@pytest.mark.parametrize("difference", [0.5, 2.0, 6.0, math.inf])
def test_an_order_is_as_sure_from_either_side(difference: float) -> None:
    both = [probability_rougher(each) for each in (difference, -difference)]
    assert both[0] > 0.5
    assert sum(both) == pytest.approx(1.0)


def test_an_order_is_surer_the_larger_the_difference() -> None:
    sure = [probability_rougher(difference) for difference in (0.0, 0.5, 2.0, 6.0)]
    assert sure[0] == 0.5
    assert sorted(set(sure)) == sure
