"""The contact threshold of a recording, from the quietest steady stretches in the recording itself.

A recording can be read twice, so that its threshold need not follow the noise as a live one does
(:mod:`tactophone.perception.noise_floor`): it is the same from the first sample on.
"""

import math
import statistics
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactophone.perception.contact import HEARTBEAT, SLOW
from tactophone.perception.features.loudness import LoudnessRule
from tactophone.perception.noise_floor import (
    CELL,
    FALSE_ALARMS,
    HIGHEST_DBFS,
    LOWEST_DBFS,
    SILENT_DBFS,
    SPREAD_DB,
    margin_db,
)
from tactophone.perception.step_levels import StepLevels
from tactophone.types import AudioBlock

SAME_FLOOR_DB = 2.0
"""Cells so near the quietest steady one belong to the same floor."""

LEAST_CELLS = 2
"""Steady cells (0.2 s each) that show a floor: strokes have single ones too."""

UNDER_DB, MOST_UNDER = 3.0, 0.02
"""Nothing is quieter than silence: the share of levels that may lie so far under the floor. Of steady simulated noise
none does; a stroke that was steady for a moment has quieter ones before and after."""

FADE = 10
"""Levels, 0.1 s, at either end that are not counted there: an editor's fade is quieter than silence."""


@dataclass(frozen=True, slots=True)
class RecordingFloor:
    """What a recording shows of its noise."""

    threshold_dbfs: float
    """Contact threshold; where the floor is unknown, the lowest: all sound is contact."""
    floor_dbfs: float
    """Level of the noise; NaN where it is unknown."""
    loudest_dbfs: float
    """Greatest level over 32 ms."""

    @property
    def known(self) -> bool:
        """Whether the recording holds a noise floor."""
        return not math.isnan(self.floor_dbfs)


def measure_floor(
    blocks: Iterable[AudioBlock], *, sample_rate: int, rule: LoudnessRule, false_alarms: float = FALSE_ALARMS
) -> RecordingFloor:
    """Measure the noise floor of a recording.

    ``false_alarms`` is the wanted share of the time without contact that counts as contact.
    """
    levels = _levels(blocks, sample_rate=sample_rate, rule=rule)
    cells = [_moments(levels[at : at + CELL]) for at in range(0, len(levels) - CELL + 1, CELL // 2)]
    loudest = max(levels, default=-math.inf)
    steady = sorted(cell for cell in cells if cell[1] <= SPREAD_DB[rule])
    same = [cell for cell in steady if cell[0] <= steady[0][0] + SAME_FLOOR_DB]
    if len(same) < LEAST_CELLS or same[0][0] > min(mean for mean, _ in cells) + SAME_FLOOR_DB:
        return RecordingFloor(LOWEST_DBFS, math.nan, loudest)
    floor = statistics.fmean(mean for mean, _ in same)
    inner = levels[FADE:-FADE]
    if sum(level < floor - UNDER_DB for level in inner) > MOST_UNDER * len(inner):
        return RecordingFloor(LOWEST_DBFS, math.nan, loudest)
    spread = math.sqrt(statistics.fmean(spread**2 + (mean - floor) ** 2 for mean, spread in same))
    threshold = min(max(floor + margin_db(spread, false_alarms), LOWEST_DBFS), HIGHEST_DBFS)
    return RecordingFloor(threshold, floor, loudest)


def _levels(blocks: Iterable[AudioBlock], *, sample_rate: int, rule: LoudnessRule) -> list[float]:
    """Return the level over 32 ms in dBFS a hundred times a second, without digital silence."""
    steps = StepLevels(rule, sample_rate=sample_rate)
    powers = np.concatenate([np.zeros(0), *(steps.push(block) for block in blocks)])
    if len(powers) < steps.count(SLOW):
        return []
    totals = sliding_window_view(powers, steps.count(SLOW))[:: steps.count(HEARTBEAT)].mean(axis=1).tolist()
    levels = (20 / steps.power * math.log10(total) for total in totals if total > 0)
    return [level for level in levels if level > SILENT_DBFS]


def _moments(levels: list[float]) -> tuple[float, float]:
    return statistics.fmean(levels), statistics.pstdev(levels)
