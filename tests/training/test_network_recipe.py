from dataclasses import replace
from pathlib import Path

import pytest

from tactophone import DatasetError, ModelError, Touch
from tactophone.dataset import Dataset, open_dataset
from tactophone.perception import Gate, read_model
from tactophone.training.network import PaperNetwork, weights_of
from tactophone.training.recipes import OPEN_GATE, NetworkSettings, network_settings
from tactophone.training.trainer import NetworkRecipe
from tests.dataset.folders import audiofolder

SETTINGS = replace(network_settings("fine-tuned"), hop=64, batch_size=64, epochs=1, least_steps=0)


def with_properties(dataset: Dataset, **properties: str) -> Dataset:
    changed = tuple(replace(take, properties={**take.properties, **properties}) for take in dataset.recordings)
    return replace(dataset, recordings=changed)


@pytest.mark.parametrize(
    ("settings", "gate", "expected"),
    [
        (network_settings("general"), None, Gate(-26.0)),
        (network_settings("general", reference_code=True), None, Gate(-46.02, "mean_absolute")),
        (network_settings("general"), OPEN_GATE, OPEN_GATE),
    ],
)
def test_the_gate_is_of_paper_or_reference_code(settings: NetworkSettings, gate: Gate | None, expected: Gate) -> None:
    assert NetworkRecipe(settings, gate=gate).effective_gate == expected


def test_the_card_names_sound_seed_and_licences(tmp_path: Path) -> None:
    dataset = with_properties(open_dataset(audiofolder(tmp_path / "stones")), licence="CC BY 4.0")
    NetworkRecipe(SETTINGS, seed=7).train(tmp_path / "a.onnx", dataset)
    card = read_model(tmp_path / "a.onnx").card
    assert (card.training["dataset"], card.training["seed"], card.training["surfaces"]) == ("stones", 7, 4)
    assert card.training["sha256"] == dataset.fingerprint
    assert card.licence == "weights alone, no recordings; trained on sound under: CC BY 4.0"
    assert card.scores == {}


def test_the_card_of_a_model_trained_on_simulated_sound_says_so(tmp_path: Path) -> None:
    dataset = with_properties(open_dataset(audiofolder(tmp_path / "stones")), source="simulated")
    NetworkRecipe(SETTINGS).write(tmp_path / "a.onnx", weights_of(PaperNetwork()), dataset)
    card = read_model(tmp_path / "a.onnx").card
    assert "simulated sound alone" in card.licence
    assert "untested" in card.scores["real sound"]


def test_training_does_not_continue_from_a_model_of_other_channels(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path / "stones"))
    mono = NetworkRecipe(replace(SETTINGS, channels=1))
    mono.write(tmp_path / "mono.onnx", weights_of(PaperNetwork(channels=1)), dataset)
    job = NetworkRecipe(SETTINGS, start=tmp_path / "mono.onnx")
    with pytest.raises(ModelError, match="has 1 channel"):
        job.fit(job.read_windows(dataset.recordings))


def test_recordings_of_one_class_make_no_new_model(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path / "stones")).where(lambda take: take.label is Touch.ROUGH)
    job = NetworkRecipe(SETTINGS)
    with pytest.raises(DatasetError, match="rough surfaces alone"):
        job.fit(job.read_windows(dataset.recordings))
