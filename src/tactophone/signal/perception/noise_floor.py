"""The noise floor of a stream of levels, and the contact threshold that follows it; then the floor of a recording.

A threshold in dBFS is right for one gain and one room. Noise differs from a touch in that it is steady: on simulated
sound its level over 32 ms varies by half a decibel, that of a stroke by five or more. So the floor is the mean level of
steady stretches without contact, and the threshold lies over it by a margin chosen for the desired false-alarm rate.

What bounds it:

- A touch freezes the floor, so that a long stroke is not learnt as noise.
- It rises slowly (`RISE_DB`) and only while the level is steady, so that faint touches cannot creep it up.
- Noise that becomes louder at once is contact at first. If it stays steady for `LONGEST_TOUCH` s it is noise; for
  `KNOWN_AGAIN` s if the floor has been as high before, as after a loose plug that was pushed back.
- Digital silence is no floor: a source that pauses or a plug that is out must not make the gate open at its return.
- The threshold stays between `LOWEST_DBFS` and `HIGHEST_DBFS`.

A recording can be read twice, so that its threshold need not follow the noise: `measure_floor` finds one from the
quietest steady stretches in the recording itself, the same from the first sample on.
"""

import math
import statistics
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactophone.core.types import AudioBlock
from tactophone.signal.perception.levels import LoudnessRule, StepLevels

RATE = 100
"""Levels a second, about."""

FALSE_ALARMS = 0.01
"""Share of the time without contact that may count as contact."""

FLOOR_HOLD = 0.1
"""Seconds that a touch is held over silence within it, and that a false alarm therefore lasts at least."""

RELEASE_SHARE = 0.2
"""Of the margin: a touch ends where the level is so far under the threshold, still over most of the noise."""

START_RELEASE_DB = 3.0
"""The same in dB until the floor is known."""

FLOOR_CELL = 20
"""Levels, 0.2 s, that are evaluated together."""

STEADY_CELLS = 5
"""Cells, one second, that must agree before their level can be the floor."""

START_CELLS = 2
"""The same at the start, as recordings begin with half a second of silence or less."""

SPREAD_DB: Mapping[LoudnessRule, float] = MappingProxyType({"banded": 1.0, "rms": 2.4, "mean_absolute": 2.4})
"""Standard deviation within a cell up to which it may be noise: on simulated silence it is 0.34 (at most 0.66) by the
rule ``banded`` and 1.2 (2.3) by ``rms``, which has hum and motors in it; on simulated touches 3.4 (median)."""

WINDOW_SPREAD_DB = 1.6
"""As `SPREAD_DB`, for the banded level of a window. It covers half the gate's band and varies more (up to 0.9)."""

STEADY_SHARE = 0.5
"""Of that spread: standard deviation of the cells' means within which they agree, as a cell holds six levels that do
not overlap (0.29 and 1.0 at most on simulated silence)."""

LONGEST_TOUCH = 10.0
"""Seconds of steady contact after which it is taken as noise; a hand cannot slide so evenly, an arm may."""

KNOWN_AGAIN = 1.0
"""The same where the floor has been as high before."""

FALL_DB, RISE_DB = 2.0, 0.1
"""Most that the floor moves in a cell: 10 dB and 0.5 dB a second."""

FORGET_DB = 0.005
"""By how much a cell lowers the highest floor that is remembered: 1.5 dB a minute."""

SAME_DB = 2.0
"""Noise that is so little over a floor remembered may be that noise again."""

LEAST_DB, MOST_DB = 0.3, 2.5
"""Bounds of the noise's standard deviation, or a few odd cells would make the margin useless."""

HEAVY_TAIL = 10.0
"""How many times as often as gamma noise real noise with hum, motors and a room exceeds a level."""

FLOOR_DRIFT_DB = 0.5
"""Noise floors change by as much from one minute to the next."""

LOWEST_DBFS, HIGHEST_DBFS = -90.0, -12.0
"""Bounds of the threshold: under the noise of good converters, and where no touch could be louder than noise."""

FLOOR_SILENT_DBFS = -120.0
"""Level under which there is no microphone: the last bit of 16 is at -98 dBFS."""

FLOOR_WINDOW = 0.032
"""Seconds that one level covers."""


