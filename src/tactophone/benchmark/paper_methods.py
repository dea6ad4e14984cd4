"""Ways to tell rough from smooth, each trained and judged alike: the paper's, and what it must beat."""

import hashlib
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Dataset, Recording
from tactophone.evaluation.predictions import Judge, TakePredictions, predictor_for
from tactophone.perception import read_model
from tactophone.training.model_export import HOP
from tactophone.training.network.training_job import TrainingJob, find_windows, learn, write_trained
from tactophone.training.network.windows import SIZE
from tactophone.training.sound import RATE, read_signals
from tactophone.types import FloatArray, Touch

VERSION = 1
"""Raise it when a method changes in a way that its settings do not tell, so that cached results are made anew."""


@dataclass(frozen=True, slots=True)
class PaperMethod:
    """The paper's network by some recipe, run as the live system runs a model file."""

    course: TrainingJob

    @property
    def name(self) -> str:
        """The recipe's name."""
        return self.course.recipe.name

    @property
    def identity(self) -> str:
        """The whole course, and the version of what is done with it."""
        start = self.course.start.read_bytes() if self.course.start else b""
        return f"paper {VERSION} {self.course!r} {hashlib.sha256(start).hexdigest()}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Train, write the model file and read it back."""
        weights = learn(self.course, find_windows(self.course, recordings))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "fold.onnx"
            write_trained(path, self.course, weights, dataset=Dataset("fold", Path(folder), tuple(recordings)))
            return predictor_for(read_model(path))


@dataclass(frozen=True, slots=True)
class LevelMethod:
    """Loudness alone: a logistic regression on each window's RMS level in dB.

    A detector that is no better than this has learnt how hard one presses, not how rough a surface is.
    """

    channels: int

    @property
    def name(self) -> str:
        """For tables."""
        return "level alone"

    @property
    def identity(self) -> str:
        """What it hears, and its version."""
        return f"level {VERSION} {self.channels}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Find the level that parts rough from smooth, both classes weighing the same."""
        from sklearn.linear_model import LogisticRegression

        levels = [_levels(signal) for signal in read_signals(recordings, channels=self.channels)]
        rough = np.repeat([one.label is Touch.ROUGH for one in recordings], [len(level) for level in levels])
        model = LogisticRegression(class_weight="balanced").fit(np.concatenate(levels)[:, None], rough)

        def judge(recording: Recording) -> TakePredictions:
            level = _levels(read_signals([recording], channels=self.channels)[0])
            share = model.predict_proba(level[:, None])[:, 1].astype(np.float32)
            rows = np.stack([np.zeros_like(share), 1 - share, share], axis=1)
            return TakePredictions(recording, _ends(len(level)) / RATE, rows, np.ones(len(level), bool))

        return judge


def _levels(signal: FloatArray) -> FloatArray:
    """RMS level in dBFS of the contact channel in each window that the live system would judge."""
    total = np.concatenate([[0.0], np.cumsum(np.square(signal[:, 0], dtype=np.float64))])
    count = int((len(signal) - SIZE) / HOP) + 1
    ends = _ends(count)
    power = np.maximum(total[ends] - total[ends - SIZE], 0) / SIZE
    return np.asarray(10 * np.log10(power + 1e-20), np.float32)


def _ends(count: int) -> NDArray[np.intp]:
    """Sample after each window's last; HOP is 64/3, which floats cannot hold."""
    return SIZE + np.arange(count) * HOP.numerator // HOP.denominator
