from dataclasses import replace
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
import torch

from tactophone import AudioBlock, ModelError
from tactophone.core.types import FloatArray
from tactophone.signal.perception.model_file import FEATURES, Gate, read_model
from tactophone.signal.perception.window_detector import WindowDetector
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.training.onnx_export import (
    Storage,
    add_scores,
    build_graph,
    make_card,
    read_graph,
    read_weights,
    write_model,
)
from tactophone_lab.training.paper_network import PaperNetwork, magnitudes, weights_of
from tactophone_lab.training.recipe_options import network_settings
from tactophone_lab.training.trainer import NetworkRecipe
from tests.folders import audiofolder

GATE = Gate(-60.0)


@pytest.mark.parametrize("channels", [1, 2])
def test_the_live_side_runs_what_was_written_and_agrees_with_torch(
    tmp_path: Path, channels: int
) -> None:
    network = PaperNetwork(channels=channels)
    weights = weights_of(network)
    write_model(
        tmp_path / "a.onnx",
        make_card(weights, name="a", gate=GATE),
        weights,
        storage="float32",
    )
    detector = WindowDetector(read_model(tmp_path / "a.onnx"), sample_rate=2000)
    sound = np.random.default_rng(0).normal(0, 0.1, (512, channels)).astype(np.float32)
    (prediction,) = detector.push(AudioBlock(sound, 2000))
    expected = network(magnitudes(torch.from_numpy(sound)[None])).exp()[0].tolist()
    assert prediction.probabilities == pytest.approx(expected, abs=1e-5)


def test_the_card_holds_the_papers_settings(tmp_path: Path) -> None:
    weights = weights_of(PaperNetwork())
    card = make_card(weights, name="a", gate=GATE, licence="BSD-3-Clause")
    dataset = open_dataset(audiofolder(tmp_path / "stones"))
    NetworkRecipe(network_settings("general"), seed=3).write(
        tmp_path / "facts.onnx", weights, dataset
    )
    facts = read_model(tmp_path / "facts.onnx").card.training
    write_model(tmp_path / "a.onnx", replace(card, training=facts), weights)
    read = read_model(tmp_path / "a.onnx").card
    assert (read.sample_rate, read.window_size, float(read.hop / read.sample_rate)) == (
        2000,
        512,
        512 / 48_000,
    )
    assert (read.channels, read.gate, read.licence) == (2, GATE, "BSD-3-Clause")
    assert (
        read.training["recipe"],
        read.training["dataset"],
        read.training["sha256"],
    ) == (
        "paper/general",
        "stones",
        dataset.fingerprint,
    )


def test_scores_are_added_beside_others_and_the_network_stays(tmp_path: Path) -> None:
    weights = weights_of(PaperNetwork(channels=1))
    path = tmp_path / "a.onnx"
    write_model(path, make_card(weights, name="a", gate=GATE), weights)
    before = read_weights(path)
    add_scores(path, "lmt", {"balanced_accuracy": 0.8})
    add_scores(path, "stones", {"balanced_accuracy": 0.9})
    assert read_model(path).card.scores == {
        "lmt": {"balanced_accuracy": 0.8},
        "stones": {"balanced_accuracy": 0.9},
    }
    assert all(
        np.array_equal(before[name], array)
        for name, array in read_weights(path).items()
    )
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.onnx"]


def test_training_continues_only_from_the_papers_network(tmp_path: Path) -> None:
    weights = weights_of(PaperNetwork(channels=1))
    other = replace(make_card(weights, name="a", gate=GATE), kind="bands")
    write_model(tmp_path / "a.onnx", other, weights)
    with pytest.raises(ModelError, match="a model of kind bands"):
        read_weights(tmp_path / "a.onnx")


def test_the_folder_of_a_model_is_made(tmp_path: Path) -> None:
    weights = weights_of(PaperNetwork(channels=1))
    path = tmp_path / "models" / "a.onnx"
    write_model(path, make_card(weights, name="a", gate=GATE), weights)
    assert read_model(path).card.name == "a"


def spectra(channels: int, count: int = 20) -> FloatArray:
    """Features of the size that real windows have: most bins small, a few large."""
    return (
        np.random.default_rng(0).exponential(1.0, (count, 257 * channels)) ** 2
    ).astype(np.float32)


def run(model: bytes, features: FloatArray) -> FloatArray:
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    return np.concatenate(
        [session.run(None, {FEATURES: row[None]})[0] for row in features]
    )


@pytest.mark.parametrize("channels", [1, 2])
def test_onnx_agrees_with_torch(channels: int) -> None:
    network = PaperNetwork(channels=channels)
    features = spectra(channels)
    expected = network(torch.from_numpy(features)).detach().numpy()
    model = build_graph(weights_of(network), storage="float32").SerializeToString()
    assert run(model, features) == pytest.approx(expected, abs=1e-5)


def test_eight_bits_cost_a_quarter_and_almost_nothing_in_probability() -> None:
    network = PaperNetwork()
    features = spectra(2)
    expected = network(torch.from_numpy(features)).detach().exp().numpy()
    model = build_graph(weights_of(network), storage="int8").SerializeToString()
    assert len(model) < 2_000_000
    assert np.exp(run(model, features)) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("storage", "tolerance"), [("float32", 0.0), ("int8", 1 / 127)]
)
def test_weights_are_read_back(storage: Storage, tolerance: float) -> None:
    weights = weights_of(PaperNetwork(channels=1))
    read = read_graph(build_graph(weights, storage=storage))
    assert read.keys() == weights.keys()
    for name, array in weights.items():
        assert np.abs(read[name] - array).max() <= tolerance * np.abs(array).max()


def test_a_row_of_zeros_is_stored_as_zeros() -> None:
    weights = weights_of(PaperNetwork(channels=1))
    weights["layer1.weight"][0] = 0
    assert not read_graph(build_graph(weights, storage="int8"))["layer1.weight"][
        0
    ].any()
