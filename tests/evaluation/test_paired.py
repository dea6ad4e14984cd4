import numpy as np

from tactophone.evaluation.metrics import Scores, collect
from tactophone.evaluation.paired import compare


def scores(noise: float, seed: int = 0) -> Scores:
    rng = np.random.default_rng(seed)
    surface = np.repeat(np.arange(10), 100)
    rough = surface % 2 == 1
    score = np.clip(0.25 + 0.5 * rough + noise * rng.standard_normal(1000), 0, 1)
    return collect(score, rough=rough, surface=surface, names=tuple(f"stone {k}" for k in range(10)))


def test_the_better_method_is_told_with_confidence() -> None:
    found = compare(scores(0.1), scores(0.5), draws=200)["balanced_accuracy"]
    assert found.estimate.value > 0.1
    assert found.estimate.low > 0
    assert found.p < 0.05


def test_a_method_does_not_differ_from_itself() -> None:
    found = compare(scores(0.3), scores(0.3), draws=100)["auc"]
    assert found.estimate.value == 0
    assert found.p == 1
