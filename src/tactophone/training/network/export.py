"""Model files of the paper's network: card, weights, facts about the training."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import onnx

from tactophone.dataset import Dataset
from tactophone.errors import ModelError
from tactophone.perception import Gate, ModelCard, read_model
from tactophone.training.model_export import write_graph
from tactophone.training.network.model import Weights, channels_of
from tactophone.training.network.onnx_graph import Storage, build_graph, read_graph
from tactophone.training.network.settings import NETWORK_HOP, NETWORK_RATE, NETWORK_WINDOW_SIZE, NetworkSettings
from tactophone.types import FloatArray


def make_card(weights: Weights, *, name: str, gate: Gate, licence: str = "") -> ModelCard:
    """Return the card of a network with these weights."""
    channels = channels_of(weights)
    return ModelCard(name, "paper", NETWORK_RATE, NETWORK_WINDOW_SIZE, NETWORK_HOP, channels, gate, licence=licence)


def training_facts(settings: NetworkSettings, *, seed: int, dataset: Dataset) -> dict[str, Any]:
    """Return what a card says of the training: settings, seed, data."""
    return {
        "recipe": settings.name,
        "settings": asdict(settings),
        "seed": seed,
        "dataset": dataset.name,
        "surfaces": len(dataset.surfaces),
        "sha256": dataset.fingerprint,
    }


def write_model(path: Path, card: ModelCard, weights: Weights, *, storage: Storage = "int8") -> None:
    """Write a network and its card; after a kill the file is the old one or the new one, never half."""
    write_graph(path, build_graph(weights, storage=storage), card)


def read_weights(path: Path) -> dict[str, FloatArray]:
    """Read the parameters of the paper's network from a model file, to continue training.

    Raises `ModelError` if the file holds no such network.
    """
    card = read_model(path).card
    if card.kind != "paper":
        raise ModelError(f"{path}: a model of kind {card.kind}, but training can continue from kind paper only")
    return read_graph(onnx.load(str(path)))
