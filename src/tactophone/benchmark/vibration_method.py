"""Renderers that have no detector, scored: how well their vibration's own features tell rough from smooth.

A finger that feels the sound itself must do the telling. Its part is taken by a logistic regression on what a finger
can feel of the vibration: its level, its peaks, and its strength in bands from 35 Hz to 1 kHz.
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
from tactophone.dataset import Recording, channel_order
from tactophone.evaluation.predictions import Judge
from tactophone.haptics import PASSTHROUGH
from tactophone.haptics.passthrough import RATE, STEP_SIZE
from tactophone.perception.features.resample import Resampler
from tactophone.types import FloatArray

VERSION = 1
SLOW_RATE = RATE // STEP_SIZE
SIZE, HOP = 1024, 128 / 3
"""At 4 kHz: the paper's 256 ms and 10.67 ms."""

EDGES = np.geomspace(35, 1000, 9)
FAINT = 1e-8


@dataclass(frozen=True, slots=True)
class VibrationMethod:
    """A renderer of :data:`tactophone.haptics.PASSTHROUGH`, with a regression in a finger's place."""

    name: str

    @property
    def identity(self) -> str:
        """The renderer, and its version."""
        return f"vibration {VERSION} {self.name}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Weigh what is felt, every surface weighing the same."""
        return fit_regression(functools.partial(_feel, name=self.name), recordings)


@functools.lru_cache(maxsize=1 << 13)
def _feel(recording: Recording, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    vibration = PASSTHROUGH[name](None).render_whole(_contact(recording))[STEP_SIZE - 1 :: STEP_SIZE]
    count = max(0, int((len(vibration) - SIZE) / HOP) + 1)
    starts = np.floor(np.arange(count) * HOP).astype(np.intp)
    windows = sliding_window_view(vibration, SIZE)[starts].astype(np.float64)
    powers = np.square(np.abs(np.fft.rfft(windows * np.hanning(SIZE)))) / SIZE
    bins = np.fft.rfftfreq(SIZE, 1 / SLOW_RATE)
    bands = [powers[:, (bins >= low) & (bins < high)].mean(axis=1) for low, high in itertools.pairwise(EDGES)]
    power, peak = np.square(windows).mean(axis=1), np.square(windows).max(axis=1)
    rows = np.log10(np.stack([*bands, power, (peak + FAINT) / (power + FAINT)], axis=1) + FAINT)
    return (starts + SIZE) / SLOW_RATE, rows


def _contact(recording: Recording) -> FloatArray:
    sound, rate = soundfile.read(recording.path, dtype="float32", always_2d=True)
    contact = np.ascontiguousarray(sound[:, channel_order(recording, wanted=1)])
    if rate == RATE:
        return contact
    resampler = Resampler(rate, RATE, channels=1)
    return np.concatenate([resampler.push(contact), resampler.flush()])
