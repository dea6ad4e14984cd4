"""What a classifier on features is trained with: contact threshold, average touch, change metric, labelled windows."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset import Recording, kin_of
from tactophone.errors import DatasetError
from tactophone.link import Codec
from tactophone.perception import MIN_VARIANCE, ChangeMetric, DecisionRule, Gate, ModelCard, Moments
from tactophone.training.features.augmentation import Augmentation
from tactophone.training.features.examples import Examples
from tactophone.training.features.feature_tracks import (
    FEATURE_RATE,
    WINDOWS,
    FeatureSpec,
    FeatureTrack,
    RunningMoments,
    accumulate,
    extract_features,
    mean_shifts,
)
from tactophone.training.provenance import is_simulation
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray, Touch

FALSE_CONTACTS = 0.01
"""Share of windows without contact that pass the gate's threshold."""

ALWAYS_DBFS = -120.0
"""Threshold where the recordings hold no silence to learn one from: every window counts as contact."""

FALSE_CHANGES = 0.01
"""Share of windows on one surface where the change detection would fire: once a second. At a tenth of that, simulated
edges are decided after 212 ms (p50) and not after 82; it would gain 0.005 of AUC on real kinds left out
(docs/research/detector.md)."""

RIDGE = 1e-3
"""Added to the covariance of shifts, as a share of its mean variance: keeps rarely seen directions from dominating."""

SIMULATED_IMPORTANCE = 0.05
"""Weight of a simulated surface beside a real one, where a set holds both. Simulated sound adds surfaces of which there
is no recording, but it is not real: at the same weight it costs 0.04 of AUC on real kinds left out
(docs/research/detector.md)."""

NO_EXAMPLES = Examples(np.empty((0, 0), np.float32), np.empty(0, bool), np.empty(0, np.intp))


@dataclass(frozen=True, slots=True, eq=False)
class TrainingSet:
    """What a classifier is trained with."""

    spec: FeatureSpec
    threshold_dbfs: float
    """Of contact."""
    prior: Moments
    change_metric: ChangeMetric
    """`prior` and `change_metric`: of the running statistics, for kind ``texture``: see
    :mod:`tactophone.perception.texture`."""
    examples: Examples
    """Windows in contact."""
    height: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """log10 of the surface's Ra in micrometres for each example; NaN where it is unknown."""
    tip: str = ""
    """That touches; empty where it is unknown."""

    def features(self, track: FeatureTrack) -> FloatArray:
        """Return the features that the live extractor returns, shape ``(windows, features)``."""
        if self.spec.kind != "texture":
            return track.description
        return self._moments(track).features(self.prior, track.present)

    def varied(
        self, track: FeatureTrack, mask: NDArray[np.bool_], augmentation: Augmentation | None, rng: np.random.Generator
    ) -> FloatArray:
        """Return the features of some windows of a track, of each of its copies; just of itself without augmentation.

        Copies have the windows' order, one after another.
        """
        if augmentation is None or self.spec.kind != "texture":
            return self.features(track)[mask]
        moments = self._moments(track)
        draw = augmentation.draw
        offsets = [draw(rng, channels=self.spec.channels, values=self.spec.values) for _ in range(augmentation.copies)]
        return np.concatenate([moments.offset(offset).features(self.prior, track.present)[mask] for offset in offsets])

    def _moments(self, track: FeatureTrack) -> RunningMoments:
        threshold_dbfs = _threshold_for(track, self.threshold_dbfs)
        return accumulate(track, threshold_dbfs, self.change_metric, memory=self.spec.memory)

    def card(self, name: str, *, rule: DecisionRule, training: dict[str, Any] | None = None) -> ModelCard:
        """Return the card of a model trained with it."""
        size, hop = WINDOWS[self.spec.kind]
        settings: dict[str, Any] = {}
        if self.spec.kind == "texture":
            settings = {
                "microphone": self.spec.microphone,
                "prior": self.prior.tolist(),
                "change_metric": self.change_metric.tolist(),
                "memory": self.spec.memory,
            }
        gate = Gate(self.threshold_dbfs, "banded")
        return ModelCard(
            name, self.spec.kind, FEATURE_RATE, size, hop, self.spec.channels, gate, rule, settings=settings,
            training=training or {},
        )  # fmt: skip


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

    Parameters
    ----------
    spec
        Which features.
    recordings
        With contact on both smooth and rough surfaces.
    codecs
        Codecs through which each recording is used once more: a classifier that was never trained without the band
        that the link removes fails there (docs/research/benchmark.md).
    augmentation
        Each take is used in so many copies, each varied; texture features alone.
    seed
        Of the variations.
    tip
        That touches.

    Raises
    ------
    DatasetError
        If there is no contact in all rough or all smooth recordings.
    """
    tracks = extract_features(recordings, spec)
    # Opus works at one rate. Where some recordings have it, those go through; where none has, reading one says so.
    at_rate = (
        [each for each in recordings if soundfile.info(each.path).samplerate == LIVE_SAMPLE_RATE] if codecs else []
    )
    for codec in codecs:
        tracks += extract_features(at_rate or recordings, replace(spec, codec=codec))
    threshold_dbfs = contact_threshold(tracks)
    masks = [track.touching() & (track.level_dbfs >= _threshold_for(track, threshold_dbfs)) for track in tracks]
    sizes = [int(mask.sum()) for mask in masks]
    rough = np.repeat([track.recording.label is Touch.ROUGH for track in tracks], sizes)
    if not 0 < rough.sum() < len(rough):
        found = f"on {'rough' if rough.any() else 'smooth'} surfaces alone" if len(rough) else "nowhere"
        raise DatasetError(
            f"{len(recordings)} recording(s) to train on: contact was found {found}; training needs rough and smooth "
            "surfaces: label and record more"
        )
    prior = _mean_moments([track.description[mask] for track, mask in zip(tracks, masks, strict=True)])
    if spec.change_detection and spec.kind == "texture":
        change_metric = fit_change_metric(
            [mean_shifts(track, _threshold_for(track, threshold_dbfs), spec.memory) for track in tracks]
        )
    else:
        change_metric = np.zeros((spec.channels, spec.values, spec.values))
    # The features of the examples follow from the prior and the metric, so these come first.
    unfilled = TrainingSet(spec, threshold_dbfs, prior, change_metric, NO_EXAMPLES, tip=tip)
    rng = np.random.default_rng(seed)
    features = [unfilled.varied(track, mask, augmentation, rng) for track, mask in zip(tracks, masks, strict=True)]
    sizes = [len(rows) for rows in features]
    rough = np.repeat([track.recording.label is Touch.ROUGH for track in tracks], sizes)
    names = sorted({kin_of(track.recording) for track in tracks})
    surface = np.repeat([names.index(kin_of(track.recording)) for track in tracks], sizes)
    importance = np.repeat(_importance([track.recording for track in tracks]), sizes)
    height = np.repeat([_log_height(track.recording) for track in tracks], sizes)
    return replace(unfilled, examples=Examples(np.concatenate(features), rough, surface, importance), height=height)


def _importance(recordings: Sequence[Recording]) -> NDArray[np.float64]:
    """Return the importance of each recording's surface: 1, or less for a simulated one beside real ones."""
    simulated = np.array(list(map(is_simulation, recordings)))
    return np.ones(len(simulated)) if simulated.all() else np.where(simulated, SIMULATED_IMPORTANCE, 1.0)


