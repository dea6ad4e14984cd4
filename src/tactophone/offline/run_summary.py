"""Scores of a run against its labels: the few numbers that a demonstration prints."""

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Segment
from tactophone.types import Touch

PERCEPTIBLE = 0.02
"""Amplitude from which a vibration can be felt, -34 dB: well under the paper's smooth, at -25 dBFS."""


@dataclass(frozen=True, slots=True)
class RunScores:
    """Scores of a run."""

    smooth_right: float
    rough_right: float
    """`smooth_right` and `rough_right`: share of correct predictions while a smooth, or rough, stone was touched."""
    false_bumps: int
    """Number of times that smooth was rendered as rough."""
    touch_to_vibration: float
    """Median time in s from the start of a contact to a vibration that can be felt."""
    lift_to_silence: float
    """Median time in s from the end of a contact to the command for silence."""


def score_run(timeline: dict[str, NDArray[Any]], truth: tuple[Segment, ...]) -> RunScores:
    """Score a run's timeline against its labelled segments; a score without data is NaN."""
    time, touch, amplitude = timeline["time"], timeline["touch"], timeline["amplitude"]
    smooth, rough = (_inside(time, truth, label) for label in (Touch.SMOOTH, Touch.ROUGH))
    bumps = smooth & (touch == Touch.ROUGH)
    pairs = list(itertools.pairwise(truth))
    touched = [after.start for before, after in pairs if after.contact and not before.contact]
    lifted = [after.start for before, after in pairs if before.contact and not after.contact]
    return RunScores(
        smooth_right=_share(touch[smooth] == Touch.SMOOTH),
        rough_right=_share(touch[rough] == Touch.ROUGH),
        false_bumps=int((np.diff(bumps.astype(int)) > 0).sum()),
        touch_to_vibration=_delay(time, amplitude >= PERCEPTIBLE, touched),
        lift_to_silence=_delay(time, amplitude == 0, lifted),
    )


def _share(right: NDArray[np.bool_]) -> float:
    return float(right.mean()) if len(right) else float("nan")


def _inside(time: NDArray[Any], truth: tuple[Segment, ...], label: Touch) -> NDArray[np.bool_]:
    """Return which times lie in segments of a label."""
    inside = np.zeros(len(time), bool)
    for segment in truth:
        if segment.label is label:
            inside |= (time >= segment.start) & (time < segment.end)
    return inside


def _delay(time: NDArray[Any], condition: NDArray[np.bool_], events: list[float]) -> float:
    """Return the median time in s from each event to the first line that meets the condition."""
    found = [time[condition & (time >= event)] for event in events]
    delays = [float(after[0] - event) for after, event in zip(found, events, strict=True) if len(after)]
    return float(np.median(delays)) if delays else float("nan")
