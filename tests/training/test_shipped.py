"""The models inside the package: small, runnable by name, and honest about what they learnt from."""

import numpy as np
import pytest

from tactophone.perception import (
    SUPPORTS_MISSING_CHANNEL,
    default_model,
    model_path,
    open_detector,
    read_model,
    shipped_models,
)
from tactophone.perception.model_registry import spare_model
from tactophone.training.recipes import RECIPES
from tactophone.types import AudioBlock, Touch
from tests.sounds import blocks

PAPERS = {"paper": 2, "paper-mono": 1}
RATE = 48_000
HEARS_REAL = "real, lmt core (air microphone)"


def hiss(channels: int) -> np.ndarray:
    return 0.2 * np.random.default_rng(0).standard_normal((RATE, channels)).astype(np.float32)


def test_the_papers_models_and_every_way_ship_and_take_a_few_megabytes() -> None:
    assert set(shipped_models()) == {*PAPERS, *RECIPES}
    assert sum(model_path(name).stat().st_size for name in shipped_models()) < 5_000_000


@pytest.mark.parametrize(("name", "channels"), PAPERS.items())
def test_each_card_tells_the_papers_settings_and_its_scores(name: str, channels: int) -> None:
    card = read_model(model_path(name)).card
    assert default_model(channels) == name
    assert (card.name, card.channels, card.sample_rate, card.window_size) == (name, channels, 2000, 512)
    assert (card.gate.threshold_dbfs, card.gate.rule) == (-26.0, "rms")
    assert card.training["settings"]["labelling"]["loudness"] == "rms"
    assert "simulated sound alone" in card.licence
    told = card.scores["simulated, held out"]
    accuracy, low, high = told["balanced_accuracy, two-class rule"]
    assert 0.6 < low <= accuracy <= high


@pytest.mark.parametrize("name", shipped_models())
def test_each_card_tells_how_it_does_on_sound_that_it_never_met(name: str) -> None:
    card = read_model(model_path(name)).card
    assert card.name == name
    assert "simulated sound alone" in card.licence
    assert "real sound" in card.scores
    assert "simulated, held out" in card.scores
    assert (HEARS_REAL in card.scores) == (card.channels == 1 or card.kind in SUPPORTS_MISSING_CHANNEL)


@pytest.mark.parametrize("name", RECIPES)
def test_each_way_is_felt_by_name_on_one_and_on_two_channels(name: str) -> None:
    kind = read_model(model_path(name)).card.kind
    assert kind == RECIPES[name].kind
    for channels in (1, 2) if kind in SUPPORTS_MISSING_CHANNEL else (2,):
        judge = open_detector(name, sample_rate=RATE)
        told = [one for block in blocks(hiss(channels), 4800) for one in judge.push(block)]
        assert {one.touch for one in told[30:]} <= {Touch.SMOOTH, Touch.ROUGH}
        assert not any(one.faulty for one in told)


def test_a_model_that_has_learnt_to_do_without_air_stands_by_for_itself() -> None:
    assert spare_model("paper") == "paper-mono"
    assert spare_model("ours") == "ours"
    assert spare_model("scalogram-cnn") is None


def test_impulses_hears_the_air_microphone_where_there_are_two() -> None:
    sound = hiss(2)
    alone, both = (open_detector("impulses", sample_rate=RATE) for _ in range(2))
    air = np.ascontiguousarray(sound[:, 1:])
    assert both.push(AudioBlock(sound, RATE)) == alone.push(AudioBlock(air, RATE))
