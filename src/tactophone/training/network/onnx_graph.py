"""Writes the paper's network as an ONNX graph, node by node: an exporter's graph is longer and harder to quantise.

Weights may be stored in 8 bits, a scale for each output: ``W = int8 * scale``. ONNX Runtime's operator ``MatMulNBits``
multiplies them as they are, which reads a quarter of the memory that float32 takes. An update comes every 10.67 ms, by
when the weights have left the processor's caches, so that reading them is most of its time.

The operator rounds a layer's input to 8 bits too, block by block, each by the block's own maximum. Blocks of the
spectrum are short, 32 bins of 3.9 Hz, so that mains hum (under 125 Hz) does not round all other bins to zero.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from tactophone.perception import FEATURES, LOG_PROBABILITIES
from tactophone.training.model_export import IR_VERSION, OPSET
from tactophone.training.network.model import BINS, RESIDUALS, Weights, channels_of
from tactophone.types import FloatArray, Touch

Storage = Literal["int8", "float32"]

_BYTES, _SCALE, _SCALES = ":uint8", ":scale", ":scales"
_MICROSOFT = "com.microsoft"
_ZERO_POINT = 128
_INT8_ACTIVATIONS = 4
"""``accuracy_level`` of 8-bit inputs; at level 1, float32 inputs, a run takes ten times as long."""

_SPECTRUM_BLOCK, _BLOCK = 32, 128
_LAST = "linear"
"""The last layer, 3 x 64 weights, stays in float32."""


def build_graph(weights: Weights, *, storage: Storage = "int8") -> onnx.ModelProto:
    """Build the network, from ``(1, 257 * channels)`` magnitudes to ``(1, 3)`` log-probabilities."""
    tensors = [tensor for name, array in weights.items() for tensor in _tensors(name, array, storage)]
    nodes = list(_layers(weights, storage))
    width = BINS * channels_of(weights)
    graph = helper.make_graph(
        nodes,
        "paper",
        [helper.make_tensor_value_info(FEATURES, TensorProto.FLOAT, [1, width])],
        [helper.make_tensor_value_info(LOG_PROBABILITIES, TensorProto.FLOAT, [1, len(Touch)])],
        tensors,
    )
    opsets = [helper.make_opsetid("", OPSET), helper.make_opsetid(_MICROSOFT, 1)]
    model = helper.make_model(graph, opset_imports=opsets, ir_version=IR_VERSION)
    onnx.checker.check_model(model)
    return model


def read_graph(model: onnx.ModelProto) -> dict[str, FloatArray]:
    """Read the parameters from a graph that :func:`build_graph` wrote."""
    stored = {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}
    sizes = {
        node.input[1]: next(entry.i for entry in node.attribute if entry.name == "K")
        for node in model.graph.node
        if node.op_type == "MatMulNBits"
    }
    parameters = {}
    for name, array in stored.items():
        if name in sizes:
            weight = name.removesuffix(_BYTES)
            rows = array.reshape(len(array), -1)[:, : sizes[name]].astype(np.float32) - _ZERO_POINT
            parameters[weight] = rows * stored[weight + _SCALE]
        elif name.endswith((".weight", ".bias")):
            parameters[name] = array
    return parameters


def _tensors(name: str, array: FloatArray, storage: Storage) -> Iterator[onnx.TensorProto]:
    """Store one parameter; 8-bit weights have shape ``(outputs, blocks, block size)``, padded with zeros."""
    if not _is_quantised(name, storage):
        yield numpy_helper.from_array(array, name)
        return
    scale = np.maximum(np.abs(array).max(axis=1, keepdims=True), np.finfo(np.float32).tiny) / 127
    outputs, inputs = array.shape
    size = _block_size(name)
    blocks = -(-inputs // size)
    padded = np.full((outputs, blocks * size), _ZERO_POINT, np.uint8)
    padded[:, :inputs] = np.round(array / scale) + _ZERO_POINT
    yield numpy_helper.from_array(padded.reshape(outputs, blocks, size), name + _BYTES)
    yield numpy_helper.from_array(scale.astype(np.float32), name + _SCALE)
    yield numpy_helper.from_array(np.array([outputs, blocks]), f"{name}:shape")


def _is_quantised(name: str, storage: Storage) -> bool:
    return storage == "int8" and name.endswith(".weight") and not name.startswith(_LAST)


def _block_size(name: str) -> int:
    return _SPECTRUM_BLOCK if name.startswith("layer1.") else _BLOCK


def _layers(weights: Weights, storage: Storage) -> Iterator[onnx.NodeProto]:
    value = FEATURES
    for name in ("layer1", "layer2", "layer3"):
        yield from _relu_layer(name, value, weights, storage)
        value = f"{name}:relu"
    for number in range(RESIDUALS):
        name = f"layer_resnet.{number}"
        yield from _relu_layer(name, value, weights, storage)
        yield helper.make_node("Add", [value, f"{name}:relu"], [f"{name}:sum"])
        value = f"{name}:sum"
    for name in ("layer4", "layer5"):
        yield from _relu_layer(name, value, weights, storage)
        value = f"{name}:relu"
    yield from _linear(_LAST, value, weights, storage)
    yield helper.make_node("LogSoftmax", [f"{_LAST}:out"], [LOG_PROBABILITIES], axis=-1)


def _relu_layer(name: str, value: str, weights: Weights, storage: Storage) -> Iterator[onnx.NodeProto]:
    yield from _linear(name, value, weights, storage)
    yield helper.make_node("Relu", [f"{name}:out"], [f"{name}:relu"])


def _linear(name: str, value: str, weights: Weights, storage: Storage) -> Iterator[onnx.NodeProto]:
    weight, bias, out = f"{name}.weight", f"{name}.bias", f"{name}:out"
    if not _is_quantised(weight, storage):
        yield helper.make_node("Gemm", [value, weight, bias], [out], transB=1)
        return
    outputs, inputs = weights[weight].shape
    # The operator takes a scale for each block; a row has one for all, expanded once while loading.
    yield helper.make_node("Expand", [weight + _SCALE, f"{weight}:shape"], [weight + _SCALES])
    yield helper.make_node(
        "MatMulNBits",
        [value, weight + _BYTES, weight + _SCALES, "", "", bias],
        [out],
        domain=_MICROSOFT,
        K=inputs,
        N=outputs,
        bits=8,
        block_size=_block_size(weight),
        accuracy_level=_INT8_ACTIVATIONS,
    )