def _threshold_for(track: FeatureTrack, threshold_dbfs: float) -> float:
    """A recording without segments is contact throughout; another set's noise says nothing about its level."""
    return threshold_dbfs if track.recording.segments else ALWAYS_DBFS


def contact_threshold(tracks: Sequence[FeatureTrack]) -> float:
    """Return the banded level, in whole dBFS, that one quiet window in a hundred exceeds."""
    quiet = np.concatenate([track.level_dbfs[track.quiet()] for track in tracks])
    return float(np.ceil(np.quantile(quiet, 1 - FALSE_CONTACTS))) if len(quiet) else ALWAYS_DBFS


def fit_change_metric(shifts: Sequence[NDArray[np.float32]]) -> ChangeMetric:
    """Fit the metric in which a shift of the mean longer than 1 means a change of surface.

    A Mahalanobis distance, in each channel by itself so that a dead channel does not affect the other: directions in
    which a finger's speed and pressure often shift the mean count little.

    Parameters
    ----------
    shifts
        Of recordings of one surface each, ``(windows, channels, values)``: see
        :func:`tactophone.training.features.feature_tracks.mean_shifts`.

    The metric has the shape ``(channels, values, values)``; zeros, so that no change is detected, without shifts.
    """
    moved = np.concatenate(shifts).astype(np.float64)
    if not len(moved):
        return np.zeros((*moved.shape[1:], moved.shape[2]))
    covariance = np.einsum("ncv,ncw->cvw", moved, moved) / len(moved)
    variance = np.trace(covariance, axis1=1, axis2=2)[:, None, None] / moved.shape[2]
    ridge = (RIDGE * variance + MIN_VARIANCE) * np.eye(moved.shape[2])
    whitening = np.linalg.cholesky(np.linalg.inv(covariance + ridge))
    # Of each window the larger of its channels' distances counts, as in the live detection.
    distance = np.square(np.einsum("ncv,cvw->ncw", moved, whitening)).sum(axis=-1).max(axis=-1)
    return np.asarray((whitening / np.sqrt(np.quantile(distance, 1 - FALSE_CHANGES))).round(5))


def _mean_moments(descriptions: Sequence[NDArray[np.float32]]) -> Moments:
    wide = np.concatenate(descriptions).astype(np.float64)
    return np.stack((wide.mean(axis=0), np.square(wide).mean(axis=0))).round(6)


def _log_height(recording: Recording) -> float:
    height_um = recording.known("ra_um")
    return float(np.log10(float(height_um))) if height_um else float("nan")
