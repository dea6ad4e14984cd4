"""Writes classifiers as ONNX graphs: features in, log-probabilities of none, smooth and rough out.

A channel whose features are NaN is missing; the regression of the remaining channels is used. *None* stands for sound
unlike the training data.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, helper, numpy_helper

from tactophone.perception import FEATURES, LOG_PROBABILITIES
from tactophone.training.features.examples import Floats
from tactophone.training.model_export import IR_VERSION, OPSET

if TYPE_CHECKING:
    from tactophone.training.features.linear_classifier import LinearClassifier

STEEPNESS = 10.0
"""How fast sound becomes unknown around the limit: half known at it, 1 % at 1.5 times the limit."""

KNOWN = -20.0
"""Logit of *unknown* for classifiers that never abstain."""


def build_classifier_graph(classifier: "LinearClassifier", *, channels: int) -> onnx.ModelProto:
    """Build the graph of the recipe ``texture``'s classifier."""
    count, sets = len(classifier.centre), len(classifier.biases)
    # Logits and whitened features are one matrix product; standardising is folded into its weights.
    whitening = classifier.whitening * np.sqrt(STEEPNESS / classifier.limit / count)
    weights = np.hstack((classifier.weights.T, whitening)) / classifier.scale[:, None]
    tensors = {
        "centre": classifier.centre,
        "weights": weights,
        "biases": np.concatenate((classifier.biases, np.zeros(count))) - classifier.centre @ weights,
        "sizes": np.array([sets, count]),
        "firsts": np.arange(channels) * (count // channels),
        **_selection(channels),
        "steepness": np.array(STEEPNESS),
        "one": np.array([1]),
    }
    nodes = [
        *fill_missing("centre"),
        helper.make_node("Gemm", ["whole", "weights", "biases"], ["product"]),
        helper.make_node("Split", ["product", "sizes"], ["logits", "white"], axis=1),
        # A channel's first feature shows whether the channel is missing.
        helper.make_node("Gather", ["missing", "firsts"], ["missing:channels"], axis=1),
        helper.make_node("Cast", ["missing:channels"], ["gone"], to=TensorProto.FLOAT),
        helper.make_node("Gemm", ["gone", "votes", "votes:whole"], ["vote"]),
        helper.make_node("Relu", ["vote"], ["choice"]),
        helper.make_node("Mul", ["logits", "choice"], ["logits:chosen"]),
        helper.make_node("ReduceSum", ["logits:chosen", "one"], ["logit"], keepdims=1),
        helper.make_node("ReduceSumSquare", ["white"], ["distance"], axes=[1], keepdims=1),
        helper.make_node("MatMul", ["choice", "shares"], ["share"]),
        helper.make_node("Mul", ["distance", "share"], ["distance:working"]),
        helper.make_node("Sub", ["distance:working", "steepness"], ["unknown"]),
        *output_nodes(logit="logit", unknown="unknown"),
    ]
    return build(nodes, tensors, features=count)


def build_linear(centre: Floats, weights: Floats, bias: float) -> onnx.ModelProto:
    """Build the graph of a linear classifier, ``bias + (features - centre) @ weights``, that never abstains."""
    nodes = [
        *fill_missing("centre"),
        helper.make_node("Sub", ["whole", "centre"], ["off"]),
        helper.make_node("MatMul", ["off", "weights"], ["weighted"]),
        helper.make_node("Add", ["weighted", "bias"], ["logit"]),
    ]
    tensors = {"centre": centre, "weights": weights[:, None], "bias": np.array([bias])}
    return build_known(nodes, tensors, features=len(centre))


def build_known(
    nodes: Sequence[NodeProto], tensors: Mapping[str, NDArray[np.generic]], *, features: int
) -> onnx.ModelProto:
    """Build the graph of a classifier that never abstains, from nodes that end in ``logit``, rough against smooth."""
    constants = {"zero": np.zeros(1), "known": np.array([KNOWN]), "one": np.array([1])}
    unknown = [
        # Of the logit's shape, and constant.
        helper.make_node("Mul", ["logit", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "known"], ["unknown"]),
    ]
    nodes = [*nodes, *unknown, *output_nodes(logit="logit", unknown="unknown")]
    return build(nodes, {**constants, **tensors}, features=features)


def fill_missing(centre: str) -> list[NodeProto]:
    """Replace missing features by their average; the result is ``whole``, and ``missing`` the mask."""
    return [
        helper.make_node("IsNaN", [FEATURES], ["missing"]),
        helper.make_node("Where", ["missing", centre, FEATURES], ["whole"]),
    ]


def output_nodes(*, logit: str, unknown: str) -> list[NodeProto]:
    """Turn two logits, rough against smooth (l) and unknown against known (u), into log-probabilities.

    None, smooth and rough are as (1 + e^l) e^u to 1 to e^l: the log-softmax of u + softplus(l), 0 and l.
    """
    return [
        helper.make_node("Softplus", [logit], ["softly"]),
        helper.make_node("Add", [unknown, "softly"], ["none"]),
        helper.make_node("Sub", [logit, logit], ["level"]),
        helper.make_node("Concat", ["none", "level", logit], ["scores"], axis=1),
        helper.make_node("LogSoftmax", ["scores"], [LOG_PROBABILITIES], axis=1),
    ]


def build(nodes: Sequence[NodeProto], tensors: Mapping[str, NDArray[np.generic]], *, features: int) -> onnx.ModelProto:
    """Build a checked model of nodes and the constants they use; integers keep their type, the rest is float32."""
    used = {name for node in nodes for name in node.input}
    graph = helper.make_graph(
        list(nodes),
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


def _selection(channels: int) -> dict[str, NDArray[np.float64]]:
    """Constants that select the regression of the working channels.

    ``gone @ votes + votes:whole``, negative values cut off, is 1 for that regression and 0 for the others; ``shares``
    scales its distance up by the share of working channels. With no channel left all are 0.
    """
    if channels == 1:
        return {"votes": np.array([[-1.0]]), "votes:whole": np.ones(1), "shares": np.ones((1, 1))}
    # A missing channel votes against the regression of both and its own, and for that of the other channel.
    votes = np.hstack((np.full((2, 1), -1.0), 1 - 2 * np.eye(2)))
    return {"votes": votes, "votes:whole": np.array([1.0, 0, 0]), "shares": np.array([[1.0], [2], [2]])}
