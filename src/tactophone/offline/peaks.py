"""The peak envelope of a waveform of any length: its least and greatest value in each of a few thousand columns."""

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

CAPACITY = 4096
"""Greatest number of columns, an even number: more than any figure has pixels across."""


class PeakEnvelope:
    """Collects the extremes of a stream of sound; memory does not grow with its length.

    When the columns are full, neighbours are joined, and each column then spans twice as many samples.

    Examples
    --------
    >>> envelope = PeakEnvelope(1, sample_rate=1000)
    >>> envelope.push(np.sin(np.arange(100_000, dtype=np.float32))[:, None])
    >>> time, low, high = envelope.columns()
    >>> len(time) <= CAPACITY, round(float(low.min())), round(float(high.max()))
    (True, -1, 1)
    """

    def __init__(self, channels: int, *, sample_rate: int) -> None:
        self._sample_rate = sample_rate
        self._step = 16
        self._rest: FloatArray = np.empty((0, channels), np.float32)
        self._low: list[FloatArray] = []
        self._high: list[FloatArray] = []

    def push(self, samples: FloatArray) -> None:
        """Add sound, shape ``(samples, channels)``."""
        while len(samples):
            room = (CAPACITY - len(self._low)) * self._step - len(self._rest)
            self._add_columns(np.concatenate((self._rest, samples[:room])))
            samples = samples[room:]
            if len(self._low) == CAPACITY:
                self._low = list(np.minimum(self._low[::2], self._low[1::2]))
                self._high = list(np.maximum(self._high[::2], self._high[1::2]))
                self._step *= 2

    def columns(self) -> tuple[NDArray[np.float64], FloatArray, FloatArray]:
        """Return the time of each column in s, and its least and greatest values, each ``(columns, channels)``."""
        time = np.arange(len(self._low)) * self._step / self._sample_rate
        empty = np.empty((0, self._rest.shape[1]), np.float32)
        return time, np.array(self._low) if self._low else empty, np.array(self._high) if self._high else empty

    def _add_columns(self, sound: FloatArray) -> None:
        # What does not fill a column waits for the next block.
        whole = len(sound) // self._step * self._step
        columns = sound[:whole].reshape(-1, self._step, sound.shape[1])
        self._rest = sound[whole:]
        self._low += list(columns.min(axis=1))
        self._high += list(columns.max(axis=1))
