"""Writes the model file of a set-up: the shipped model's graph with the fitted correction in it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
from onnx import ModelProto, helper, numpy_helper

from tactophone.perception import NEVER_ABSTAIN, Gate, Model
from tactophone.training.model_export import write_graph
from tactophone.training.set_up import LARGEST, LOGIT_LIMIT, Correction, SetUpFit


def corrected(graph: ModelProto, correction: Correction) -> ModelProto:
    """Return the graph of a classifier of kind texture with a correction in place of its logit."""
    changed = ModelProto()
    changed.CopyFrom(graph)
    readers = [node for node in changed.graph.node if "logit" in node.input]
    tensors = {
        "own:centre": correction.centre, "own:scale": correction.scale, "own:weights": correction.weights[:, None],
        "own:slope": [correction.slope], "own:bias": [correction.bias],
        "own:most": LARGEST, "own:least": -LARGEST, "own:high": LOGIT_LIMIT, "own:low": -LOGIT_LIMIT,
    }  # fmt: skip
    nodes = [
        helper.make_node("Clip", ["logit", "own:low", "own:high"], ["own:bounded"]),
        helper.make_node("Mul", ["own:bounded", "own:slope"], ["own:scaled"]),
        # The features of a missing channel are this set-up's average, so that they add nothing.
        helper.make_node("Where", ["missing", "own:centre", "whole"], ["own:whole"]),
        helper.make_node("Sub", ["own:whole", "own:centre"], ["own:off"]),
        helper.make_node("Div", ["own:off", "own:scale"], ["own:wide"]),
        helper.make_node("Clip", ["own:wide", "own:least", "own:most"], ["own:standard"]),
        helper.make_node("MatMul", ["own:standard", "own:weights"], ["own:shift"]),
        helper.make_node("Add", ["own:scaled", "own:shift"], ["own:sum"]),
        helper.make_node("Add", ["own:sum", "own:bias"], ["own:logit"]),
    ]
    for reader in readers:
        reader.input[:] = ["own:logit" if name == "logit" else name for name in reader.input]
    # Nodes must stand in the order of their use.
    place = min(list(changed.graph.node).index(reader) for reader in readers)
    ordered = [*changed.graph.node[:place], *nodes, *changed.graph.node[place:]]
    del changed.graph.node[:]
    changed.graph.node.extend(ordered)
    stored = [numpy_helper.from_array(np.asarray(value, np.float32), name) for name, value in tensors.items()]
    changed.graph.initializer.extend(stored)
    onnx.checker.check_model(changed)
    return changed


def write_set_up(path: Path, start: Path, model: Model, fit: SetUpFit, *, threshold_dbfs: float, tip: str) -> None:
    """Write the model of a set-up: that of ``start``, with tip, contact threshold, boundary and scores changed."""
    card = model.card
    facts = {"from": card.name, "score": fit.score, "objects": [entry.name for entry in fit.left_out]}
    estimates = {entry.name: round(entry.after, 3) for entry in fit.left_out if not math.isnan(entry.after)}
    card = replace(
        card,
        name=path.stem,
        gate=Gate(round(threshold_dbfs, 2), card.gate.rule),
        decision=card.decision if fit.abstains else replace(card.decision, abstain_from=NEVER_ABSTAIN),
        settings={**card.settings, "tip": tip},
        training={**card.training, "set_up": facts},
        scores={"objects left out": estimates},
        licence="; ".join(filter(None, (card.licence, "fitted to recordings of the user's own"))),
    )
    write_graph(path, corrected(onnx.load(str(start)), fit.correction), card)
