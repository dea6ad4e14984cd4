"""Predictions made by hand."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactophone.core.recordings.values import Recording, Segment
from tactophone.core.types import Touch
from tactophone_lab.evaluation.predict import TakePredictions

HOP = 0.01


def predicted(
    rough: Sequence[float],
    *,
    label: Touch | None,
    segments: Sequence[Segment] = (),
    surface: str = "slate",
    contact: Sequence[bool] | None = None,
    none: float = 0.0,
    slides: str = "",
) -> TakePredictions:
    """Predictions every 10 ms with these shares of rough."""
    share = np.array(rough, np.float32)
    rows = np.stack(
        [np.full_like(share, none), (1 - none) * (1 - share), (1 - none) * share],
        axis=1,
    )
    recording = Recording(
        Path(f"{surface}.wav"),
        surface,
        label,
        segments=tuple(segments),
        properties={"slides": slides},
    )
    open_gate = np.ones(len(share), bool) if contact is None else np.array(contact)
    return TakePredictions(
        recording, HOP * np.arange(1, len(share) + 1), rows, open_gate
    )


def felt_rough(
    updates: int,
    *,
    at: Iterable[int],
    label: Touch | None,
    segments: Sequence[Segment] = (),
    slides: str = "",
) -> TakePredictions:
    """Predictions every 10 ms of which these were felt as rough, all others as
    smooth."""
    touch = np.full(updates, Touch.SMOOTH, np.int8)
    touch[list(at)] = Touch.ROUGH
    take = predicted([0.5] * updates, label=label, segments=segments, slides=slides)
    return replace(take, touch=touch, unknown=np.zeros(updates, bool))
