"""What is learnt from recordings by detectors that are shown features: contact, the average touch, examples."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.errors import DatasetError
from tactophone.link import Codec
from tactophone.perception import DecisionRule, Gate, ModelCard
from tactophone.perception.features.bands import VALUES
from tactophone.perception.features.texture import LEAST_VARIANCE, Moments, Surprise
from tactophone.training.features.feature_tracks import (
    RATE,
    WINDOWS,
    FeatureSpec,
    FeatureTrack,
    listen,
    movements,
    remember,
)
from tactophone.training.features.linear_classifier import Examples
from tactophone.types import FloatArray, Touch

FALSE_CONTACTS = 0.01
"""Share of windows without contact that the gate's threshold lets through."""

ALWAYS_DBFS = -120.0
"""Threshold where training sound has no silence to learn one from: everything counts as contact."""


SURPRISED_SHARE = 0.01
"""Share of windows on one surface that would surprise its memory."""

RIDGE = 1e-3
"""Added to the spread of movements, as a share of its mean: directions that were hardly seen must not decide."""

NO_EXAMPLES = Examples(np.empty((0, 0), np.float32), np.empty(0, bool), np.empty(0, np.intp))


@dataclass(frozen=True, slots=True, eq=False)
class TrainingSet:
    """What recordings come to.

    Parameters
    ----------
    ear
        How they were heard.
    threshold_dbfs
        Of contact.
    prior, surprise
        Of the memory, for kind ``texture``: see :mod:`tactophone.perception.features.texture`.
    examples
        Windows in contact.
    height
        log10 of the surface's Ra in micrometres for each example; NaN where it is not known.
    """

    ear: FeatureSpec
    threshold_dbfs: float
    prior: Moments
    surprise: Surprise
    examples: Examples
    height: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def features(self, track: FeatureTrack) -> FloatArray:
        """Give the features that the live extractor gives, shape ``(windows, features)``."""
        if self.ear.kind != "texture":
            return track.description
        return remember(track, self.threshold_dbfs, self.surprise).features(self.prior, track.present)

    def card(self, name: str, *, rule: DecisionRule, training: dict[str, Any] | None = None) -> ModelCard:
        """Describe the model that is made of it."""
        size, hop = WINDOWS[self.ear.kind]
        return ModelCard(
            name,
            self.ear.kind,
            RATE,
            size,
            hop,
            self.ear.channels,
            Gate(self.threshold_dbfs, "banded"),
            rule,
            settings=self._settings(),
            training=training or {},
        )

    def _settings(self) -> dict[str, Any]:
        if self.ear.kind != "texture":
            return {}
        return {"alone": self.ear.alone, "prior": self.prior.tolist(), "surprise": self.surprise.tolist()}


def prepare(ear: FeatureSpec, recordings: Sequence[Recording], *, through: Sequence[Codec] = ()) -> TrainingSet:
    """Listen to labelled recordings and choose what is learnt from them.

    Parameters
    ----------
    ear
        How they are heard.
    recordings
        With contact on both smooth and rough surfaces.
    through
        Codecs through which each recording is heard once more: a band that the line takes away ruins a head that never
        met its absence (docs/benchmark.md).

    Raises
    ------
    DatasetError
        If there is no contact in all rough or all smooth recordings.
    """
    ears = [ear, *(replace(ear, codec=codec) for codec in through)]
    tracks = [track for one in ears for track in listen(recordings, one)]
    threshold_dbfs = contact_threshold(tracks)
    masks = [track.touching() & (track.level_dbfs >= threshold_dbfs) for track in tracks]
    sizes = [int(mask.sum()) for mask in masks]
    rough = np.repeat([track.recording.label is Touch.ROUGH for track in tracks], sizes)
    if not 0 < rough.sum() < len(rough):
        raise DatasetError(
            f"{len(recordings)} recordings hold contact louder than {threshold_dbfs:.0f} dBFS with "
            f"{'rough' if rough.any() else 'smooth'} surfaces at most; learning wants rough and smooth ones"
        )
    prior = _average([track.description[mask] for track, mask in zip(tracks, masks, strict=True)])
    surprise = _surprise(ear, tracks, threshold_dbfs)
    heard = TrainingSet(ear, threshold_dbfs, prior, surprise, NO_EXAMPLES)
    features = [heard.features(track)[mask] for track, mask in zip(tracks, masks, strict=True)]
    names = sorted({track.recording.surface for track in tracks})
    surface = np.repeat([names.index(track.recording.surface) for track in tracks], sizes)
    height = np.repeat([_height(track.recording) for track in tracks], sizes)
    return replace(heard, examples=Examples(np.concatenate(features), rough, surface), height=height)


def contact_threshold(tracks: Sequence[FeatureTrack]) -> float:
    """Give the banded level, in whole dBFS, that one quiet window in a hundred exceeds."""
    quiet = np.concatenate([track.level_dbfs[track.quiet()] for track in tracks])
    return float(np.ceil(np.quantile(quiet, 1 - FALSE_CONTACTS))) if len(quiet) else ALWAYS_DBFS


def learn_surprise(moves: Sequence[NDArray[np.float32]]) -> Surprise:
    """Learn how far memories move on one surface, and so what is too far for one.

    Directions in which a finger's speed and press move them often count for little (Mahalanobis), in each channel by
    itself, so that a dead one changes nothing for the other.

    Parameters
    ----------
    moves
        Of recordings of one surface each, ``(windows, channels, values)``: see
        :func:`tactophone.training.features.feature_tracks.movements`.
    """
    moved = np.concatenate(moves).astype(np.float64)
    if not len(moved):
        return np.zeros((*moved.shape[1:], moved.shape[2]))
    spread = np.einsum("ncv,ncw->cvw", moved, moved) / len(moved)
    middle = np.trace(spread, axis1=1, axis2=2)[:, None, None] / moved.shape[2]
    whitening = np.linalg.cholesky(np.linalg.inv(spread + (RIDGE * middle + LEAST_VARIANCE) * np.eye(moved.shape[2])))
    far = np.square(np.einsum("ncv,cvw->ncw", moved, whitening)).sum(axis=-1).max(axis=-1)
    return np.asarray((whitening / np.sqrt(np.quantile(far, 1 - SURPRISED_SHARE))).round(5))


def _surprise(ear: FeatureSpec, tracks: Sequence[FeatureTrack], threshold_dbfs: float) -> Surprise:
    if ear.calm or ear.kind != "texture":
        return np.zeros((ear.channels, VALUES, VALUES))
    return learn_surprise([movements(track, threshold_dbfs) for track in tracks])


def _average(touches: Sequence[NDArray[np.float32]]) -> Moments:
    wide = np.concatenate(touches).astype(np.float64)
    return np.stack((wide.mean(axis=0), np.square(wide).mean(axis=0))).round(6)


def _height(recording: Recording) -> float:
    told = recording.known("ra_um")
    return float(np.log10(float(told))) if told else float("nan")
