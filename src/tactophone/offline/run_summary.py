"""What was felt, held against what was true: the few numbers that a demonstration ends with."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Segment
from tactophone.types import Touch

FELT = 0.02
"""Amplitude from which a vibration counts as felt, -34 dB: well under the paper's smooth, at -25 dBFS."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """How the telephone did.

    Parameters
    ----------
    smooth_right, rough_right
        Share of beliefs that were right while such a stone was touched.
    false_bumps
        How often smooth was felt as rough, counted as stretches.
    touch_to_felt
        Seconds from each touch to the vibration, median.
    lift_to_silence
        Seconds from each end of touch to the command for silence, median.
    """

    smooth_right: float
    rough_right: float
    false_bumps: int
    touch_to_felt: float
    lift_to_silence: float


def measure(timeline: dict[str, NDArray[Any]], truth: tuple[Segment, ...]) -> Numbers:
    """Hold what was felt against what was true."""
    time, touch, amplitude = timeline["time"], timeline["touch"], timeline["amplitude"]
    inside = {label: _inside(time, truth, label) for label in (Touch.SMOOTH, Touch.ROUGH)}
    bumps = inside[Touch.SMOOTH] & (touch == Touch.ROUGH)
    touched = [one.start for one, before in zip(truth[1:], truth, strict=False) if one.contact and not before.contact]
    left = [one.start for one, before in zip(truth[1:], truth, strict=False) if before.contact and not one.contact]
    return Numbers(
        smooth_right=_share(touch[inside[Touch.SMOOTH]] == Touch.SMOOTH),
        rough_right=_share(touch[inside[Touch.ROUGH]] == Touch.ROUGH),
        false_bumps=int((np.diff(bumps.astype(int)) > 0).sum()),
        touch_to_felt=_delay(time, amplitude >= FELT, touched),
        lift_to_silence=_delay(time, amplitude == 0, left),
    )


def _share(right: NDArray[np.bool_]) -> float:
    return float(right.mean()) if len(right) else float("nan")


def _inside(time: NDArray[Any], truth: tuple[Segment, ...], label: Touch) -> NDArray[np.bool_]:
    inside = np.zeros(len(time), bool)
    for one in truth:
        if one.label is label:
            inside |= (time >= one.start) & (time < one.end)
    return inside


def _delay(time: NDArray[Any], when: NDArray[np.bool_], events: list[float]) -> float:
    """Median time in s from an event to the first line that fulfils something."""
    found = [time[when & (time >= event)] for event in events]
    delays = [float(after[0] - event) for after, event in zip(found, events, strict=True) if len(after)]
    return float(np.median(delays)) if delays else float("nan")