class NoiseFloor:
    """Follows the noise floor of a stream of levels, about `RATE` a second.

    ``start_dbfs`` is the threshold until the floor is known; ``spread_db`` the greatest standard deviation of noise
    within a cell, see `SPREAD_DB`.

    Attributes
    ----------
    threshold_dbfs, release_dbfs
        The threshold now, and the level under which a touch ends.
    known
        Whether the floor has been measured.

    >>> floor = NoiseFloor(-26.0)
    >>> for _ in range(100):
    ...     floor.push(-60.0, touching=False)
    >>> floor.known, -59.0 < floor.threshold_dbfs < -58.0
    (True, True)
    """

    def __init__(self, start_dbfs: float, *, spread_db: float = SPREAD_DB["banded"]) -> None:
        self._start_dbfs, self._spread_db = start_dbfs, spread_db
        self.reset()

    def reset(self) -> None:
        """Return to the initial state: the floor is unknown."""
        self.threshold_dbfs = self._start_dbfs
        self.release_dbfs = self._start_dbfs - START_RELEASE_DB
        self.known = False
        self._floor = self._highest = -math.inf
        self._variance = LEAST_DB**2
        self._cell: list[float] = []
        self._touched = False
        self._recent: deque[tuple[float, float]] = deque(maxlen=STEADY_CELLS)
        self._contact_cells = 0

    def adopt(self, other: "NoiseFloor") -> None:
        """Take over another's floor, measured on the same microphone by the same rule."""
        self.threshold_dbfs, self.release_dbfs, self.known = other.threshold_dbfs, other.release_dbfs, other.known
        self._floor, self._highest, self._variance = other._floor, other._highest, other._variance

    def push(self, level_dbfs: float, *, touching: bool) -> None:
        """Take the next level; NaN stands for sound that is not to be used."""
        if not level_dbfs > FLOOR_SILENT_DBFS:  # also where it is NaN
            self._cell, self._touched = [], False
            self._recent.clear()
            return
        self._cell.append(level_dbfs)
        self._touched |= touching
        if len(self._cell) < FLOOR_CELL:
            return
        mean, spread = statistics.fmean(self._cell), statistics.pstdev(self._cell)
        touched, cell = self._touched, self._cell
        self._cell, self._touched = [], False
        self._recent.append((mean, spread))
        self._contact_cells = self._contact_cells + 1 if touched else 0
        if not self.known or touched:
            self._learn_from_steady(mean)
        else:
            self._follow(mean, spread, cell)

    def _learn_from_steady(self, mean: float) -> None:
        """Take a steady level as the floor: at the start, or where contact has lasted for too long to be one."""
        waited = self._contact_cells * FLOOR_CELL / RATE
        enough = KNOWN_AGAIN if mean < self._highest + SAME_DB else LONGEST_TOUCH
        least = STEADY_CELLS if self.known else START_CELLS
        if is_steady(self._recent, spread_db=self._spread_db, least=least) and (not self.known or waited >= enough):
            self._floor = statistics.fmean(mean for mean, _ in self._recent)
            spreads = statistics.fmean(spread**2 for _, spread in self._recent)
            self._variance = _bounded(spreads + statistics.pvariance([mean for mean, _ in self._recent]))
            self.known = True
            self._update()

    def _follow(self, mean: float, spread: float, cell: list[float]) -> None:
        """Move the floor a little towards a cell without contact."""
        away = mean - self._floor
        # Falling is always right, as nothing is quieter than silence; rising only where the cell looks like noise.
        rise = RISE_DB if spread <= self._spread_db else 0.0
        self._floor += min(max(0.2 * away, -FALL_DB), rise)
        if abs(away) < MOST_DB:
            square = statistics.fmean((level - mean) ** 2 for level in cell) + away**2
            self._variance = _bounded(self._variance + 0.05 * (square - self._variance))
        self._update()

    def _update(self) -> None:
        self._highest = max(self._floor, self._highest - FORGET_DB)
        margin = margin_db(math.sqrt(self._variance), FALSE_ALARMS)
        self.threshold_dbfs = min(max(self._floor + margin, LOWEST_DBFS), HIGHEST_DBFS)
        self.release_dbfs = self.threshold_dbfs - RELEASE_SHARE * margin


