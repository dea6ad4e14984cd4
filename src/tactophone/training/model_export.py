"""Writes ONNX model files with their cards, and changes the cards of existing ones. Needs no torch."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import onnx

from tactophone.perception import CARD_KEY, DecisionRule, ModelCard, read_model
from tactophone.processes import atomic_write

OPSET, IR_VERSION = 17, 9
"""Of 2022: every ONNX Runtime that the package admits can read them."""


def write_graph(path: Path, model: onnx.ModelProto, card: ModelCard) -> None:
    """Write a graph with its card, and the folder if needed; after a kill the file is the old or the new one."""
    onnx.helper.set_model_props(model, {CARD_KEY: card.to_json()})
    with atomic_write(path) as unfinished:
        onnx.save(model, str(unfinished))


def add_scores(path: Path, name: str, scores: Mapping[str, Any]) -> None:
    """Write scores into a model file's card under a name; scores of the same name are replaced."""
    card = read_model(path).card
    write_graph(path, onnx.load(str(path)), replace(card, scores={**card.scores, name: dict(scores)}))


def set_decision(path: Path, rule: DecisionRule, scores: Mapping[str, Any], *, out: Path) -> None:
    """Write a model file again with another decision rule; its scores go into the card as ``operating point``."""
    card = read_model(path).card
    scores = {**card.scores, "operating point": dict(scores)}
    write_graph(out, onnx.load(str(path)), replace(card, decision=rule, scores=scores))
