"""What a benchmark must be distrusted for: a control that hears only what no surface can have said.

Recordings have a noise floor, and a surface recorded on one day has that day's. A method that does well on the band
over 8 kHz of recordings whose microphone ends at 7.5 kHz has learnt the day, not the surface: so might any other.
"""

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import soundfile
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.benchmark.logistic_regression import fit_regression
from tactophone.dataset import Recording
from tactophone.evaluation.predictions import Judge

VERSION = 1
LOWEST, HIGHEST, BANDS = 8000.0, 20_000.0, 8
SIZE = 1024
HOP = 0.01
"""Seconds."""

MEAN = 24
"""Updates averaged: as long as the paper's window."""


@dataclass(frozen=True, slots=True)
class HighBandControl:
    """Logistic regression on log bands from 8 to 20 kHz alone; for recordings at 40 kHz or more."""

    name: str = "control: only over 8 kHz"

    @property
    def identity(self) -> str:
        """Its version."""
        return f"over band {VERSION}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Weigh the bands, every surface weighing the same."""
        return fit_regression(_bands, recordings)


@functools.lru_cache(maxsize=1 << 12)
def _bands(recording: Recording) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    sound, rate = soundfile.read(recording.path, dtype="float32", always_2d=True)
    ends = np.arange(SIZE, len(sound) + 1, round(HOP * rate))
    windows = sliding_window_view(sound[:, 0], SIZE)[ends - SIZE]
    powers = np.square(np.abs(np.fft.rfft(windows * np.hanning(SIZE))))
    bins = np.fft.rfftfreq(SIZE, 1 / rate)
    edges = np.geomspace(LOWEST, HIGHEST, BANDS + 1)
    bands = [powers[:, (bins >= low) & (bins < high)].mean(axis=1) for low, high in itertools.pairwise(edges)]
    return ends / rate, _running_mean(np.log10(np.stack(bands, axis=1) + 1e-9))


def _running_mean(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    total = np.concatenate((np.zeros((1, rows.shape[1])), np.cumsum(rows, axis=0)))
    last = np.arange(1, len(rows) + 1)
    first = np.maximum(last - MEAN, 0)
    return np.asarray((total[last] - total[first]) / (last - first)[:, None])
