"""Models so small that their output is known beforehand."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnx.utils
import onnxruntime
from onnx import TensorProto, helper, numpy_helper

from tactophone.signal.perception.model_file import (
    CARD_KEY,
    FEATURES,
    LOG_PROBABILITIES,
    Gate,
    ModelCard,
)
from tactophone_lab.training.onnx_export import (
    BLOCKED_IR_VERSION,
    BLOCKED_OPSET,
    join,
    magnitudes,
)

CARD = ModelCard(
    name="tiny",
    kind="paper",
    sample_rate=2000,
    window_size=512,
    hop=Fraction(64, 3),
    channels=1,
    gate=Gate(threshold_dbfs=-40.0),
)
BINS = 257
ROUGH_BIN = 51
"""From this bin on, over 200 Hz, level counts as rough for the tiny network."""


def write_tiny_model(path: Path, *, gain: float = 1.0, **changes: object) -> Path:
    """Write a linear network that compares the sound over and under 200 Hz; changes go
    into its card.

    With a gain of infinity or NaN its outputs are not probabilities.
    """
    card = replace(CARD, **changes)
    weights = np.zeros((BINS * card.channels, 3), np.float32)
    weights[1:ROUGH_BIN, 1] = gain
    weights[ROUGH_BIN:BINS, 2] = gain
    graph = helper.make_graph(
        [
            helper.make_node("MatMul", [FEATURES, "weights"], ["scores"]),
            helper.make_node("LogSoftmax", ["scores"], [LOG_PROBABILITIES], axis=1),
        ],
        "tiny",
        [helper.make_tensor_value_info(FEATURES, TensorProto.FLOAT, [1, len(weights)])],
        [helper.make_tensor_value_info(LOG_PROBABILITIES, TensorProto.FLOAT, [1, 3])],
        [numpy_helper.from_array(weights, "weights")],
    )
    classifier = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", BLOCKED_OPSET)],
        ir_version=BLOCKED_IR_VERSION,
    )
    model = join(magnitudes(card.channels), classifier)
    helper.set_model_props(model, {CARD_KEY: card.to_json()})
    onnx.save(model, str(path))
    return path


def classifier(path: Path) -> Any:
    """Open what follows the features in a model file: a session from features to
    log-probabilities."""
    graph = onnx.utils.Extractor(onnx.load(str(path))).extract_model(
        [FEATURES], [LOG_PROBABILITIES]
    )
    return onnxruntime.InferenceSession(
        graph.SerializeToString(), providers=["CPUExecutionProvider"]
    )
