"""The quality of a take, known at its end: contact, clipping, sensor faults, and
pressure."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tactophone.core.microphones import CONTACT
from tactophone.core.types import AudioBlock
from tactophone.signal.perception.health import (
    FAULT_CLIPPED_SHARE,
    ChannelStatistics,
    FaultDetector,
    FaultKind,
    Reference,
    SensorFault,
    SignalStatistics,
    clipped_samples,
)
from tactophone_lab.simulation.takes import TAKES, Take

TAKE_MIN_CONTACT = 0.1
"""Share of a take: on the paper's set-up, light strokes on smooth objects exceed the
threshold for a fifth of it."""

PRESSURE_STEP_DB = 1.5
"""By which a pressure must be louder than the next lighter: twice what two takes of
equal pressure differ by."""

GOOD = "good"
"""Quality of a take without complaints, in the manifest too."""

LEVEL_PERCENTILE = 75
"""Percentile of a take's levels that represents its pressure: pauses are below it."""


@dataclass(frozen=True, slots=True)
class TakeLevels:
    """Measurements of a take."""

    duration: float
    """In s."""
    contact: float
    """Share of the time in contact."""
    clipped: float
    """Share of clipped samples, of the worse channel."""
    level_dbfs: float
    """75th percentile of the contact channel's level."""
    faults: tuple[SensorFault, ...] = ()
    """Sensor faults found."""


class TakeMeter:
    """Measures a take while it is recorded."""

    def __init__(self, sample_rate: int, reference: Reference) -> None:
        self._rate = sample_rate
        self._threshold_dbfs = reference.threshold_dbfs
        self._statistics = SignalStatistics(sample_rate)
        self._watch = FaultDetector(sample_rate, reference)
        self._history: list[ChannelStatistics] = []
        self._faults: dict[
            SensorFault, None
        ] = {}  # a dict keeps the order in which they appeared
        self._size, self._clipped = 0, np.zeros(1)

    def push(self, block: AudioBlock) -> None:
        self._size += block.size
        self._clipped = self._clipped + clipped_samples(block.samples.T).sum(axis=1)
        self._history += self._statistics.push(block)
        self._watch.push(block)
        self._faults |= dict.fromkeys(self._watch.faults)

    @property
    def levels(self) -> TakeLevels:
        duration = self._size / self._rate
        if not self._history:
            return TakeLevels(duration, 0.0, 0.0, -np.inf)
        levels = np.array(
            [statistics.level_dbfs[CONTACT] for statistics in self._history]
        )
        return TakeLevels(
            duration,
            float(np.mean(levels >= self._threshold_dbfs)),
            float(self._clipped.max() / self._size),
            float(np.percentile(levels, LEVEL_PERCENTILE)),
            tuple(self._faults),
        )


def assess_take(
    take: Take,
    levels: TakeLevels,
    other_levels: Mapping[str, float],
    *,
    duration: float,
    lost: str = "",
) -> str:
    """Return what is wrong with a take, or ``good``, given the levels in dBFS of this
    object's other takes by name, and what sound it lacks, in words."""
    # A single bang raises the fault "clipped" for a moment; the clipped share of the
    # whole take is checked below.
    complaints = [
        str(fault) for fault in levels.faults if fault.kind is not FaultKind.CLIPPED
    ]
    if lost:
        complaints.append(lost)
    if levels.duration < 0.99 * duration:
        complaints.append(f"ends after {levels.duration:.1f} of {duration:g} s")
    if levels.contact < TAKE_MIN_CONTACT:
        complaints.append(
            f"contact for only {levels.contact:.0%} of the time: pause less, or press "
            "harder"
        )
    if levels.clipped > FAULT_CLIPPED_SHARE:
        complaints.append(
            f"{levels.clipped:.1%} is clipped: turn the gain down, calibrate again "
            "and start over"
        )
    # The take of the same stroke with the next lighter pressure, if there is one.
    same_stroke = [plan for plan in TAKES if plan.stroke == take.stroke]
    place = same_stroke.index(take)
    lighter = same_stroke[place - 1] if place else None
    if lighter and lighter.name in other_levels:
        step_db = levels.level_dbfs - other_levels[lighter.name]
        if step_db < PRESSURE_STEP_DB:
            complaints.append(
                f"not louder than {lighter.pressure} pressure ({step_db:+.1f} dB): "
                "press harder"
            )
    return "; ".join(complaints) or GOOD
