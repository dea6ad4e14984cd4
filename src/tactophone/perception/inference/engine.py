"""Runs a model's network with ONNX Runtime, on one thread."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from tactophone.perception.decision import Probabilities
from tactophone.perception.model_file import CLASSES, FEATURES, LOG_PROBABILITIES
from tactophone.types import FloatArray

if TYPE_CHECKING:
    import onnxruntime


MOST_ROWS = 3
"""Rows of one call. ONNX Runtime computes four numbers of an array at once, by an exponential whose last bit may differ
from that for the one to three that are left: with four rows, 53 of 60,000 of the stylus' network differed from those of
one row; with up to three, each is what it is alone."""


class Engine:
    """Turns features into probabilities; input and output arrays are allocated once for each number of rows.

    A network whose file names the number of rows instead of stating 1 computes up to `MOST_ROWS` at once, each as it
    would alone, bit for bit. For others, each row is a call.
    """

    def __init__(self, session: "onnxruntime.InferenceSession") -> None:
        rows, width = session.get_inputs()[0].shape
        self.width = int(width)
        """Features that the network takes."""
        self._session, self._most_rows = session, 1 if rows == 1 else MOST_ROWS
        self._bound: dict[int, tuple[onnxruntime.IOBinding, FloatArray, FloatArray]] = {}

    def run(self, features: Sequence[FloatArray]) -> list[Probabilities]:
        """Return the probabilities of none, smooth and rough for each row of features, of shape ``(features,)``.

        A broken network returns NaN, or numbers that do not sum to 1: the caller checks.
        """
        most = self._most_rows
        return [each for at in range(0, len(features), most) for each in self._run(features[at : at + most])]

    def _run(self, features: Sequence[FloatArray]) -> list[Probabilities]:
        binding, rows, log_probabilities = self._bound.get(len(features)) or self._bind(len(features))
        for number, row in enumerate(features):
            rows[number] = row
        self._session.run_with_iobinding(binding)
        # exp of an invalid value far over 0 would overflow; capped at e it still fails the caller's check.
        return [
            (math.exp(min(none, 1.0)), math.exp(min(smooth, 1.0)), math.exp(min(rough, 1.0)))
            for none, smooth, rough in log_probabilities.tolist()
        ]

    def _bind(self, count: int) -> tuple["onnxruntime.IOBinding", FloatArray, FloatArray]:
        # Bound once: naming and wrapping the arrays at every run takes longer than a small network itself.
        binding = self._session.io_binding()
        rows, log_probabilities = np.zeros((count, self.width), np.float32), np.zeros((count, len(CLASSES)), np.float32)
        for bind, name, array in (
            (binding.bind_input, FEATURES, rows),
            (binding.bind_output, LOG_PROBABILITIES, log_probabilities),
        ):
            bind(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        self._bound[count] = binding, rows, log_probabilities
        return self._bound[count]
