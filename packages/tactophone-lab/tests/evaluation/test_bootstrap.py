from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Recording
from tactophone.core.types import Touch
from tactophone_lab.evaluation.bootstrap import (
    SCORE_BINS,
    Estimate,
    accuracy_of,
    compare_models,
    estimate,
    paired_difference,
)
from tactophone_lab.evaluation.metrics import (
    Scores,
    count_by_surface,
    measure,
    measure_counts,
    sort_scores,
)
from tactophone_lab.evaluation.predict import TakePredictions


def made(surfaces: int, *, spread: float, windows: int = 50, seed: int = 0) -> Scores:
    """Half the surfaces rough; each surface has its own mean score."""
    rng = np.random.default_rng(seed)
    rough = np.arange(surfaces) % 2 == 1
    centre = np.where(rough, 0.6, 0.4) + spread * rng.normal(size=surfaces)
    score = np.clip(centre[:, None] + 0.05 * rng.normal(size=(surfaces, windows)), 0, 1)
    return sort_scores(
        score.ravel(),
        rough=np.repeat(rough, windows),
        surface=np.repeat(np.arange(surfaces), windows),
        names=tuple(map(str, range(surfaces))),
    )


def test_the_interval_holds_the_value_and_is_reproducible() -> None:
    scores = made(12, spread=0.15)
    first, second = estimate(scores, draws=200), estimate(scores, draws=200)
    assert first == second
    for score in first.values():
        assert score.low <= score.value <= score.high


def test_more_windows_of_the_same_surfaces_do_not_narrow_the_interval() -> None:
    narrow, wide = (
        estimate(made(12, spread=0.15, windows=n), draws=300)["auc"] for n in (400, 20)
    )
    assert narrow.high - narrow.low == pytest.approx(wide.high - wide.low, rel=0.35)


def test_more_surfaces_narrow_the_interval() -> None:
    few, many = (
        estimate(made(n, spread=0.15), draws=300)["balanced_accuracy"]
        for n in (12, 192)
    )
    assert many.high - many.low < (few.high - few.low) / 2


def test_fewer_than_five_surfaces_a_class_have_no_interval() -> None:
    auc = estimate(made(8, spread=0.15), draws=50)["auc"]
    assert np.isnan([auc.low, auc.high]).all()
    assert str(auc) == f"{auc.value:.3f}"
    assert auc.rounded(3) == [round(auc.value, 3)]
    assert np.isnan(
        paired_difference(made(2, spread=0.15), made(2, spread=0.15), draws=50)["auc"].p
    )


def test_a_rate_rises_beyond_its_interval_or_without_one_by_two_points() -> None:
    known, unknown = Estimate(0.1, 0.05, 0.2), Estimate(0.1, np.nan, np.nan)
    assert [Estimate(0, 0, 0).is_exceeded_by(rate) for rate in (0, 0.01, 0.03)] == [
        False,
        False,
        True,
    ]
    assert [known.is_exceeded_by(rate) for rate in (0.1, 0.19, 0.21)] == [
        False,
        False,
        True,
    ]
    assert [unknown.is_exceeded_by(rate) for rate in (0.1, 0.11, 0.13, np.nan)] == [
        False,
        False,
        True,
        False,
    ]


def test_draws_in_bins_measure_what_exact_ones_do() -> None:
    scores = made(12, spread=0.15, windows=400)
    times = np.random.default_rng(3).integers(0, 3, size=(20, 12)).astype(float)
    table, called = count_by_surface(scores, bins=SCORE_BINS)
    binned = measure_counts(np.tensordot(times, table, axes=1), called)
    for row, weights in enumerate(times):
        exact = measure(scores, weights[scores.surface])
        assert {name: drawn[row] for name, drawn in binned.items()} == pytest.approx(
            exact, abs=2e-3
        )


def scores(noise: float, seed: int = 0) -> Scores:
    rng = np.random.default_rng(seed)
    surface = np.repeat(np.arange(10), 100)
    rough = surface % 2 == 1
    score = np.clip(0.25 + 0.5 * rough + noise * rng.standard_normal(1000), 0, 1)
    return sort_scores(
        score,
        rough=rough,
        surface=surface,
        names=tuple(f"stone {k}" for k in range(10)),
    )


def test_the_better_method_differs_significantly() -> None:
    difference = paired_difference(scores(0.1), scores(0.5), draws=200)[
        "balanced_accuracy"
    ]
    assert difference.estimate.value > 0.1
    assert difference.estimate.low > 0
    assert difference.p < 0.05


def test_a_method_does_not_differ_from_itself() -> None:
    difference = paired_difference(scores(0.3), scores(0.3), draws=100)["auc"]
    assert difference.estimate.value == 0
    assert difference.p == 1


def predicted(correct: float, *, contact: bool = True) -> list[TakePredictions]:
    """Four surfaces with two takes each, of which a share of windows is classified
    correctly."""
    made = []
    for number in range(8):
        label = Touch.ROUGH if number % 4 < 2 else Touch.SMOOTH
        right = np.arange(100) < 100 * correct
        rough = right if label is Touch.ROUGH else ~right
        rows = np.stack([np.zeros(100), 1.0 - rough, rough], axis=1).astype(np.float32)
        recording = Recording(Path(f"{number}.wav"), f"stone {number // 2}", label)
        made.append(
            TakePredictions(
                recording, np.arange(100) / 100, rows, np.full(100, contact)
            )
        )
    return made


def test_gain_and_loss_are_paired() -> None:
    changes = compare_models(predicted(0.6), predicted(0.9), by=attrgetter("surface"))
    accuracy = changes["balanced_accuracy"]
    assert (accuracy.before.value, accuracy.after.value) == pytest.approx((0.6, 0.9))
    assert accuracy.difference.value == pytest.approx(0.3)
    assert accuracy.difference.low == pytest.approx(0.3)
    assert changes["false_positive_rate"].difference.value == pytest.approx(-0.3)
    assert (
        compare_models(predicted(0.6), predicted(0.9), by=attrgetter("path.name"))[
            "balanced_accuracy"
        ]
        == accuracy
    )


def test_objects_of_one_label_are_scored_on_it_alone() -> None:
    rough = [take for take in predicted(0.7) if take.recording.label is Touch.ROUGH]
    changes = compare_models(rough, rough, by=attrgetter("path.name"))
    assert changes["balanced_accuracy"].after.value == pytest.approx(0.7)
    assert np.isnan(changes["false_positive_rate"].after.value)
    assert accuracy_of(rough) == pytest.approx(0.7)


def test_no_contact_is_named() -> None:
    with pytest.raises(DatasetError, match="never opened"):
        compare_models(
            predicted(0.5, contact=False),
            predicted(0.5, contact=False),
            by=attrgetter("surface"),
        )
    with pytest.raises(DatasetError, match="never opened"):
        accuracy_of(predicted(0.5, contact=False))
