"""Trains our own detector: describe, remember, fit a head, write the model file."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Dataset, Recording
from tactophone.errors import DatasetError
from tactophone.link import Codec
from tactophone.perception import DecisionRule, Gate, ModelCard
from tactophone.training.export import write_graph
from tactophone.training.head import Examples, Head, fit_head
from tactophone.training.headgraph import build_head_graph
from tactophone.training.touches import HOP, RATE, SIZE, Track, listen, remember
from tactophone.types import Touch

FALSE_CONTACTS = 0.01
"""Share of windows without contact that the gate's threshold lets through."""

ALWAYS_DBFS = -120.0
"""Threshold where training sound has no silence to learn one from: everything counts as contact."""

ABSTAIN_FROM = 0.5


@dataclass(frozen=True, slots=True)
class TextureCourse:
    """Everything that decides our own detector but the sound.

    Parameters
    ----------
    channels
        2, or 1: contact, or air where there is no contact microphone.
    codec
        Training sound is passed through it and back.
    """

    channels: int = 2
    codec: Codec | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """What a course makes of recordings: contact's threshold, the average touch, and the windows to learn from."""

    tracks: tuple[Track, ...]
    threshold_dbfs: float
    prior: NDArray[np.float64]
    examples: Examples


def prepare(course: TextureCourse, recordings: Sequence[Recording]) -> Lesson:
    """Listen to recordings and choose what is learnt from them.

    Raises
    ------
    DatasetError
        If there is no contact in all rough or all smooth recordings.
    """
    tracks = listen(recordings, channels=course.channels, codec=course.codec)
    threshold_dbfs = contact_threshold(tracks)
    masks = [track.touching() & (track.level_dbfs >= threshold_dbfs) for track in tracks]
    touches = np.concatenate([track.description[mask] for track, mask in zip(tracks, masks, strict=True)])
    if not len(touches):
        raise DatasetError(f"{len(recordings)} recordings hold no contact louder than {threshold_dbfs:.0f} dBFS")
    wide = touches.astype(np.float64)
    prior = np.stack((wide.mean(axis=0), np.square(wide).mean(axis=0)))
    examples = _examples(tracks, masks, threshold_dbfs=threshold_dbfs, prior=prior)
    if not 0 < examples.rough.mean() < 1:
        raise DatasetError("learning wants recordings of rough and of smooth surfaces, both with contact")
    return Lesson(tuple(tracks), threshold_dbfs, prior, examples)


def contact_threshold(tracks: Sequence[Track]) -> float:
    """Give the banded level, in whole dBFS, that one quiet window in a hundred exceeds."""
    quiet = np.concatenate([track.level_dbfs[track.quiet()] for track in tracks])
    return float(np.ceil(np.quantile(quiet, 1 - FALSE_CONTACTS))) if len(quiet) else ALWAYS_DBFS


def texture_card(lesson: Lesson, *, name: str, channels: int, training: dict[str, Any] | None = None) -> ModelCard:
    """Describe a model of kind ``texture``."""
    return ModelCard(
        name,
        "texture",
        RATE,
        SIZE,
        Fraction(HOP),
        channels,
        Gate(lesson.threshold_dbfs, "banded"),
        DecisionRule(abstain_from=ABSTAIN_FROM),
        settings={"prior": lesson.prior.round(6).tolist()},
        training=training or {},
    )


def fit(lesson: Lesson, course: TextureCourse) -> Head:
    """Fit the head."""
    return fit_head(lesson.examples, channels=course.channels)


def train_texture(
    path: Path, dataset: Dataset, course: TextureCourse, *, name: str = "ours", licence: str = ""
) -> ModelCard:
    """Train on labelled recordings and write the model file."""
    lesson = prepare(course, dataset.recordings)
    facts = {
        "recipe": "texture",
        "dataset": dataset.name,
        "surfaces": len(dataset.surfaces),
        "sha256": dataset.fingerprint,
        "codec": str(course.codec or "none"),
    }
    card = texture_card(lesson, name=name, channels=course.channels, training=facts)
    write_graph(path, build_head_graph(fit(lesson, course), channels=course.channels), card)
    return card


def _examples(
    tracks: Sequence[Track], masks: Sequence[NDArray[np.bool_]], *, threshold_dbfs: float, prior: NDArray[np.float64]
) -> Examples:
    number = {name: place for place, name in enumerate(sorted({track.recording.surface for track in tracks}))}
    sizes = [int(mask.sum()) for mask in masks]
    features = [
        remember(track, threshold_dbfs).features(prior, track.present)[mask]
        for track, mask in zip(tracks, masks, strict=True)
    ]
    return Examples(
        np.concatenate(features),
        np.repeat([track.recording.label is Touch.ROUGH for track in tracks], sizes),
        np.repeat([number[track.recording.surface] for track in tracks], sizes),
    )
