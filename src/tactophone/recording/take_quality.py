"""An instant verdict on a take: enough contact, nothing clipped, no fault, and a pressure unlike the last one's."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tactophone.perception.sensor_health.faults import FaultWatch, Kind, Reference, SensorFault
from tactophone.perception.sensor_health.signal_statistics import ChannelStatistics, SignalStatistics
from tactophone.recording.protocol import PROTOCOL, TakePlan
from tactophone.types import CONTACT, AudioBlock

LEAST_CONTACT = 0.1
"""Share of a take: light touches of smooth things are heard for a fifth of the time in the paper's own set-up."""

CLIPPED_SHARE = 5e-3
"""More than single peaks of hard strokes."""
PRESSURE_STEP_DB = 1.5
"""By which one pressure must be louder than the one under it: twice what two takes of one pressure differ by."""

LOUD = 75
"""Percentile of a take's levels that stands for its pressure: pauses are under it."""


@dataclass(frozen=True, slots=True)
class TakeLevels:
    """A take in numbers: shares of time in contact and of samples clipped, the loud parts' level, faults named."""

    duration: float
    contact: float
    clipped: float
    level_dbfs: float
    faults: tuple[SensorFault, ...] = ()


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is wrong with a take; nothing, if it is good."""

    complaints: tuple[str, ...]

    @property
    def good(self) -> bool:
        """Whether the take can be kept as it is."""
        return not self.complaints

    def __str__(self) -> str:
        return "; ".join(self.complaints) or "good"


class TakeMeter:
    """Listens to a take as it is recorded."""

    def __init__(self, sample_rate: int, reference: Reference) -> None:
        self._rate, self._threshold_dbfs = sample_rate, reference.threshold_dbfs
        self._signs = SignalStatistics(sample_rate)
        self._watch = FaultWatch(sample_rate, reference)
        self._vitals: list[ChannelStatistics] = []
        self._faults: dict[SensorFault, None] = {}
        self._size = 0

    def push(self, block: AudioBlock) -> None:
        """Take sound in."""
        self._size += block.size
        self._vitals += self._signs.push(block)
        self._watch.push(block)
        self._faults |= dict.fromkeys(self._watch.faults)

    @property
    def heard(self) -> TakeLevels:
        """The take so far."""
        if not self._vitals:
            return TakeLevels(self._size / self._rate, 0.0, 0.0, -np.inf)
        levels = np.array([one.level_dbfs[CONTACT] for one in self._vitals])
        return TakeLevels(
            self._size / self._rate,
            float(np.mean(levels >= self._threshold_dbfs)),
            float(np.mean([max(one.clipped) for one in self._vitals])),
            float(np.percentile(levels, LOUD)),
            tuple(self._faults),
        )


def judge(take: TakePlan, heard: TakeLevels, others: Mapping[str, float], *, duration: float) -> Verdict:
    """Judge a take.

    Parameters
    ----------
    take, heard
        The take, and what was heard in it.
    others
        Level in dBFS of the takes already made of this object, by name.
    duration
        Seconds that were wanted.
    """
    # One bang clips and is over; how much of the take is clipped is asked below.
    found = [str(fault) for fault in heard.faults if fault.kind is not Kind.CLIPPED]
    if heard.duration < 0.99 * duration:
        found.append(f"ends after {heard.duration:.1f} of {duration:g} s")
    if heard.contact < LEAST_CONTACT:
        found.append(f"touches for {heard.contact:.0%} of the time only: stroke without long pauses, or press harder")
    if heard.clipped > CLIPPED_SHARE:
        found.append(f"{heard.clipped:.1%} is clipped: turn the gain down, calibrate again and begin anew")
    lighter = _lighter(take)
    if lighter and lighter.name in others:
        step_db = heard.level_dbfs - others[lighter.name]
        if step_db < PRESSURE_STEP_DB:
            found.append(f"sounds no more pressed than {lighter.pressure} ({step_db:+.1f} dB): press harder")
    return Verdict(tuple(found))


def _lighter(take: TakePlan) -> TakePlan | None:
    """The take of the same stroke with the next lighter pressure."""
    same = [one for one in PROTOCOL if one.stroke == take.stroke]
    place = same.index(take)
    return same[place - 1] if place else None
