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
from tactophone.training.head import Examples
from tactophone.training.touches import RATE, WINDOWS, Ear, Track, listen, remember
from tactophone.types import FloatArray, Touch

FALSE_CONTACTS = 0.01
"""Share of windows without contact that the gate's threshold lets through."""

ALWAYS_DBFS = -120.0
"""Threshold where training sound has no silence to learn one from: everything counts as contact."""

ABSTAIN_FROM = 0.5
"""Probability of *none* from which sound counts as unknown; only our own head ever claims it."""


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """What recordings come to.

    Parameters
    ----------
    ear
        How they were heard.
    threshold_dbfs
        Of contact.
    prior
        The average touch, for kind ``texture``: mean and mean square, ``(2, channels, VALUES)``.
    examples
        Windows in contact.
    height
        log10 of the surface's Ra in micrometres for each example; NaN where it is not known.
    """

    ear: Ear
    threshold_dbfs: float
    prior: NDArray[np.float64]
    examples: Examples
    height: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def features(self, track: Track) -> FloatArray:
        """Give the features that the live extractor gives, shape ``(windows, features)``."""
        return _features(track, self.ear, self.threshold_dbfs, self.prior)

    def card(self, name: str, *, training: dict[str, Any] | None = None, licence: str = "") -> ModelCard:
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
            DecisionRule(abstain_from=ABSTAIN_FROM),
            settings={"prior": self.prior.round(6).tolist()} if self.ear.kind == "texture" else {},
            training=training or {},
            licence=licence,
        )


def prepare(ear: Ear, recordings: Sequence[Recording], *, through: Sequence[Codec] = ()) -> Lesson:
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
    prior = _prior([track.description[mask] for track, mask in zip(tracks, masks, strict=True)])
    features = [_features(track, ear, threshold_dbfs, prior)[mask] for track, mask in zip(tracks, masks, strict=True)]
    names = sorted({track.recording.surface for track in tracks})
    surface = np.repeat([names.index(track.recording.surface) for track in tracks], sizes)
    height = np.repeat([_height(track.recording) for track in tracks], sizes)
    return Lesson(ear, threshold_dbfs, prior, Examples(np.concatenate(features), rough, surface), height)


def contact_threshold(tracks: Sequence[Track]) -> float:
    """Give the banded level, in whole dBFS, that one quiet window in a hundred exceeds."""
    quiet = np.concatenate([track.level_dbfs[track.quiet()] for track in tracks])
    return float(np.ceil(np.quantile(quiet, 1 - FALSE_CONTACTS))) if len(quiet) else ALWAYS_DBFS


def _prior(touches: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
    wide = np.concatenate(touches).astype(np.float64)
    return np.stack((wide.mean(axis=0), np.square(wide).mean(axis=0)))


def _features(track: Track, ear: Ear, threshold_dbfs: float, prior: NDArray[np.float64]) -> FloatArray:
    if ear.kind == "texture":
        return remember(track, threshold_dbfs).features(prior, track.present)
    return track.description


def _height(recording: Recording) -> float:
    told = recording.known("ra_um")
    return float(np.log10(float(told))) if told else float("nan")
