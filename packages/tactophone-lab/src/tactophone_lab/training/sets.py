"""Training sets of classifiers on features: contact threshold, average touch, change
metric, labelled windows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import onnx
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.sound_file import sound_info
from tactophone.core.recordings.values import Recording
from tactophone.core.tips import TIPS
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.net.link.codec import Codec
from tactophone_lab.datasets.splits import kin_of
from tactophone_lab.training.augmentation import Augmentation
from tactophone_lab.training.onnx_export import Floats, is_simulation, join
from tactophone_lab.training.recipe_options import MIN_VARIANCE, FeatureSpec
from tactophone_lab.training.tracks import (
    ChangeMetric,
    FeatureTrack,
    Moments,
    accumulate,
    extract_features,
    mean_shifts,
    noise_level,
)

HARD_TIPS = tuple(tip.name for tip in TIPS.values() if tip.hard)

FALSE_CHANGES = 0.01
"""Share of windows on one surface where the change detection would fire: once a second.
At a tenth of that, simulated edges are decided after 212 ms (p50) and not after 82; it
would gain 0.005 of AUC on real kinds left out (docs/research/detector.md)."""

RIDGE = 1e-3
"""Added to the covariance of shifts, as a share of its mean variance: keeps rarely seen
directions from dominating."""

SIMULATED_IMPORTANCE = 0.05
"""Weight of a simulated surface beside a real one, where a set holds both. Simulated
sound adds surfaces that nobody has recorded, but it is not real: at the same
weight it costs 0.04 of AUC on real kinds left out (docs/research/detector.md)."""

MOST_WINDOWS = 12_000
"""Windows trained on, evenly drawn: neighbours are nearly the same, and more change no
score."""

INNER_FOLDS = 5
"""Folds of the surfaces in a training set, each predicted by a fit on the others."""


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Windows to train on."""

    features: FloatArray
    """Shape ``(windows, features)``; NaN where a channel is missing."""
    rough: NDArray[np.bool_]
    """Whether rough, shape ``(windows,)``."""
    surface: NDArray[np.intp]
    """Number of the surface, shape ``(windows,)``; kin have the same."""
    importance: Floats | None = None
    """Weight of each window's surface beside others, shape ``(windows,)``; none: all
    weigh the same."""

    def where(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "Examples":
        """Return the windows of a mask or with these numbers."""
        importance = None if self.importance is None else self.importance[which]
        return Examples(
            self.features[which], self.rough[which], self.surface[which], importance
        )

    def thinned(self, most: int = MOST_WINDOWS) -> "Examples":
        """Return at most ``most`` windows, evenly drawn."""
        return self.where(
            np.arange(0, len(self.rough), max(1, -(-len(self.rough) // most)))
        )

    def weights(self) -> Floats:
        return even_weights(self.rough, self.surface, self.importance)

    def moments(self) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of each feature, missing values left
        out."""
        wide = self.features.astype(np.float64)
        return np.nanmean(wide, axis=0), np.maximum(np.nanstd(wide, axis=0), 1e-6)

    def standardised(self, mean: Floats, scale: Floats) -> Floats:
        """Return the features standardised; missing ones are taken as average, here as
        in the graph."""
        return np.asarray(np.nan_to_num((self.features - mean) / scale))


def even_weights(
    rough: NDArray[np.bool_],
    surface: NDArray[np.intp],
    importance: Floats | None = None,
) -> Floats:
    """Return weights of windows that give both classes, and in each class its surfaces,
    the same weight; mean 1.

    With an importance, ``(windows,)``, the surfaces of a class weigh as it says; it may
    differ within a surface.
    """
    weights = (
        np.ones(len(rough)) if importance is None else importance.astype(np.float64)
    )
    for label in (False, True):
        for number in np.unique(surface[rough == label]):
            here = (surface == number) & (rough == label)
            weights[here] /= here.sum()
        weights[rough == label] *= len(rough) / 2 / weights[rough == label].sum()
    return weights


def inner_folds(
    rough: NDArray[np.bool_], surface: NDArray[np.intp]
) -> Iterator[NDArray[np.bool_]]:
    """Yield masks of the windows held out in each inner fold: whole surfaces, of both
    classes where possible."""
    fold_of = {
        int(number): place % INNER_FOLDS
        for label in (True, False)
        for place, number in enumerate(np.unique(surface[rough == label]))
    }
    folds = np.array([fold_of[int(number)] for number in surface])
    for fold in range(INNER_FOLDS):
        held_out = folds == fold
        if held_out.any() and len(set(rough[~held_out])) == 2:
            yield held_out


NO_EXAMPLES = Examples(
    np.empty((0, 0), np.float32), np.empty(0, bool), np.empty(0, np.intp)
)


@dataclass(frozen=True, slots=True, eq=False)
class TrainingSet:
    """What a classifier is trained with."""

    spec: FeatureSpec
    threshold_dbfs: float
    """Of contact."""
    prior: Moments
    change_metric: ChangeMetric
    """`prior` and `change_metric`: of the running statistics, for kind ``texture``: see
    :class:`tactophone_lab.training.features.Statistics`."""
    examples: Examples
    """Windows in contact."""
    tip: str = ""
    """What touches; empty if unknown."""

    def features(self, tracks: Sequence[FeatureTrack]) -> list[FloatArray]:
        """Return the features that the model's graph computes, shape ``(windows,
        features)`` for each track."""
        if self.spec.kind != "texture":
            return [track.description for track in tracks]
        moments = accumulate(
            tracks, self.threshold_dbfs, self.change_metric, fading=self.spec.fading
        )
        return [
            each.features(self.prior, track.present)
            for each, track in zip(moments, tracks, strict=True)
        ]

    def whole(self, classifier: onnx.ModelProto) -> onnx.ModelProto:
        """Return the graph of a model file: the features, then the classifier."""
        from tactophone_lab.training.features import (
            CONSTANTS,
            front,
        )  # here, as it needs torch

        values = self.prior, self.change_metric, np.array(self.spec.fading)
        constants = (
            dict(zip(CONSTANTS, values, strict=True))
            if self.spec.kind == "texture"
            else {}
        )
        return join(front(self.spec, constants), classifier)


def build_training_set(
    spec: FeatureSpec,
    recordings: Sequence[Recording],
    *,
    codecs: Sequence[Codec] = (),
    augmentation: Augmentation | None = None,
    seed: int = 0,
    tip: str = "",
) -> TrainingSet:
    """Extract features from labelled recordings and select the windows to train on.

    Each recording is used once more through each of the codecs: a classifier that was
    never trained without the band that the link removes fails there
    (docs/research/benchmark.md). An augmentation adds varied copies, drawn by the seed,
    of texture features alone. Raises `DatasetError` if there is no contact in all rough
    or all smooth recordings.
    """
    plain = tracks = extract_features(recordings, spec)
    # Opus works at one rate. Where some recordings have it, those go through; where
    # none has, reading one says so.
    at_rate = (
        [
            each
            for each in recordings
            if sound_info(each.path).sample_rate == LIVE_SAMPLE_RATE
        ]
        if codecs
        else []
    )
    for codec in codecs:
        tracks = tracks + extract_features(
            at_rate or recordings, replace(spec, codec=codec)
        )
    for number in range(1, augmentation.copies + 1 if augmentation else 1):
        copy = replace(spec, augmentation=augmentation, copy=(seed, number))
        tracks = tracks + extract_features(recordings, copy)
    threshold_dbfs = noise_level(plain)
    masks = [track.touching() & track.loud(threshold_dbfs) for track in tracks]
    sizes = [int(mask.sum()) for mask in masks]
    rough = np.repeat([track.recording.rough for track in tracks], sizes)
    if not 0 < rough.sum() < len(rough):
        found = (
            f"on {'rough' if rough.any() else 'smooth'} surfaces alone"
            if len(rough)
            else "nowhere"
        )
        raise DatasetError(
            f"{len(recordings)} recording(s) to train on: contact was found {found}; "
            "training needs rough and smooth "
            "surfaces: label and record more"
        )
    every = np.concatenate(
        [track.description[mask] for track, mask in zip(tracks, masks, strict=True)],
        dtype=float,
    )
    prior = np.stack((every.mean(axis=0), np.square(every).mean(axis=0))).round(6)
    change_metric = np.zeros((spec.channels, spec.values, spec.values))
    if spec.change_detection and spec.kind == "texture":
        change_metric = fit_change_metric(
            mean_shifts(tracks, threshold_dbfs, fading=spec.fading)
        )
    # The features of the examples follow from the prior and the metric, so these come
    # first.
    unfilled = TrainingSet(
        spec, threshold_dbfs, prior, change_metric, NO_EXAMPLES, tip=tip
    )
    features = [
        rows[mask] for rows, mask in zip(unfilled.features(tracks), masks, strict=True)
    ]
    names = sorted({kin_of(track.recording) for track in tracks})
    surface = np.repeat(
        [names.index(kin_of(track.recording)) for track in tracks], sizes
    )
    simulated = np.array([is_simulation(track.recording) for track in tracks])
    # A simulated surface counts less, but only beside real ones.
    weights = (
        np.ones(len(tracks))
        if simulated.all()
        else np.where(simulated, SIMULATED_IMPORTANCE, 1.0)
    )
    importance = np.repeat(weights, sizes)
    return replace(
        unfilled,
        examples=Examples(np.concatenate(features), rough, surface, importance),
    )


def fit_change_metric(shifts: Sequence[NDArray[np.float32]]) -> ChangeMetric:
    """Fit the metric in which a shift of the mean longer than 1 means a change of
    surface.

    A Mahalanobis distance, in each channel by itself so that a dead channel does not
    affect the other: directions in which a finger's speed and pressure often shift the
    mean count little. The shifts come from
    :func:`tactophone_lab.training.tracks.mean_shifts`. The metric has the shape
    ``(channels, values, values)``; zeros, so that no change is detected, without
    shifts.
    """
    moved = np.concatenate(shifts).astype(np.float64)
    if not len(moved):
        return np.zeros((*moved.shape[1:], moved.shape[2]))
    covariance = np.einsum("ncv,ncw->cvw", moved, moved) / len(moved)
    variance = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / moved.shape[2]
    ridge = (RIDGE * variance + MIN_VARIANCE) * np.eye(moved.shape[2])
    whitening = np.linalg.cholesky(np.linalg.inv(covariance + ridge))
    # Of each window the larger of its channels' distances counts, as in the live
    # detection.
    distance = (
        np.square(np.einsum("ncv,cvw->ncw", moved, whitening)).sum(axis=-1).max(axis=-1)
    )
    return np.asarray(
        (whitening / np.sqrt(np.quantile(distance, 1 - FALSE_CHANGES))).round(5)
    )
