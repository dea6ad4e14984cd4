"""The methods of the benchmark behind one protocol, :class:`tactophone.benchmark.Method`.

Every recipe of :data:`tactophone.training.recipes.RECIPES` is a method through :func:`method_of`. Renderers without a
detector and the high-band control are :class:`RegressionMethod`; Ra from sound is in ``height_regression``.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import onnxruntime

from tactophone.benchmark.crossvalidation import Method
from tactophone.benchmark.regression_features import REGRESSION_FEATURES
from tactophone.dataset import Dataset, Recording
from tactophone.evaluation import Predictor, TakePredictions, model_predictor
from tactophone.perception import FEATURES, LOG_PROBABILITIES, read_model
from tactophone.training import (
    RECIPES,
    FeatureJob,
    FeatureSpec,
    Job,
    TrainingOptions,
    TrainingSet,
    even_weights,
    extract_features,
)
from tactophone.types import Touch

VERSION = 1
"""Raise it when a class here changes in a way that its settings do not show, so that cached folds are trained anew."""


@dataclass(frozen=True, slots=True)
class NetworkMethod:
    """A training job that ends in a model file, which runs as the live system runs it: the paper's network."""

    job: Job

    @property
    def name(self) -> str:
        """The job's name."""
        return self.job.name

    @property
    def identity(self) -> str:
        """The job's identity, and the version of this class."""
        return f"model file {VERSION} {self.job.identity}"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Train, write the model file and read it back."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "fold.onnx"
            self.job.train(path, Dataset("fold", Path(folder), tuple(recordings)))
            return model_predictor(read_model(path))


@dataclass(frozen=True, slots=True)
class FeatureMethod:
    """A recipe on features, run over a whole recording at once.

    Features are computed once per recording and cached in the process, so that a fold costs its training alone; tests
    hold that the predictions equal those of the streaming detector, window for window.
    """

    job: FeatureJob
    dropped: int | None = None
    """An ablation: this channel is silent after training. The same weights, one microphone less."""

    @property
    def name(self) -> str:
        """The recipe's name, and what is dropped."""
        return self.job.name if self.dropped is None else f"{self.job.name}/no-{('contact', 'air')[self.dropped]}"

    @property
    def identity(self) -> str:
        """The job's identity, and what is dropped."""
        return f"features {VERSION} {self.job.identity}" + ("" if self.dropped is None else f" without {self.dropped}")

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Train, and predict by the graph that a model file would hold."""
        training_set = self.job.training_set(recordings)
        return graph_predictor(self.job.build(training_set).SerializeToString(), training_set, dropped=self.dropped)


@dataclass(frozen=True, slots=True)
class RegressionMethod:
    """A logistic regression on the features of `REGRESSION_FEATURES`; always in contact."""

    name: str
    """Of the features."""

    @property
    def identity(self) -> str:
        """The features, and the version of this class."""
        return f"regression {VERSION} {self.name}"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Fit, with every surface at the same weight."""
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        features = REGRESSION_FEATURES[self.name]
        rows = [features(recording)[1] for recording in recordings]
        sizes, names = [len(windows) for windows in rows], sorted({recording.surface for recording in recordings})
        rough = np.repeat([recording.label is Touch.ROUGH for recording in recordings], sizes)
        surface = np.repeat([names.index(recording.surface) for recording in recordings], sizes)
        model = make_pipeline(StandardScaler(), LogisticRegression(C=0.03, solver="newton-cholesky"))
        model.fit(np.concatenate(rows), rough, logisticregression__sample_weight=even_weights(rough, surface))

        def predict(recording: Recording) -> TakePredictions:
            time, windows = features(recording)
            share = model.predict_proba(windows)[:, 1].astype(np.float32)
            probabilities = np.stack([np.zeros_like(share), 1 - share, share], axis=1)
            return TakePredictions(recording, time, probabilities, np.ones(len(time), bool))

        return predict


def method_of(job: Job) -> Method:
    """Return the method that cross-validates a training job."""
    return FeatureMethod(job) if isinstance(job, FeatureJob) else NetworkMethod(job)


def recipe_method(name: str, *, channels: int) -> FeatureMethod:
    """Return the method of a recipe on features, for sound of 1 or 2 channels."""
    return FeatureMethod(cast(FeatureJob, RECIPES[name].open_job(TrainingOptions(channels=channels))))


def graph_predictor(
    graph: bytes, training_set: TrainingSet, *, spec: FeatureSpec | None = None, dropped: int | None = None
) -> Predictor:
    """Return a predictor that runs a graph on all windows of a recording at once.

    The features are as in training by default; the channel ``dropped`` carries nothing.
    """
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])

    def predict(recording: Recording) -> TakePredictions:
        (track,) = extract_features([recording], spec or training_set.spec)
        if dropped is not None:
            alive = np.arange(training_set.spec.channels) != dropped
            # Constant features of a silent channel never trigger the detection of a change of surface.
            track = replace(track, present=track.present & alive, description=track.description * alive[:, None])
        (log_probabilities,) = session.run([LOG_PROBABILITIES], {FEATURES: training_set.features(track)})
        contact = track.level_dbfs >= training_set.threshold_dbfs
        return TakePredictions(recording, track.end, np.exp(log_probabilities, dtype=np.float32), contact)

    return predict
