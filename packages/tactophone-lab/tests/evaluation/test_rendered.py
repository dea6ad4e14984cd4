import math
from dataclasses import replace

import numpy as np
import pytest

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Segment
from tactophone.core.types import Touch
from tactophone.signal.perception.decision import DecisionRule
from tactophone_lab.evaluation.predict import TakePredictions
from tactophone_lab.evaluation.scores import rendered_scores, unknown_shares
from tests.evaluation.takes import predicted

RULE = DecisionRule()


def felt(
    *touches: tuple[Touch, int], label: Touch, surface: str = "slate"
) -> TakePredictions:
    """Predictions of which so many each were felt as these touches."""
    touch = np.concatenate([np.full(count, each) for each, count in touches])
    take = predicted([0.5] * len(touch), label=label, surface=surface)
    return replace(take, touch=touch.astype(np.int8))


def test_gaps_and_unknown_sound_count_as_wrong() -> None:
    takes = [
        felt((Touch.ROUGH, 50), (Touch.NONE, 50), label=Touch.ROUGH, surface="brick"),
        felt((Touch.SMOOTH, 100), label=Touch.ROUGH, surface="unknown"),
        felt((Touch.SMOOTH, 90), (Touch.ROUGH, 10), label=Touch.SMOOTH),
    ]
    scores = rendered_scores(takes, RULE)
    assert scores.rough_as_rough.value == pytest.approx(0.25)
    assert scores.smooth_as_rough.value == pytest.approx(0.1)
    assert scores.smooth_as_smooth.value == pytest.approx(0.9)
    assert scores.gaps.value == pytest.approx(50 / 300)
    assert scores.wrong.value == pytest.approx((100 + 10) / 300)
    assert scores.balanced_accuracy.value == pytest.approx((0.25 + 0.9) / 2)
    assert math.isnan(scores.rough_as_rough.low)  # one smooth surface


def test_only_true_contact_counts_and_one_class_has_its_own_accuracy() -> None:
    segments = (Segment(0.0, 0.5, "none"), Segment(0.5, 1.0, "rough"))
    take = felt((Touch.SMOOTH, 50), (Touch.ROUGH, 50), label=Touch.ROUGH)
    beside = replace(take, recording=replace(take.recording, segments=segments))
    scores = rendered_scores([beside], RULE)
    assert scores.balanced_accuracy.value == 1.0
    assert math.isnan(scores.smooth_as_rough.value)


def test_unknown_windows_are_no_evidence() -> None:
    take = predicted([0.9] * 100, label=Touch.ROUGH, none=0.9)
    scores = rendered_scores([take], DecisionRule(abstain_from=0.5))
    assert scores.rough_as_rough.value == 0


def test_nothing_to_score_is_an_error() -> None:
    with pytest.raises(DatasetError, match="nothing can be scored"):
        rendered_scores([predicted([0.5], label=None)], RULE)


def test_errors_are_counted_in_unknown_contact_and_in_the_rest() -> None:
    rough = predicted([0.5] * 80, label=Touch.ROUGH)
    smooth = predicted(
        [0.5] * 20, label=Touch.SMOOTH, contact=[True] * 10 + [False] * 10
    )
    takes = [
        replace(
            rough,
            touch=np.repeat([Touch.ROUGH, Touch.SMOOTH], [70, 10]).astype(np.int8),
            unknown=np.repeat([True, False, True], [10, 60, 10]),
        ),
        replace(
            smooth,
            touch=np.repeat([Touch.ROUGH, Touch.SMOOTH], [5, 15]).astype(np.int8),
            unknown=np.zeros(20, bool),
        ),
    ]
    assert unknown_shares(takes) == pytest.approx((20 / 90, 10 / 20, 5 / 70))


def test_nothing_is_unknown_where_no_evidence_of_a_touch_decides() -> None:
    without = predicted([0.5] * 80, label=Touch.ROUGH)
    assert all(math.isnan(share) for share in unknown_shares([without]))
