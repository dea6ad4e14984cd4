from dataclasses import replace
from pathlib import Path

import pytest

from tactophone import ModelError
from tactophone.dataset import Dataset, open_dataset
from tactophone.perception import Gate, read_model
from tactophone.training.network.model import PaperNetwork, weights_of
from tactophone.training.network.recipe import Recipe, paper
from tactophone.training.network.training_job import OPEN_GATE, TrainingJob, find_windows, learn, write_trained
from tests.dataset.folders import audiofolder

RECIPE = replace(paper("fine-tuned"), hop=64, batch_size=64, epochs=1, least_steps=0)


def told_of(dataset: Dataset, **properties: str) -> Dataset:
    changed = tuple(replace(one, properties={**one.properties, **properties}) for one in dataset.recordings)
    return replace(dataset, recordings=changed)


@pytest.mark.parametrize(
    ("recipe", "gate", "wanted"),
    [
        (paper("general"), None, Gate(-26.0)),
        (paper("general", following="authors"), None, Gate(-46.02, "mean_absolute")),
        (paper("general"), OPEN_GATE, OPEN_GATE),
    ],
)
def test_a_model_has_the_gate_of_those_it_follows(recipe: Recipe, gate: Gate | None, wanted: Gate) -> None:
    assert TrainingJob(recipe, gate=gate).effective_gate == wanted


def test_the_card_names_sound_seed_and_licences(tmp_path: Path) -> None:
    dataset = told_of(open_dataset(audiofolder(tmp_path / "stones")), licence="CC BY 4.0")
    course = TrainingJob(RECIPE, seed=7)
    write_trained(tmp_path / "a.onnx", course, learn(course, find_windows(course, dataset.recordings)), dataset=dataset)
    card = read_model(tmp_path / "a.onnx").card
    assert (card.training["dataset"], card.training["seed"], card.training["surfaces"]) == ("stones", 7, 4)
    assert card.training["sha256"] == dataset.fingerprint
    assert card.licence == "trained on sound under: CC BY 4.0"
    assert card.scores == {}


def test_a_model_that_heard_simulated_sound_alone_says_so(tmp_path: Path) -> None:
    dataset = told_of(open_dataset(audiofolder(tmp_path / "stones")), source="simulated")
    write_trained(tmp_path / "a.onnx", TrainingJob(RECIPE), weights_of(PaperNetwork()), dataset=dataset)
    card = read_model(tmp_path / "a.onnx").card
    assert "simulated sound alone" in card.licence
    assert "untested" in card.scores["real sound"]


def test_a_model_of_other_channels_is_no_start(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path / "stones"))
    mono = TrainingJob(replace(RECIPE, channels=1))
    write_trained(tmp_path / "mono.onnx", mono, weights_of(PaperNetwork(channels=1)), dataset=dataset)
    course = TrainingJob(RECIPE, start=tmp_path / "mono.onnx")
    with pytest.raises(ModelError, match="hears 1 channel"):
        learn(course, find_windows(course, dataset.recordings))
