import numpy as np

from tactophone.evaluation import Scores, paired_difference
from tactophone.evaluation.metrics import sort_scores


def scores(noise: float, seed: int = 0) -> Scores:
    rng = np.random.default_rng(seed)
    surface = np.repeat(np.arange(10), 100)
    rough = surface % 2 == 1
    score = np.clip(0.25 + 0.5 * rough + noise * rng.standard_normal(1000), 0, 1)
    return sort_scores(score, rough=rough, surface=surface, names=tuple(f"stone {k}" for k in range(10)))


def test_the_better_method_differs_significantly() -> None:
    difference = paired_difference(scores(0.1), scores(0.5), draws=200)["balanced_accuracy"]
    assert difference.estimate.value > 0.1
    assert difference.estimate.low > 0
    assert difference.p < 0.05


def test_a_method_does_not_differ_from_itself() -> None:
    difference = paired_difference(scores(0.3), scores(0.3), draws=100)["auc"]
    assert difference.estimate.value == 0
    assert difference.p == 1
