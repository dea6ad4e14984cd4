from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from tactophone.errors import ModelError
from tactophone.perception.detector import WindowDetector
from tactophone.perception.features import BAND_VALUES, TextureExtractor
from tactophone.perception.model_file import Gate, Model, ModelCard
from tactophone.perception.texture import BEFORE, FORGET_AFTER, PRIOR_WINDOWS, SETTLED, RunningStatistics

PRIOR = np.stack([np.zeros((2, BAND_VALUES)), np.ones((2, BAND_VALUES))])
NEVER = np.zeros((2, BAND_VALUES, BAND_VALUES))
CARD = ModelCard(
    "tiny",
    "texture",
    16_000,
    512,
    Fraction(160),
    2,
    Gate(-60.0, "banded"),
    settings={"prior": PRIOR.tolist(), "change_metric": NEVER.tolist()},
)


def window(seed: int = 0) -> np.ndarray:
    return 0.1 * np.random.default_rng(seed).standard_normal((512, 2)).astype(np.float32)


def features_of(extractor: TextureExtractor, sound: np.ndarray) -> np.ndarray:
    (description,) = extractor.describe(sound[None])
    return extractor.push(description, contact=True)


def fed(statistics: RunningStatistics, values: list[float], *, contact: bool = True) -> RunningStatistics:
    for value in values:
        statistics.push(np.full(statistics.moments.shape[1:], value, np.float32), contact=contact)
    return statistics


def test_a_touch_begins_with_the_prior_and_moves_at_once() -> None:
    statistics = fed(RunningStatistics(np.zeros((1, 1, 1))), [1.0])
    assert statistics.moments.ravel().tolist() == pytest.approx([1 / (1 + PRIOR_WINDOWS)] * 2)
    assert statistics.prior_weight == pytest.approx(PRIOR_WINDOWS / (1 + PRIOR_WINDOWS))


def test_the_weight_of_the_prior_makes_all_weights_sum_to_one() -> None:
    statistics = RunningStatistics(np.zeros((1, 2, 2)))
    for number in range(30):
        fed(statistics, [7.0], contact=number % 7 != 0)
        assert statistics.moments[0] + statistics.prior_weight * 7.0 == pytest.approx(np.full((1, 2), 7.0))


def test_a_stroke_that_turns_is_the_same_touch_and_one_that_ends_is_not() -> None:
    statistics = fed(RunningStatistics(np.zeros((1, 1, 1))), [1.0])
    fed(statistics, [9.0] * (FORGET_AFTER - 1), contact=False)
    assert statistics.prior_weight < 1
    fed(statistics, [9.0], contact=False)
    assert statistics.prior_weight == 1
    assert not statistics.moments.any()


def test_an_edge_restarts_the_statistics_and_drift_does_not() -> None:
    far = np.eye(2)[None] / 2  # a movement of 2 is the limit
    jumped, faded = (fed(RunningStatistics(limit), [1.0] * 30 + [9.0] * 3) for limit in (far, 0 * far))
    restarted, lingering = (s.moments[0, 0, 0] / (1 - s.prior_weight) for s in (jumped, faded))
    assert restarted > 5 > lingering
    assert jumped.prior_weight > 0.2
    drifted = fed(RunningStatistics(far), [1.0 + 0.05 * step for step in range(60)])
    assert drifted.prior_weight < 0.01


def test_no_change_is_detected_before_the_statistics_have_settled() -> None:
    statistics = fed(RunningStatistics(np.eye(1)[None]), [1.0] * (BEFORE + SETTLED - 2) + [9.0])
    assert statistics.shift() is None
    fed(statistics, [9.0])
    assert statistics.prior_weight > 0.3


def test_a_dead_channel_is_distinguished_from_a_quiet_one() -> None:
    extractor = TextureExtractor(CARD)
    quiet = window()
    quiet[:, 1] *= 1e-4
    assert np.isfinite(features_of(extractor, quiet)).all()
    quiet[:, 1] = 0
    features = features_of(extractor, quiet).reshape(2, -1)
    assert np.isfinite(features[0]).all()
    assert np.isnan(features[1]).all()


def test_reset_equals_new() -> None:
    used, new = TextureExtractor(CARD), TextureExtractor(CARD)
    features_of(used, window(1))
    used.reset()
    assert features_of(used, window()).tolist() == features_of(new, window()).tolist()


def test_a_card_without_a_fitting_prior_is_refused() -> None:
    for settings in ({}, {"prior": PRIOR.tolist()}, CARD.settings | {"change_metric": [[0.0]]}):
        with pytest.raises(ModelError, match="tiny: its settings cannot be used"):
            WindowDetector(Model(replace(CARD, settings=settings), session=None), sample_rate=48_000)


def test_a_prior_with_one_value_more_adds_the_unevenness_of_the_treble() -> None:
    plain = features_of(TextureExtractor(CARD), window()).reshape(2, 2, BAND_VALUES)
    prior = np.concatenate((PRIOR, PRIOR[..., :1]), axis=-1)
    metric = np.zeros((2, BAND_VALUES + 1, BAND_VALUES + 1))
    card = replace(CARD, settings={"prior": prior.tolist(), "change_metric": metric.tolist()})
    features = features_of(TextureExtractor(card), window()).reshape(2, 2, BAND_VALUES + 1)
    assert features[..., :-1] == pytest.approx(plain)
    assert (features[:, 0, -1] < -0.1).all()