def margin_db(spread_db: float, false_alarms: float) -> float:
    """Return how far over its mean, in dB, noise is contact for a share of the time.

    The power of noise is gamma distributed, with a shape that follows from the standard deviation of its level; its
    quantile is Wilson and Hilferty's (Proc. Natl. Acad. Sci. 17, 684, 1931). Each exceedance lasts
    at least `FLOOR_HOLD`.

    >>> round(margin_db(0.5, 0.01), 2), round(margin_db(1.5, 0.01), 2)
    (2.12, 4.78)
    """
    spread_db = max(spread_db, LEAST_DB)
    shape = (10 / math.log(10) / spread_db) ** 2
    chance = false_alarms * FLOOR_WINDOW / (FLOOR_WINDOW + FLOOR_HOLD) / HEAVY_TAIL
    z = statistics.NormalDist().inv_cdf(1 - chance)
    ninth = 1 / (9 * shape)
    return FLOOR_DRIFT_DB + 30 * math.log10(1 - ninth + z * math.sqrt(ninth))


def is_steady(cells: Sequence[tuple[float, float]], *, spread_db: float, least: int = STEADY_CELLS) -> bool:
    """Whether the means and spreads of ``least`` cells or more are those of noise."""
    if len(cells) < least:
        return False
    means, spreads = np.array(cells).T
    return bool(means.std() <= STEADY_SHARE * spread_db and spreads.max() <= spread_db)


def _bounded(variance: float) -> float:
    return min(max(variance, LEAST_DB**2), MOST_DB**2)


SAME_FLOOR_DB = 2.0
"""Cells so near the quietest steady one belong to the same floor."""

LEAST_CELLS = 2
"""Steady cells (0.2 s each) that show a floor: strokes have single ones too."""

UNDER_DB, MOST_UNDER = 3.0, 0.02
"""Nothing is quieter than silence: the share of levels that may lie so far under the floor. Of steady simulated noise
none does; a stroke that was steady for a moment has quieter ones before and after."""

FLOOR_FADE = 10
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
        return not math.isnan(self.floor_dbfs)


def measure_floor(
    blocks: Iterable[AudioBlock], *, sample_rate: int, rule: LoudnessRule, false_alarms: float = FALSE_ALARMS
) -> RecordingFloor:
    """Measure the noise floor of a recording.

    ``false_alarms`` is the wanted share of the time without contact that counts as contact.
    """
    levels = _levels(blocks, sample_rate=sample_rate, rule=rule)
    parts = (levels[at : at + FLOOR_CELL] for at in range(0, len(levels) - FLOOR_CELL + 1, FLOOR_CELL // 2))
    cells = [(statistics.fmean(part), statistics.pstdev(part)) for part in parts]
    loudest = max(levels, default=-math.inf)
    steady = sorted(cell for cell in cells if cell[1] <= SPREAD_DB[rule])
    same = [cell for cell in steady if cell[0] <= steady[0][0] + SAME_FLOOR_DB]
    if len(same) < LEAST_CELLS or same[0][0] > min(mean for mean, _ in cells) + SAME_FLOOR_DB:
        return RecordingFloor(LOWEST_DBFS, math.nan, loudest)
    floor = statistics.fmean(mean for mean, _ in same)
    inner = levels[FLOOR_FADE:-FLOOR_FADE]
    if sum(level < floor - UNDER_DB for level in inner) > MOST_UNDER * len(inner):
        return RecordingFloor(LOWEST_DBFS, math.nan, loudest)
    spread = math.sqrt(statistics.fmean(spread**2 + (mean - floor) ** 2 for mean, spread in same))
    threshold = min(max(floor + margin_db(spread, false_alarms), LOWEST_DBFS), HIGHEST_DBFS)
    return RecordingFloor(threshold, floor, loudest)


def _levels(blocks: Iterable[AudioBlock], *, sample_rate: int, rule: LoudnessRule) -> list[float]:
    """Return the level over 32 ms in dBFS a hundred times a second, without digital silence."""
    steps = StepLevels(rule, sample_rate=sample_rate)
    powers = np.concatenate([np.zeros(0), *(steps.push(block) for block in blocks)])
    if len(powers) < steps.count(FLOOR_WINDOW):
        return []
    totals = sliding_window_view(powers, steps.count(FLOOR_WINDOW))[:: steps.count(1 / RATE)].mean(axis=1).tolist()
    levels = (20 / steps.power * math.log10(total) for total in totals if total > 0)
    return [level for level in levels if level > FLOOR_SILENT_DBFS]
