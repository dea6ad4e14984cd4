import numpy as np
import onnxruntime
import pytest

from tactophone.perception.model_file import FEATURES, LOG_PROBABILITIES
from tactophone.training.features.linear_classifier import Examples, Head, even_weights, fit_head, inner_folds
from tactophone.training.features.onnx_graph import build_head_graph

FEATURE_COUNT = 4


def clouds(seed: int = 0, *, gap: float = 1.0) -> Examples:
    """Ten surfaces of two classes: the first and third feature tell them, each surface is a little off."""
    rng = np.random.default_rng(seed)
    surface = np.repeat(np.arange(10), 300)
    rough = surface % 2 == 1
    features = rng.standard_normal((3000, FEATURE_COUNT)) + rng.standard_normal((10, FEATURE_COUNT))[surface] * 0.5
    features[:, ::2] += gap * rough[:, None]
    return Examples(features.astype(np.float32), rough, surface)


def ask(head: Head, features: np.ndarray, channels: int = 2) -> np.ndarray:
    session = onnxruntime.InferenceSession(build_head_graph(head, channels=channels).SerializeToString())
    (answer,) = session.run([LOG_PROBABILITIES], {FEATURES: features.astype(np.float32)})
    return np.exp(answer)


@pytest.fixture(scope="module")
def head() -> Head:
    return fit_head(clouds(), channels=2)


def test_probabilities_sum_to_one_and_agree_with_the_weights(head: Head) -> None:
    examples = clouds(1)
    answers = ask(head, examples.features)
    assert answers.sum(axis=1) == pytest.approx(np.ones(3000), abs=1e-5)
    standard = (examples.features - head.centre) / head.scale
    logits = standard @ head.weights[0] + head.biases[0]
    assert answers[:, 2] / answers[:, 1:].sum(axis=1) == pytest.approx(1 / (1 + np.exp(-logits)), abs=1e-4)
    distance = np.square(standard @ head.whitening).mean(axis=1)
    assert ((answers[:, 0] > 0.5) == (distance > head.limit)).mean() > 0.999


def test_one_window_is_answered_as_in_a_batch(head: Head) -> None:
    features = clouds(1).features[:3]
    single = np.concatenate([ask(head, one[None]) for one in features])
    assert single == pytest.approx(ask(head, features), abs=1e-6)


@pytest.mark.parametrize("gone", [0, 1])
def test_either_channel_alone_is_answered_by_its_own_regression(head: Head, gone: int) -> None:
    examples = clouds(1)
    features = examples.features.copy()
    features[:, 2 * gone : 2 * gone + 2] = np.nan
    answers = ask(head, features)
    assert np.isfinite(answers).all()
    right = (answers[:, 2] > answers[:, 1]) == examples.rough
    assert 0.6 < right.mean() <= ((ask(head, examples.features)[:, 2] > 0.45) == examples.rough).mean() + 0.1


def test_with_no_channel_left_nothing_is_claimed(head: Head) -> None:
    answer = ask(head, np.full((1, FEATURE_COUNT), np.nan))[0]
    assert answer[1] == pytest.approx(answer[2])


def test_confidence_is_honest_on_surfaces_not_met(head: Head) -> None:
    answers, examples = ask(head, clouds(2).features), clouds(2)
    share = answers[:, 2] / answers[:, 1:].sum(axis=1)
    sure = (share > 0.8) | (share < 0.2)
    called = (share > 0.5) == examples.rough
    claimed = np.maximum(share, 1 - share)
    assert called[sure].mean() > called.mean()
    assert abs(claimed.mean() - called.mean()) < 0.1


def test_every_class_and_surface_weighs_the_same() -> None:
    rough = np.array([True, True, True, False, False, False, False, False])
    surface = np.array([0, 0, 1, 2, 2, 2, 2, 3])
    weights = even_weights(rough, surface)
    assert weights.mean() == pytest.approx(1)
    assert [weights[surface == one].sum() for one in range(4)] == pytest.approx([2, 2, 2, 2])


def test_inner_folds_part_surfaces() -> None:
    examples = clouds()
    for out in inner_folds(examples.rough, examples.surface):
        assert not set(examples.surface[out]) & set(examples.surface[~out])
