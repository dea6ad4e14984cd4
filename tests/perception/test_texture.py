from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from tactophone.errors import ModelError
from tactophone.perception import Gate, Model, ModelCard, detector_for
from tactophone.perception.bands import VALUES
from tactophone.perception.texture import FORGET_AFTER, PRIOR_WINDOWS, Memory, TextureExtractor

PRIOR = np.stack([np.zeros((2, VALUES)), np.ones((2, VALUES))])
CARD = ModelCard(
    "ear", "texture", 16_000, 512, Fraction(160), 2, Gate(-60.0, "banded"), settings={"prior": PRIOR.tolist()}
)


def window(seed: int = 0) -> np.ndarray:
    return 0.1 * np.random.default_rng(seed).standard_normal((512, 2)).astype(np.float32)


def test_a_touch_begins_unsure_and_moves_at_once() -> None:
    memory = Memory(np.array([[0.0], [1.0]]))
    memory.push(np.array([1.0]), contact=True)
    assert memory.mean.tolist() == pytest.approx([1 / (1 + PRIOR_WINDOWS)])
    assert memory.left == pytest.approx(PRIOR_WINDOWS / (1 + PRIOR_WINDOWS))


def test_what_is_left_of_the_prior_is_known_exactly() -> None:
    rng = np.random.default_rng(0)
    prior = rng.standard_normal((2, 3))
    with_prior, without = Memory(prior), Memory(np.zeros((2, 3)))
    for number in range(30):
        description, contact = rng.standard_normal(3), number % 7 != 0
        with_prior.push(description, contact=contact)
        without.push(description, contact=contact)
    assert with_prior.mean == pytest.approx(without.mean + without.left * prior[0])
    assert with_prior.square == pytest.approx(without.square + without.left * prior[1])


def test_a_stroke_that_turns_is_the_same_touch_and_one_that_ends_is_not() -> None:
    memory = Memory(np.array([[0.0], [0.0]]))
    memory.push(np.array([1.0]), contact=True)
    for _ in range(FORGET_AFTER - 1):
        memory.push(np.array([9.0]), contact=False)
    assert memory.mean[0] > 0
    memory.push(np.array([9.0]), contact=False)
    assert memory.mean[0] == 0


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
    for settings in ({}, {"prior": [[0.0]]}):
        with pytest.raises(ModelError, match="ear: its settings cannot be used"):
            detector_for(Model(replace(CARD, settings=settings), session=None, content=b""), sample_rate=48_000)
