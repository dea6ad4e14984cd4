from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from tactophone.errors import ModelError
from tactophone.perception import Gate, Model, ModelCard, detector_for
from tactophone.perception.features.bands import VALUES
from tactophone.perception.features.texture import (
    BEFORE,
    FORGET_AFTER,
    PRIOR_WINDOWS,
    SETTLED,
    RunningStatistics,
    TextureExtractor,
)

PRIOR = np.stack([np.zeros((2, VALUES)), np.ones((2, VALUES))])
NEVER = np.zeros((2, VALUES, VALUES))
CARD = ModelCard(
    "ear",
    "texture",
    16_000,
    512,
    Fraction(160),
    2,
    Gate(-60.0, "banded"),
    settings={"prior": PRIOR.tolist(), "surprise": NEVER.tolist()},
)


def window(seed: int = 0) -> np.ndarray:
    return 0.1 * np.random.default_rng(seed).standard_normal((512, 2)).astype(np.float32)


def fed(memory: RunningStatistics, values: list[float], *, contact: bool = True) -> RunningStatistics:
    for value in values:
        memory.push(np.full(memory.moments.shape[1:], value, np.float32), contact=contact)
    return memory


def test_a_touch_begins_unsure_and_moves_at_once() -> None:
    memory = fed(RunningStatistics(np.zeros((1, 1, 1))), [1.0])
    assert memory.moments.ravel().tolist() == pytest.approx([1 / (1 + PRIOR_WINDOWS)] * 2)
    assert memory.left == pytest.approx(PRIOR_WINDOWS / (1 + PRIOR_WINDOWS))


def test_what_is_left_of_the_prior_makes_all_weights_sum_to_one() -> None:
    memory = RunningStatistics(np.zeros((1, 2, 2)))
    for number in range(30):
        fed(memory, [7.0], contact=number % 7 != 0)
        assert memory.moments[0] + memory.left * 7.0 == pytest.approx(np.full((1, 2), 7.0))


def test_a_stroke_that_turns_is_the_same_touch_and_one_that_ends_is_not() -> None:
    memory = fed(RunningStatistics(np.zeros((1, 1, 1))), [1.0])
    fed(memory, [9.0] * (FORGET_AFTER - 1), contact=False)
    assert memory.left < 1
    fed(memory, [9.0], contact=False)
    assert memory.left == 1
    assert not memory.moments.any()


def test_an_edge_begins_the_memory_anew_and_drift_does_not() -> None:
    far = np.eye(2)[None] / 2  # a movement of 2 is the limit
    jumped, faded = (fed(RunningStatistics(limit), [1.0] * 30 + [9.0] * 3) for limit in (far, 0 * far))
    believed, lingering = (one.moments[0, 0, 0] / (1 - one.left) for one in (jumped, faded))
    assert believed > 5 > lingering
    assert jumped.left > 0.2
    drifted = fed(RunningStatistics(far), [1.0 + 0.05 * step for step in range(60)])
    assert drifted.left < 0.01


def test_before_it_has_settled_nothing_surprises() -> None:
    memory = fed(RunningStatistics(np.eye(1)[None]), [1.0] * (BEFORE + SETTLED - 2) + [9.0])
    assert memory.moved() is None
    fed(memory, [9.0])
    assert memory.left > 0.3


def test_a_dead_channel_is_told_from_a_quiet_one() -> None:
    extractor = TextureExtractor(CARD)
    quiet = window()
    quiet[:, 1] *= 1e-4
    assert np.isfinite(extractor.push(quiet, contact=True)).all()
    quiet[:, 1] = 0
    features = extractor.push(quiet, contact=True).reshape(2, -1)
    assert np.isfinite(features[0]).all()
    assert np.isnan(features[1]).all()


def test_reset_equals_new() -> None:
    used, new = TextureExtractor(CARD), TextureExtractor(CARD)
    used.push(window(1), contact=True)
    used.reset()
    assert used.push(window(), contact=True).tolist() == new.push(window(), contact=True).tolist()


def test_a_card_without_a_fitting_prior_is_refused() -> None:
    for settings in ({}, {"prior": PRIOR.tolist()}, CARD.settings | {"surprise": [[0.0]]}):
        with pytest.raises(ModelError, match="ear: its settings cannot be used"):
            detector_for(Model(replace(CARD, settings=settings), session=None, content=b""), sample_rate=48_000)
