"""Writes heads as ONNX graphs: features in, log-probabilities of none, smooth and rough out.

A channel whose features are NaN is missing; the regression of those that are left answers. *None* stands for sound
unlike any the head knows.
"""

from collections.abc import Mapping

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, helper, numpy_helper

from tactophone.perception.model_file import FEATURES, LOG_PROBABILITIES
from tactophone.training.features.linear_classifier import Head
from tactophone.training.network.onnx_graph import IR_VERSION, OPSET

STEEPNESS = 10.0
"""How fast sound becomes unknown around the limit: half known at it, 1 % at 1.5 times the limit."""


def build_head_graph(head: Head, *, channels: int) -> onnx.ModelProto:
    """Build the graph of our own detector's head."""
    count, sets = len(head.centre), len(head.biases)
    # Logits and whitened features are one product: standardising first is folded into its weights.
    whitening = head.whitening * np.sqrt(STEEPNESS / head.limit / count)
    weights = np.hstack((head.weights.T, whitening)) / head.scale[:, None]
    tensors = {
        "centre": head.centre,
        "weights": weights,
        "biases": np.concatenate((head.biases, np.zeros(count))) - head.centre @ weights,
        "sizes": np.array([sets, count]),
        "firsts": np.arange(channels) * (count // channels),
        **_choosing(channels),
        "steepness": np.array(STEEPNESS),
        "one": np.array([1]),
    }
    nodes = [
        helper.make_node("IsNaN", [FEATURES], ["missing"]),
        helper.make_node("Where", ["missing", "centre", FEATURES], ["whole"]),
        helper.make_node("Gemm", ["whole", "weights", "biases"], ["product"]),
        helper.make_node("Split", ["product", "sizes"], ["logits", "white"], axis=1),
        helper.make_node("Gather", ["missing", "firsts"], ["missing:channels"], axis=1),
        helper.make_node("Cast", ["missing:channels"], ["gone"], to=TensorProto.FLOAT),
        helper.make_node("Gemm", ["gone", "voices", "voices:whole"], ["vote"]),
        helper.make_node("Relu", ["vote"], ["choice"]),
        helper.make_node("Mul", ["logits", "choice"], ["logits:chosen"]),
        helper.make_node("ReduceSum", ["logits:chosen", "one"], ["logit"], keepdims=1),
        helper.make_node("ReduceSumSquare", ["white"], ["distance"], axes=[1], keepdims=1),
        helper.make_node("MatMul", ["choice", "shares"], ["share"]),
        helper.make_node("Mul", ["distance", "share"], ["distance:alive"]),
        helper.make_node("Sub", ["distance:alive", "steepness"], ["unknown"]),
        *answer_nodes(logit="logit", unknown="unknown"),
    ]
    return build(nodes, tensors, features=count)


def answer_nodes(*, logit: str, unknown: str) -> list[NodeProto]:
    """Turn two logits, rough against smooth (l) and unknown against known (u), into log-probabilities.

    None, smooth and rough are as (1 + e^l) e^u to 1 to e^l: their logarithms, less that of their sum, are the answer.
    """
    return [
        helper.make_node("Softplus", [logit], ["softly"]),
        helper.make_node("Add", [unknown, "softly"], ["none"]),
        helper.make_node("Sub", [logit, logit], ["level"]),
        helper.make_node("Concat", ["none", "level", logit], ["answers"], axis=1),
        helper.make_node("LogSoftmax", ["answers"], [LOG_PROBABILITIES], axis=1),
    ]


def build(nodes: list[NodeProto], tensors: Mapping[str, NDArray[np.generic]], *, features: int) -> onnx.ModelProto:
    """Make a checked model of nodes and those constants that they use; integers stay so, the rest is float32."""
    used = {name for node in nodes for name in node.input}
    graph = helper.make_graph(
        nodes,
        "head",
        [helper.make_tensor_value_info(FEATURES, TensorProto.FLOAT, ["windows", features])],
        [helper.make_tensor_value_info(LOG_PROBABILITIES, TensorProto.FLOAT, ["windows", 3])],
        [numpy_helper.from_array(_stored(value), name) for name, value in tensors.items() if name in used],
    )
    imports = [helper.make_opsetid("", OPSET), helper.make_opsetid("ai.onnx.ml", 3)]
    model = helper.make_model(graph, opset_imports=imports, ir_version=IR_VERSION)
    onnx.checker.check_model(model)
    return model


def _stored(value: NDArray[np.generic]) -> NDArray[np.generic]:
    return value if np.issubdtype(value.dtype, np.integer) else value.astype(np.float32)


def _choosing(channels: int) -> dict[str, NDArray[np.float64]]:
    """Which regression answers, from which channels are gone: with votes under 0 cut off, a 1 for it and 0 for others.

    ``shares`` is by what its share of all channels makes a distance larger; with no channel left nothing answers.
    """
    if channels == 1:
        return {"voices": np.array([[-1.0]]), "voices:whole": np.ones(1), "shares": np.ones((1, 1))}
    alone = 1 - 2 * np.eye(2)
    voices = np.hstack((np.full((2, 1), -1.0), alone))
    return {"voices": voices, "voices:whole": np.array([1.0, 0, 0]), "shares": np.array([[1.0], [2], [2]])}
