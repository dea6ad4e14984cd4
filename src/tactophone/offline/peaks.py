"""A picture's worth of a waveform of any length: its least and greatest value in each of a few thousand columns."""

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

CAPACITY = 4096
"""Columns kept at most, an even number: more than any picture has pixels across."""


class PeakEnvelope:
    """Gathers the extremes of a stream of sound; memory does not grow with its length.

    When the columns are full, neighbours are joined, and each then spans twice as much.

    Parameters
    ----------
    channels
        Of the sound to come.
    sample_rate
        In Hz.

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
        """Take sound in, shape ``(samples, channels)``."""
        while len(samples):
            room = (CAPACITY - len(self._low)) * self._step - len(self._rest)
            self._gather(np.concatenate((self._rest, samples[:room])))
            samples = samples[room:]
            if len(self._low) == CAPACITY:
                self._join()

    def columns(self) -> tuple[NDArray[np.float64], FloatArray, FloatArray]:
        """Give each column's time in s, and its least and greatest values, shape ``(columns, channels)``."""
        time = np.arange(len(self._low)) * self._step / self._sample_rate
        empty = np.empty((0, self._rest.shape[1]), np.float32)
        return time, np.array(self._low) if self._low else empty, np.array(self._high) if self._high else empty

    def _gather(self, sound: FloatArray) -> None:
        whole = len(sound) // self._step * self._step
        columns = sound[:whole].reshape(-1, self._step, sound.shape[1])
        self._rest = sound[whole:]
        self._low += list(columns.min(axis=1))
        self._high += list(columns.max(axis=1))

    def _join(self) -> None:
        self._low = list(np.minimum(self._low[::2], self._low[1::2]))
        self._high = list(np.maximum(self._high[::2], self._high[1::2]))
        self._step *= 2
