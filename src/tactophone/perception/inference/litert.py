"""Runs the paper's network with LiteRT, where the extra ``litert`` is installed.

An update comes every 10.67 ms, by when the network's weights have long left the processor's caches: reading them
again is most of its time. ONNX Runtime reads them as float32, 7.5 MB; LiteRT keeps the file's 8 bits, and its own
code takes less of the caches (docs/model-files.md has the figures).

Weights and biases are those of the model file, written anew in LiteRT's format while loading. What goes into a layer
of 8-bit weights is itself rounded to 8 bits, by its own range at each update. The spectrum's faint bins would so round
to nothing beside a hum. Therefore its bins, up to a share of the loudest, are one row and what they have over it is
another: each is rounded by its own range, both pass the first layer together, and their sum goes on.
"""

import contextlib
import itertools
import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.decision import Probabilities
from tactophone.perception.inference.litertfile import LiteRtWriter
from tactophone.perception.inference.onnxfile import read_constants
from tactophone.types import FloatArray

_FIRST, _LAST = "layer1", "linear"
_ENCODER, _DECODER = ("layer2", "layer3"), ("layer4", "layer5")

FAINT = 1 / 16
"""Of the loudest bin: what lies under it is rounded to 1/8160 of the loudest, what lies over it to 1/32 of itself."""


class LiteRtEngine:
    """Runs a network that was written for LiteRT."""

    def __init__(self, network: bytes) -> None:
        from ai_edge_litert.interpreter import Interpreter

        with _no_greeting():
            self._interpreter = Interpreter(model_content=network, num_threads=1)
            self._interpreter.allocate_tensors()
        self._features = self._interpreter.get_input_details()[0]["index"]
        self._answer = self._interpreter.get_output_details()[0]["index"]

    def ask(self, features: FloatArray) -> Probabilities:
        """Give the network's answer."""
        self._interpreter.set_tensor(self._features, features[None])
        self._interpreter.invoke()
        none, smooth, rough = self._interpreter.get_tensor(self._answer)[0].tolist()
        return none, smooth, rough


def open_litert(content: bytes) -> LiteRtEngine | None:
    """Make an engine of a whole model file; ``None`` if LiteRT is not installed or the network is not the paper's."""
    try:
        constants = read_constants(content)
        # A number that is not finite could come out of 8 bits as if it were one.
        if not all(np.isfinite(array).all() for array in constants.values()):
            return None
        return LiteRtEngine(write_network(constants))
    except (ImportError, KeyError):  # no such package; no such layer
        return None


def write_network(constants: Mapping[str, NDArray[Any]]) -> bytes:
    """Write the paper's network in LiteRT's format, of the constants that `training.graph` stores."""
    writer = LiteRtWriter()

    def layer(value: int, name: str, *, rectify: bool = True) -> int:
        array, scale = _weights(constants, name)
        biases = writer.constant(constants[f"{name}.bias"])
        return writer.connect(value, writer.constant(array, scale), biases, rectify=rectify)

    first, scale = _weights(constants, _FIRST)
    features = writer.place(1, first.shape[1])
    no_biases = writer.constant(np.zeros(len(first), np.float32))
    rows = writer.connect(writer.part(features, FAINT), writer.constant(first, scale), no_biases, rectify=False)
    value = writer.add(writer.total(rows), writer.constant(constants[f"{_FIRST}.bias"][None]), rectify=True)
    for name in _ENCODER:
        value = layer(value, name)
    for name in _residuals(constants):
        value = writer.add(value, layer(value, name))
    for name in _DECODER:
        value = layer(value, name)
    return writer.finish(features, writer.softmax(layer(value, _LAST, rectify=False)))


def _residuals(constants: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    names = (f"layer_resnet.{number}" for number in itertools.count())
    return itertools.takewhile(lambda name: f"{name}.bias" in constants, names)


def _weights(constants: Mapping[str, NDArray[Any]], name: str) -> tuple[NDArray[Any], FloatArray | None]:
    """Give a layer's weights, shape ``(outputs, inputs)``, and the scale of each row if they are of 8 bits."""
    if (whole := constants.get(f"{name}.weight")) is not None:
        return whole, None
    return constants[f"{name}.weight:int8"], constants[f"{name}.weight:scale"][:, 0]


@contextlib.contextmanager
def _no_greeting() -> Iterator[None]:
    """Keep LiteRT from telling on standard error that it is there: no setting does (LiteRT issue 7420)."""
    there = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(there, 2)
        os.close(there)
        os.close(nowhere)
