"""What runs a model's network: ONNX Runtime, or, for the paper's, LiteRT where it is installed."""

import math
from typing import Protocol

import numpy as np
import onnxruntime

from tactophone.perception.decision import Probabilities
from tactophone.perception.inference.litert import open_litert
from tactophone.perception.model_file import CLASSES, FEATURES, LOG_PROBABILITIES, Model
from tactophone.types import FloatArray

AGREEMENT = 0.1
"""In probability, between engines: some ten times what rounding to 8 bits costs, and far less than a fault would."""


class Engine(Protocol):
    """Asks a network, on one thread."""

    def ask(self, features: FloatArray) -> Probabilities:
        """Give what the network makes of features, shape ``(features,)``: garbage too, if it is broken."""
        ...


class OnnxEngine:
    """Runs any model with ONNX Runtime."""

    def __init__(self, session: onnxruntime.InferenceSession) -> None:
        self.width = int(session.get_inputs()[0].shape[-1])
        self._features, self._answer = np.zeros((1, self.width), np.float32), np.zeros((1, len(CLASSES)), np.float32)
        self._session, self._binding = session, session.io_binding()
        # Bound once: to name and wrap arrays at every run takes longer than a small network itself.
        for bind, name, array in (
            (self._binding.bind_input, FEATURES, self._features),
            (self._binding.bind_output, LOG_PROBABILITIES, self._answer),
        ):
            bind(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)

    def ask(self, features: FloatArray) -> Probabilities:
        """Give the network's answer."""
        self._features[0] = features
        self._session.run_with_iobinding(self._binding)
        # Garbage far over 0 would be too large for a float; an e among probabilities is enough to be found out.
        none, smooth, rough = (math.exp(min(value, 1.0)) for value in self._answer[0].tolist())
        return none, smooth, rough


def open_engine(model: Model) -> Engine:
    """Choose what runs a model: other kinds than the paper's are too small to gain by LiteRT."""
    sure = OnnxEngine(model.session)
    fast = open_litert(model.content) if model.card.kind == "paper" else None
    if fast is None or not _agree(sure, fast, sure.width):
        return sure
    return fast


def _agree(sure: Engine, fast: Engine, width: int) -> bool:
    """Ask both once, so that no fault of a second engine on some processor passes unseen."""
    features = np.linspace(4.0, 0.0, width, dtype=np.float32)  # falling, as spectra do
    return bool(np.abs(np.subtract(sure.ask(features), fast.ask(features))).max() <= AGREEMENT)
