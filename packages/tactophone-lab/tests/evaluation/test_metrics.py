import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import roc_auc_score

from tactophone_lab.evaluation.metrics import Scores, measure, rough_score, sort_scores


def scores(score: list[float], rough: list[int]) -> Scores:
    return sort_scores(
        np.array(score),
        rough=np.array(rough, bool),
        surface=np.arange(len(score)),
        names=tuple("abcdefghij")[: len(score)],
    )


def test_metrics_of_a_case_counted_by_hand() -> None:
    metrics = measure(scores([0.9, 0.8, 0.4, 0.6, 0.2, 0.1], [1, 1, 1, 0, 0, 0]))
    assert metrics == pytest.approx(
        {
            "smooth_accuracy": 2 / 3,
            "rough_accuracy": 2 / 3,
            "balanced_accuracy": 2 / 3,
            "false_positive_rate": 1 / 3,
            "auc": 8 / 9,
            "recall_at_1": 2 / 3,
            "rough_as_rough": 2 / 6,
            "rough_as_smooth": 1 / 6,
            "smooth_as_rough": 1 / 6,
            "smooth_as_smooth": 2 / 6,
        }
    )


def test_one_in_a_hundred_smooth_windows_may_be_exceeded() -> None:
    smooth = np.linspace(0, 0.5, 100)
    rough = np.array([0.3, 0.4975, 0.51, 0.6])
    made = sort_scores(
        np.concatenate([smooth, rough]),
        rough=np.arange(104) >= 100,
        surface=np.zeros(104, int),
        names=("one",),
    )
    assert measure(made)["recall_at_1"] == 0.75


@pytest.mark.slow
@given(st.lists(st.tuples(st.integers(0, 4), st.booleans()), min_size=2, max_size=40))
def test_auc_agrees_with_scikit_learn_ties_and_all(
    windows: list[tuple[int, bool]],
) -> None:
    score, rough = (np.array(column) for column in zip(*windows, strict=True))
    if rough.all() or not rough.any():
        return
    made = sort_scores(
        score / 4, rough=rough, surface=np.zeros(len(score), int), names=("one",)
    )
    assert measure(made)["auc"] == pytest.approx(roc_auc_score(rough, score))


def test_a_weight_counts_as_so_many_windows() -> None:
    once = scores([0.9, 0.4, 0.6, 0.1], [1, 1, 0, 0])
    twice = scores([0.9, 0.9, 0.4, 0.6, 0.1], [1, 1, 1, 0, 0])
    assert measure(once, np.array([1.0, 1.0, 1.0, 2.0])) == pytest.approx(
        measure(twice)
    )


def test_metrics_of_a_missing_class_are_nan() -> None:
    metrics = measure(scores([0.9, 0.8], [1, 1]))
    assert metrics["rough_accuracy"] == 1
    assert np.isnan(
        [metrics["smooth_accuracy"], metrics["auc"], metrics["recall_at_1"]]
    ).all()


def test_a_prediction_none_counts_as_smooth_by_the_authors_rule_only() -> None:
    none_mostly = np.array([[0.7, 0.1, 0.2], [1.0, 0.0, 0.0]], np.float32)
    assert rough_score(none_mostly, "authors") == pytest.approx([0.2, 0.0])
    assert rough_score(none_mostly, "two-class") == pytest.approx([2 / 3, 0.5])
