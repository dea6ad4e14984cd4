"""The models inside the package: small, runnable by name, with cards that say what they
were trained on."""

import numpy as np
import pytest

from tactophone.core.tips import TIP_NAMES, TIPS
from tactophone.core.types import AudioBlock, Touch
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import (
    default_model,
    model_path,
    open_touch_detector,
    shipped_models,
    tip_mismatch,
)
from tactophone_lab.training.recipes import RECIPES
from tests.sounds import blocks

PAPERS = {"paper": 2, "paper-mono": 1}
ON_FEATURES = sorted({tip.model for tip in TIPS.values()})
RATE = 48_000


def hiss(channels: int) -> np.ndarray:
    return 0.2 * np.random.default_rng(0).standard_normal((RATE, channels)).astype(
        np.float32
    )


def test_the_shipped_recipes_models_are_in_the_package_and_take_a_few_megabytes() -> (
    None
):
    assert set(shipped_models()) == {
        *PAPERS,
        *(name for name, recipe in RECIPES.items() if recipe.shipped),
        *ON_FEATURES,
    }
    assert sum(model_path(name).stat().st_size for name in shipped_models()) < 6_500_000
    assert max(model_path(name).stat().st_size for name in ON_FEATURES) < 1_500_000


@pytest.mark.parametrize(("name", "channels"), PAPERS.items())
def test_each_card_of_the_network_has_the_papers_settings_and_its_scores(
    name: str, channels: int
) -> None:
    card = read_model(model_path(name)).card
    assert (card.name, card.channels, card.sample_rate, card.window_size) == (
        name,
        channels,
        2000,
        512,
    )
    assert (card.gate.threshold_dbfs, card.gate.rule) == (-26.0, "rms")
    assert card.training["settings"]["labelling"]["loudness"] == "rms"
    assert "simulated sound alone" in card.licence
    (accuracy,) = card.scores["simulated, held out"][
        "balanced_accuracy, two-class rule"
    ]
    assert (
        card.scores["simulated, held out"]["surfaces"] == 10
    )  # four of them smooth, too few for an interval
    assert accuracy > 0.7


@pytest.mark.parametrize("name", shipped_models())
def test_each_card_has_scores_on_held_out_sound(name: str) -> None:
    card = read_model(model_path(name)).card
    assert card.name == name
    assert ("simulated sound alone" in card.licence) == (name != "stylus")
    assert ("real sound" in card.scores) == (name != "stylus")
    assert "simulated, held out" in card.scores


@pytest.mark.slow
@pytest.mark.parametrize("name", ON_FEATURES)
def test_each_model_on_features_runs_by_name_on_one_and_on_two_channels(
    name: str,
) -> None:
    card = read_model(model_path(name)).card
    assert (card.kind, card.training["recipe"]) == ("texture", "texture")
    assert TIPS[card.tip].model == name
    assert card.settings["memory"] == (0.12 if card.tip == "pad" else 0.25)
    assert card.decision == RECIPES["texture"].response_for(card.tip).decision
    for channels in (1, 2):
        detector = open_touch_detector(name, sample_rate=RATE)
        predictions = [
            each
            for block in blocks(hiss(channels), 4800)
            for each in detector.push(block)
        ]
        assert {each.touch for each in predictions[30:]} <= {Touch.SMOOTH, Touch.ROUGH}
        assert not any(each.faulty for each in predictions)


def test_the_stylus_uses_the_air_microphone_where_there_are_two() -> None:
    sound = hiss(2)
    alone, both = (
        open_touch_detector("stylus", sample_rate=RATE, contact="window")
        for _ in range(2)
    )
    air = np.ascontiguousarray(sound[:, 1:])
    assert both.push(AudioBlock(sound, RATE)) == alone.push(AudioBlock(air, RATE))


def test_the_card_of_the_stylus_names_the_sources_and_their_terms() -> None:
    licence = read_model(model_path("stylus")).card.licence
    for words in ("LMT", "Strese", "no recordings", "simulated"):
        assert words in licence


@pytest.mark.parametrize("tip", TIP_NAMES)
def test_each_tip_has_its_model_and_a_mismatch_is_reported(tip: str) -> None:
    assert default_model(tip) == TIPS[tip].model
    texture, stylus = (
        read_model(model_path(name)).card for name in ("texture", "stylus")
    )
    assert bool(tip_mismatch(texture, tip)) == (tip != "pad")
    assert bool(tip_mismatch(stylus, tip)) == (tip != "stylus")
    assert "give --tip pad if that touches, or else use --model stylus" in tip_mismatch(
        texture, "stylus"
    )
    assert "use --model rubber" in tip_mismatch(texture, "rubber")
    assert "train one" in tip_mismatch(texture, "glass")
