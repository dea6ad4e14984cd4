"""Runs a model's network with ONNX Runtime, on one thread."""

import math
from typing import TYPE_CHECKING

import numpy as np

from tactophone.perception.decision import Probabilities
from tactophone.perception.model_file import CLASSES, FEATURES, LOG_PROBABILITIES
from tactophone.types import FloatArray

if TYPE_CHECKING:
    import onnxruntime


class Engine:
    """Turns features into probabilities; input and output arrays are allocated once."""

    def __init__(self, session: "onnxruntime.InferenceSession") -> None:
        self.width = int(session.get_inputs()[0].shape[-1])
        """Features that the network takes."""
        self._features = np.zeros((1, self.width), np.float32)
        self._log_probabilities = np.zeros((1, len(CLASSES)), np.float32)
        self._session, self._binding = session, session.io_binding()
        # Bound once: naming and wrapping the arrays at every run takes longer than a small network itself.
        for bind, name, array in (
            (self._binding.bind_input, FEATURES, self._features),
            (self._binding.bind_output, LOG_PROBABILITIES, self._log_probabilities),
        ):
            bind(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)

    def run(self, features: FloatArray) -> Probabilities:
        """Return the probabilities of none, smooth and rough for features of shape ``(features,)``.

        A broken network returns NaN, or numbers that do not sum to 1: the caller checks.
        """
        self._features[0] = features
        self._session.run_with_iobinding(self._binding)
        # exp of an invalid value far over 0 would overflow; capped at e it still fails the caller's check.
        none, smooth, rough = (math.exp(min(value, 1.0)) for value in self._log_probabilities[0].tolist())
        return none, smooth, rough
