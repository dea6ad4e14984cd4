"""The models inside the package: small, runnable by name, with cards that say what they were trained on."""

import numpy as np
import pytest

from tactophone.perception import (
    SUPPORTS_MISSING_CHANNEL,
    default_model,
    fallback_model,
    model_path,
    open_detector,
    read_model,
    shipped_models,
)
from tactophone.training.recipes import RECIPES, SHIPPED
from tactophone.types import AudioBlock, Touch
from tests.sounds import blocks

PAPERS = {"paper": 2, "paper-mono": 1}
ON_FEATURES = [name for name in SHIPPED if name not in PAPERS]
RATE = 48_000
REAL_SCORES = "real, lmt core (air microphone)"


def hiss(channels: int) -> np.ndarray:
    return 0.2 * np.random.default_rng(0).standard_normal((RATE, channels)).astype(np.float32)


def test_the_shipped_recipes_models_are_in_the_package_and_take_a_few_megabytes() -> None:
    assert set(shipped_models()) == {*PAPERS, *SHIPPED}
    assert sum(model_path(name).stat().st_size for name in shipped_models()) < 5_000_000


@pytest.mark.parametrize(("name", "channels"), PAPERS.items())
def test_each_card_of_the_network_has_the_papers_settings_and_its_scores(name: str, channels: int) -> None:
    card = read_model(model_path(name)).card
    assert default_model(channels) == name
    assert (card.name, card.channels, card.sample_rate, card.window_size) == (name, channels, 2000, 512)
    assert (card.gate.threshold_dbfs, card.gate.rule) == (-26.0, "rms")
    assert card.training["settings"]["labelling"]["loudness"] == "rms"
    assert "simulated sound alone" in card.licence
    accuracy, low, high = card.scores["simulated, held out"]["balanced_accuracy, two-class rule"]
    assert 0.6 < low <= accuracy <= high


@pytest.mark.parametrize("name", shipped_models())
def test_each_card_has_scores_on_held_out_sound(name: str) -> None:
    card = read_model(model_path(name)).card
    assert card.name == name
    assert "simulated sound alone" in card.licence
    assert "real sound" in card.scores
    assert "simulated, held out" in card.scores
    assert (REAL_SCORES in card.scores) == (card.channels == 1 or card.kind in SUPPORTS_MISSING_CHANNEL)


@pytest.mark.parametrize("name", ON_FEATURES)
def test_each_model_on_features_runs_by_name_on_one_and_on_two_channels(name: str) -> None:
    card = read_model(model_path(name)).card
    assert (card.kind, card.training["recipe"]) == (RECIPES[name].features, name)
    for channels in (1, 2):
        detector = open_detector(name, sample_rate=RATE)
        predictions = [each for block in blocks(hiss(channels), 4800) for each in detector.push(block)]
        assert {each.touch for each in predictions[30:]} <= {Touch.SMOOTH, Touch.ROUGH}
        assert not any(each.faulty for each in predictions)


def test_a_model_that_works_without_air_is_its_own_fallback() -> None:
    assert fallback_model("paper") == "paper-mono"
    assert fallback_model("texture") == "texture"


def test_impulses_uses_the_air_microphone_where_there_are_two() -> None:
    sound = hiss(2)
    alone, both = (open_detector("impulses", sample_rate=RATE) for _ in range(2))
    air = np.ascontiguousarray(sound[:, 1:])
    assert both.push(AudioBlock(sound, RATE)) == alone.push(AudioBlock(air, RATE))
