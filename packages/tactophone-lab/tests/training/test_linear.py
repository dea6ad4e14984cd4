import numpy as np
import onnxruntime
import pytest

from tactophone.signal.perception.model_file import FEATURES, LOG_PROBABILITIES
from tactophone_lab.training.linear import IMPULSES, fit_classifier
from tactophone_lab.training.onnx_export import LinearClassifier, build_classifier_graph
from tactophone_lab.training.recipe_options import BAND_VALUES
from tactophone_lab.training.sets import Examples, even_weights, inner_folds

FEATURE_COUNT = 4


def clouds(seed: int = 0, *, gap: float = 1.0) -> Examples:
    """Ten surfaces of two classes: the first and third feature separate them, each
    surface is a little off."""
    rng = np.random.default_rng(seed)
    surface = np.repeat(np.arange(10), 300)
    rough = surface % 2 == 1
    features = (
        rng.standard_normal((3000, FEATURE_COUNT))
        + rng.standard_normal((10, FEATURE_COUNT))[surface] * 0.5
    )
    features[:, ::2] += gap * rough[:, None]
    return Examples(features.astype(np.float32), rough, surface)


def classify(
    classifier: LinearClassifier, features: np.ndarray, channels: int = 2
) -> np.ndarray:
    session = onnxruntime.InferenceSession(
        build_classifier_graph(classifier, channels=channels).SerializeToString()
    )
    (log_probabilities,) = session.run(
        [LOG_PROBABILITIES], {FEATURES: features.astype(np.float32)}
    )
    return np.exp(log_probabilities)


@pytest.fixture(scope="module")
def classifier() -> LinearClassifier:
    return fit_classifier(clouds(), channels=2)


def test_probabilities_sum_to_one_and_agree_with_the_weights(
    classifier: LinearClassifier,
) -> None:
    examples = clouds(1)
    probabilities = classify(classifier, examples.features)
    assert probabilities.sum(axis=1) == pytest.approx(np.ones(3000), abs=1e-5)
    standard = (examples.features - classifier.centre) / classifier.scale
    logits = standard @ classifier.weights[0] + classifier.biases[0]
    assert probabilities[:, 2] / probabilities[:, 1:].sum(axis=1) == pytest.approx(
        1 / (1 + np.exp(-logits)), abs=1e-4
    )
    distance = np.square(standard @ classifier.whitening).mean(axis=1)
    assert ((probabilities[:, 0] > 0.5) == (distance > classifier.limit)).mean() > 0.999


def test_a_single_window_gives_the_same_as_in_a_batch(
    classifier: LinearClassifier,
) -> None:
    features = clouds(1).features[:3]
    single = np.concatenate([classify(classifier, row[None]) for row in features])
    assert single == pytest.approx(classify(classifier, features), abs=1e-6)


@pytest.mark.parametrize("gone", [0, 1])
def test_either_channel_alone_uses_its_own_regression(
    classifier: LinearClassifier, gone: int
) -> None:
    examples = clouds(1)
    features = examples.features.copy()
    features[:, 2 * gone : 2 * gone + 2] = np.nan
    probabilities = classify(classifier, features)
    assert np.isfinite(probabilities).all()
    right = (probabilities[:, 2] > probabilities[:, 1]) == examples.rough
    assert (
        0.6
        < right.mean()
        <= (
            (classify(classifier, examples.features)[:, 2] > 0.45) == examples.rough
        ).mean()
        + 0.1
    )


def test_with_no_channel_left_smooth_and_rough_are_equal(
    classifier: LinearClassifier,
) -> None:
    row = classify(classifier, np.full((1, FEATURE_COUNT), np.nan))[0]
    assert row[1] == pytest.approx(row[2])


def test_confidence_is_calibrated_on_held_out_surfaces(
    classifier: LinearClassifier,
) -> None:
    probabilities, examples = classify(classifier, clouds(2).features), clouds(2)
    share = probabilities[:, 2] / probabilities[:, 1:].sum(axis=1)
    sure = (share > 0.8) | (share < 0.2)
    correct = (share > 0.5) == examples.rough
    confidence = np.maximum(share, 1 - share)
    assert correct[sure].mean() > correct.mean()
    assert abs(confidence.mean() - correct.mean()) < 0.1


def test_every_class_and_surface_weighs_the_same() -> None:
    rough = np.array([True, True, True, False, False, False, False, False])
    surface = np.array([0, 0, 1, 2, 2, 2, 2, 3])
    weights = even_weights(rough, surface)
    assert weights.mean() == pytest.approx(1)
    assert [weights[surface == number].sum() for number in range(4)] == pytest.approx(
        [2, 2, 2, 2]
    )


def test_an_importance_weighs_surfaces_within_a_class() -> None:
    rough = np.array([True, True, False, False, False])
    surface = np.array([0, 1, 2, 2, 3])
    weights = even_weights(rough, surface, np.array([1.0, 0.25, 0.25, 0.25, 1.0]))
    assert weights[rough].sum() == pytest.approx(weights[~rough].sum())
    assert weights[0] / weights[1] == pytest.approx(4)
    assert weights[surface == 3].sum() / weights[surface == 2].sum() == pytest.approx(4)


def test_surfaces_of_little_importance_hardly_move_the_head() -> None:
    examples = clouds()
    odd = clouds(3)
    upside_down = Examples(odd.features, ~odd.rough, odd.surface + 10)
    both = Examples(
        np.concatenate([examples.features, upside_down.features]),
        np.concatenate([examples.rough, upside_down.rough]),
        np.concatenate([examples.surface, upside_down.surface]),
        np.repeat([1.0, 0.01], 3000),
    )
    alone, mixed = (
        fit_classifier(each, channels=2).weights[0] for each in (examples, both)
    )
    assert mixed == pytest.approx(alone, abs=0.15)


def test_half_of_the_head_of_a_hard_tip_rests_on_crest_and_clicks() -> None:
    rng = np.random.default_rng(0)
    surface = np.repeat(np.arange(10), 100)
    rough = surface % 2 == 1
    values = BAND_VALUES + 1
    features = rng.standard_normal((1000, 2 * values)) + 2 * rough[:, None]
    examples = Examples(features.astype(np.float32), rough, surface)
    plain, hard = (
        fit_classifier(examples, channels=1, hard_tip=hard).weights[0]
        for hard in (False, True)
    )
    impulses = np.isin(np.arange(2 * values) % values, IMPULSES)
    assert hard[~impulses] == pytest.approx(plain[~impulses] / 2)
    assert (hard[impulses] > plain[impulses]).all()


def test_inner_folds_split_by_surface() -> None:
    examples = clouds()
    for out in inner_folds(examples.rough, examples.surface):
        assert not set(examples.surface[out]) & set(examples.surface[~out])


def test_one_surface_of_each_class_is_enough() -> None:
    examples = clouds()
    few = examples.where(
        np.isin(
            examples.surface,
            [examples.surface[examples.rough][0], examples.surface[~examples.rough][0]],
        )
    )
    assert len(np.unique(few.surface)) == 2
    assert np.isfinite(fit_classifier(few, channels=2).limit)
