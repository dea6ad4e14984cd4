import numpy as np
import pytest

from tactophone.evaluation.bootstrap import BINS, estimate
from tactophone.evaluation.metrics import Scores, count_by_surface, measure, measure_counts, sort_scores


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
    narrow, wide = (estimate(made(12, spread=0.15, windows=n), draws=300)["auc"] for n in (400, 20))
    assert narrow.high - narrow.low == pytest.approx(wide.high - wide.low, rel=0.35)


def test_more_surfaces_narrow_the_interval() -> None:
    few, many = (estimate(made(n, spread=0.15), draws=300)["balanced_accuracy"] for n in (8, 128))
    assert many.high - many.low < (few.high - few.low) / 2


def test_one_surface_a_class_leaves_no_spread() -> None:
    auc = estimate(made(2, spread=0.0), draws=50)["auc"]
    assert auc.low == auc.value == auc.high


def test_draws_in_bins_measure_what_exact_ones_do() -> None:
    scores = made(12, spread=0.15, windows=400)
    times = np.random.default_rng(3).integers(0, 3, size=(20, 12)).astype(float)
    table, called = count_by_surface(scores, bins=BINS)
    binned = measure_counts(np.tensordot(times, table, axes=1), called)
    for row, weights in enumerate(times):
        exact = measure(scores, weights[scores.surface])
        assert {name: drawn[row] for name, drawn in binned.items()} == pytest.approx(exact, abs=2e-3)
