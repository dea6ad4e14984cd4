"""Model files: what was trained, with its card, in the one ONNX file that the live side reads."""

import os
from collections.abc import Mapping
from dataclasses import asdict, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import onnx

from tactophone.errors import ModelError
from tactophone.perception import DecisionRule, Gate, ModelCard, read_model
from tactophone.perception.model_file import CARD_KEY
from tactophone.training.network.model import Weights, channels_of
from tactophone.training.network.onnx_graph import Storage, build_graph, read_graph
from tactophone.training.network.recipe import Recipe
from tactophone.training.network.windows import SIZE
from tactophone.training.sound import RATE
from tactophone.types import FloatArray

HOP = Fraction(512 * RATE, 48_000)
"""Samples from one take_predictions to the next: the paper judges at every sound buffer, 512 samples at 48 kHz."""

AUTHORS_GATE = Gate(-46.02, "mean_absolute")
"""0.005, over which the authors' code takes a window for contact when it scores."""


def make_card(weights: Weights, *, name: str, gate: Gate, licence: str = "") -> ModelCard:
    """Describe a network of the paper's kind."""
    return ModelCard(name, "paper", RATE, SIZE, HOP, channels_of(weights), gate, licence=licence)


def training_facts(recipe: Recipe, *, seed: int, dataset: str, fingerprint: str, surfaces: int) -> dict[str, Any]:
    """Tell, for the card, what a model was trained on and how."""
    return {
        "recipe": recipe.name,
        "settings": asdict(recipe),
        "seed": seed,
        "dataset": dataset,
        "surfaces": surfaces,
        "sha256": fingerprint,
    }


def write_model(path: Path, card: ModelCard, weights: Weights, *, storage: Storage = "int8") -> None:
    """Write a network and its card; a kill leaves the old file or the new, never half."""
    write_graph(path, build_graph(weights, storage=storage), card)


def read_weights(path: Path) -> dict[str, FloatArray]:
    """Take the parameters out of a model file of the paper's kind, to train on from there.

    Raises
    ------
    ModelError
        If the file is no such model.
    """
    card = read_model(path).card
    if card.kind != "paper":
        raise ModelError(f"{path}: a model of kind {card.kind}, but training goes on from kind paper alone")
    return read_graph(onnx.load(str(path)))


def add_scores(path: Path, name: str, scores: Mapping[str, Any]) -> None:
    """Write scores into a model file's card, beside or over those of that name."""
    card = read_model(path).card
    write_graph(path, onnx.load(str(path)), replace(card, scores={**card.scores, name: dict(scores)}))


def set_decision(path: Path, rule: DecisionRule, scores: Mapping[str, Any], *, out: Path) -> None:
    """Write a model file again with another decision rule, and what it does on validation data, in its card."""
    card = read_model(path).card
    told = {**card.scores, "operating point": dict(scores)}
    write_graph(out, onnx.load(str(path)), replace(card, decision=rule, scores=told))


def write_graph(path: Path, model: onnx.ModelProto, card: ModelCard) -> None:
    """Write any graph with its card; a kill leaves the old file or the new, never half."""
    onnx.helper.set_model_props(model, {CARD_KEY: card.to_json()})
    partial = path.with_name(f"{path.name}.{os.getpid()}.part")
    onnx.save(model, str(partial))
    os.replace(partial, path)
