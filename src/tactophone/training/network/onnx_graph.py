"""Writes the paper's network as an ONNX graph, by hand: an exporter's graph is longer and harder to quantise.

Weights may be stored in 8 bits, a scale for each output: ``W = int8 * scale``. The product is part of the graph, of
constants alone, so ONNX Runtime computes it once while loading; then the network runs in float32 at full speed, and
the file has a quarter of the size.
"""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from tactophone.perception.model_file import FEATURES, LOG_PROBABILITIES
from tactophone.training.network.model import BINS, RESIDUALS, Weights, channels_of
from tactophone.types import FloatArray, Touch

Storage = Literal["int8", "float32"]
STORAGES: tuple[Storage, ...] = ("int8", "float32")

OPSET, IR_VERSION = 17, 9
"""Of 2022: what every ONNX Runtime that the package admits can read."""

_SCALE = ":scale"


def build_graph(weights: Weights, *, storage: Storage = "int8") -> onnx.ModelProto:
    """Build the network, from ``(1, 257 * channels)`` magnitudes to ``(1, 3)`` log-probabilities."""
    nodes, tensors = [], []
    for name, array in weights.items():
        for tensor, node in _stored(name, array, storage):
            tensors.append(tensor)
            nodes += node
    nodes += _layers()
    width = BINS * channels_of(weights)
    graph = helper.make_graph(
        nodes,
        "paper",
        [helper.make_tensor_value_info(FEATURES, TensorProto.FLOAT, [1, width])],
        [helper.make_tensor_value_info(LOG_PROBABILITIES, TensorProto.FLOAT, [1, len(Touch)])],
        tensors,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    onnx.checker.check_model(model)
    return model


def read_graph(model: onnx.ModelProto) -> dict[str, FloatArray]:
    """Take the parameters back out of a graph that :func:`build_graph` wrote."""
    stored = {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    return {
        name.removesuffix(":int8"): _expanded(array, stored.get(name.removesuffix(":int8") + _SCALE))
        for name, array in stored.items()
        if not name.endswith(_SCALE)
    }


def _expanded(array: Any, scale: Any) -> FloatArray:
    return np.asarray(array, np.float32) if scale is None else array.astype(np.float32) * scale


def _stored(name: str, array: FloatArray, storage: Storage) -> Iterator[tuple[onnx.TensorProto, list[onnx.NodeProto]]]:
    if storage == "float32" or array.ndim == 1:
        yield numpy_helper.from_array(array, name), []
        return
    scale = np.maximum(np.abs(array).max(axis=1, keepdims=True), np.finfo(np.float32).tiny) / 127
    yield numpy_helper.from_array(np.round(array / scale).astype(np.int8), f"{name}:int8"), []
    expand = [
        helper.make_node("Cast", [f"{name}:int8"], [f"{name}:wide"], to=TensorProto.FLOAT),
        helper.make_node("Mul", [f"{name}:wide", name + _SCALE], [name]),
    ]
    yield numpy_helper.from_array(scale.astype(np.float32), name + _SCALE), expand


def _layers() -> Iterator[onnx.NodeProto]:
    value = FEATURES
    for name in ("layer1", "layer2", "layer3"):
        yield from _relu_layer(name, value)
        value = f"{name}:relu"
    for number in range(RESIDUALS):
        name = f"layer_resnet.{number}"
        yield from _relu_layer(name, value)
        yield helper.make_node("Add", [value, f"{name}:relu"], [f"{name}:sum"])
        value = f"{name}:sum"
    for name in ("layer4", "layer5"):
        yield from _relu_layer(name, value)
        value = f"{name}:relu"
    yield _linear("linear", value)
    yield helper.make_node("LogSoftmax", ["linear:out"], [LOG_PROBABILITIES], axis=-1)


def _relu_layer(name: str, value: str) -> Iterator[onnx.NodeProto]:
    yield _linear(name, value)
    yield helper.make_node("Relu", [f"{name}:out"], [f"{name}:relu"])


def _linear(name: str, value: str) -> onnx.NodeProto:
    return helper.make_node("Gemm", [value, f"{name}.weight", f"{name}.bias"], [f"{name}:out"], transB=1)
