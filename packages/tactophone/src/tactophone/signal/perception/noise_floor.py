"""The noise floor of the contact microphone: the one that gate and windows read; then
the floor of a recording.

A threshold in dBFS is right for one gain and one room. So sound is compared with its
own noise: the level of each of sixteen bands, and that of the gate, has a floor that
follows it. It settles where one level in six is quieter.

What bounds it:

- A touch slows its rise, so that a long stroke is not learnt as noise.
- Noise that becomes louder at once is contact at first. If it stays steady for
  `LONGEST_TOUCH` s it is noise; for `KNOWN_AGAIN` s if the floor has been as high
  before, as after a loose plug that was pushed back.
- Digital silence is no floor: a source that pauses or a plug that is out must not make
  the gate open at its return.
- The gate's threshold stays between `LOWEST_DBFS` and `HIGHEST_DBFS`.

A recording can be read twice: `measure_floor` finds the floor of its quietest steady
stretches, from which the live one begins.
"""

import functools
import math
import statistics
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Generic, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.core.microphones import CONTACT
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.signal.perception.levels import (
    BANDS,
    BANDS_HOP,
    SLOW,
    BandLevels,
    LoudnessRule,
    StepLevels,
)
from tactophone.signal.silences import TOUCH_HOLD

Floats = NDArray[np.float64]

RATE = 100
"""Levels a second that a recording's floor is measured by, about."""

CELL_HOPS = 40
"""Levels of the live floor, 0.2 s, whose means tell whether contact is steady."""

FALSE_ALARMS = 0.01
"""Share of the time without contact that may count as contact."""

SHORTEST_ALARM = SLOW + TOUCH_HOLD
"""Seconds that a false alarm lasts at least: what the gate's level covers, and its
hold."""

RELEASE_SHARE = 0.2
"""Of the margin: a touch ends where the level is so far under the threshold, still over
most of the noise."""

START_RELEASE_DB = 3.0
"""The same in dB until the floor is known."""

FLOOR_CELL = 20
"""Levels of a recording, 0.2 s, that are evaluated together."""

START_HOPS = 80
"""Levels, 0.4 s, in which the floor is first measured, as recordings begin with half a
second of silence or less."""

SPREAD_DB: Mapping[LoudnessRule, float] = MappingProxyType(
    {"banded": 1.0, "rms": 2.4, "mean_absolute": 2.4}
)
"""Standard deviation within a cell up to which it may be noise: on simulated silence it
is 0.34 (at most 0.66) by the rule ``banded`` and 1.2 (2.3) by ``rms``, which has hum
and motors in it; on simulated touches 3.4 (median)."""

STEADY_DB = 0.8
"""Standard deviation of means over 0.2 s, five of them, in the median band up to which
contact may be noise."""

LONGEST_TOUCH = 10.0
"""Seconds of steady contact after which it is taken as noise; a hand cannot slide so
evenly, an arm may."""

KNOWN_AGAIN = 1.0
"""The same where the floor has been as high before."""

FALL = 10.0
"""Most that the floor moves down, in dB/s."""

RISE = 2.0
"""Most that the floor moves up without a touch, in dB/s."""

RISE_TOUCHED = 0.2
"""Most that the floor moves up during a touch, in dB/s."""

APPROACH = 0.05
"""Share of the difference to its level that the floor moves in a hop, within those
bounds."""

QUIETER = 0.25
"""Quantile of the levels that is the floor at the start, and after contact that was
noise."""

SPREAD_SHARE = 0.002
"""Share by which the estimate of the noise's variance follows a level: within 2.5 s."""

FORGET_DB = 1.25e-4
"""By how much a hop lowers the highest floor that is remembered: 1.5 dB a minute."""

BAND_MARGIN_DB = 5.0
"""How far over its floor a band is heard. It is an edge, not a plateau: with 4 dB the
motors of the one robot arm that was recorded are heard for half of the time
(docs/research/contact.md)."""

LOWEST_FLOOR_DBFS = -125.0
"""Of a band."""

SAME_DB = 2.0
"""Noise that is so little over a floor remembered may be that noise again."""

LEAST_DB = 0.3
"""Least standard deviation of the noise: a few odd cells would make the margin
useless."""

MOST_DB = 2.5
"""Greatest standard deviation of the noise, for the same reason."""

HEAVY_TAIL = 10.0
"""How many times as often as gamma noise real noise with hum, motors and a room exceeds
a level."""

FLOOR_DRIFT_DB = 0.5
"""Noise floors change by as much from one minute to the next."""

LOWEST_DBFS = -90.0
"""Lowest threshold: under the noise of good converters."""

HIGHEST_DBFS = -12.0
"""Highest threshold: over it no touch could be louder than noise."""

FLOOR_SILENT_DBFS = -120.0
"""Level under which there is no microphone: the last bit of 16 is at -98 dBFS."""

FLOOR_WINDOW = SLOW
"""Seconds that one level covers: as the slow one of the gate, whose threshold follows
it."""


class NoiseFloor:
    """Follows the level of the gate, and of the bands where there are any, every 5 ms.

    ``start_dbfs`` is the threshold until the floor is known; ``spread_db`` the greatest
    standard deviation of the gate's level by which it may be noise, see `SPREAD_DB`.

    - ``threshold_dbfs``, ``release_dbfs``: the gate's threshold now, and the level
      under which a touch ends.
    - ``known``: whether the floor has been measured.
    - ``margin_db``: how far a band must exceed its floor to be heard.

    >>> floor = NoiseFloor(-26.0)
    >>> for _ in range(100):
    ...     floor.push(-60.0, np.full(16, -75.0), touching=False, loud=False)
    >>> floor.known, -59.0 < floor.threshold_dbfs < -58.0, float(floor.bands[0])
    (True, True, -75.0)
    """

    def __init__(
        self, start_dbfs: float, *, spread_db: float = SPREAD_DB["banded"]
    ) -> None:
        self._start_dbfs = start_dbfs
        self._spread_db = spread_db
        self.margin_db = BAND_MARGIN_DB
        self._begin = None
        self.reset()

    _begin: "RecordingFloor | None"

    def reset(self) -> None:
        """Return to the initial state: the floor is unknown, or that of the recording
        that is read."""
        self.threshold_dbfs = self._start_dbfs
        self.release_dbfs = self._start_dbfs - START_RELEASE_DB
        self.known = False
        # The highest floor that is remembered, and the variance of the noise.
        self._highest = -math.inf
        self._variance = LEAST_DB**2
        # The floor: of each band, and last of the gate's level.
        self._levels = np.zeros(0)
        self._recent: deque[Floats] = deque(maxlen=5 * CELL_HOPS)
        # Hops of sound so far, and those since contact began.
        self._hops = 0
        self._touched = 0
        if self._begin:
            self.begin(self._begin)

    def begin(self, recording: "RecordingFloor") -> None:
        """Begin at the floor of a recording, now and after each reset."""
        self._begin = recording
        if recording.known:
            # The floor of a level lies a standard deviation under its mean.
            gate_floor = recording.floor_dbfs - recording.spread_db
            self._learn(np.append(recording.bands_dbfs, gate_floor))
            self._variance = recording.spread_db**2
            self._update()

    @property
    def bands(self) -> Floats:
        """Floor of each band in dBFS."""
        return self._levels[:-1]

    def adopt(self, other: "NoiseFloor") -> None:
        """Take over another's floor, measured on the same microphone by the same
        rule."""
        self.threshold_dbfs = other.threshold_dbfs
        self.release_dbfs = other.release_dbfs
        self.known = other.known
        self.margin_db = other.margin_db
        self._levels = other._levels.copy()
        self._highest = other._highest
        self._variance = other._variance

    def push(
        self,
        level_dbfs: float,
        bands: Floats,
        *,
        touching: bool,
        loud: bool,
        hops: int = 1,
    ) -> None:
        """Take the next levels, whether there is contact, and whether the gate's own
        level says so.

        A level of NaN stands for sound that is not to be used. ``hops``: since the last
        levels; with more than one, the floor moves as far as in so many.
        """
        if not level_dbfs > FLOOR_SILENT_DBFS:  # also where it is NaN
            self._recent.clear()
            self._touched = 0
            return
        levels = np.empty(len(bands) + 1)
        levels[:-1] = bands
        levels[-1] = level_dbfs
        self._recent.append(levels)
        self._hops += 1
        if not self.known:
            if len(self._recent) >= START_HOPS and self._hops % CELL_HOPS == 0:
                self._find_start()
            return
        self._touched = self._touched + hops if touching or loud else 0
        # Contact that is too long and steady is noise, and its floor is learnt anew.
        if self._touched and self._touched % CELL_HOPS == 0 and self._is_noise():
            self._learn(np.quantile(self._recent, QUIETER, axis=0))
            self._touched = 0
        self._follow(levels, touching=touching, loud=loud, hops=hops)

    def _find_start(self) -> None:
        """Take the newest levels as the floor, if they are steady."""
        newest = np.array(self._recent)[-START_HOPS:]
        levels = newest[:, -1]
        if levels.std() <= self._spread_db:
            self._variance = _bounded(float(levels.var()))
            self._learn(np.quantile(newest, QUIETER, axis=0))

    def _is_noise(self) -> bool:
        """Whether contact is so long and steady that it is none."""
        if len(self._recent) < 5 * CELL_HOPS:
            return False
        means = np.array(self._recent).reshape(5, CELL_HOPS, -1).mean(axis=1)
        gate_means = means[:, -1]
        known_again = gate_means.mean() < self._highest + SAME_DB
        enough = KNOWN_AGAIN if known_again else LONGEST_TOUCH
        if self._touched * BANDS_HOP < enough:
            return False
        median_band = np.median(means.std(axis=0))
        return bool(median_band <= STEADY_DB and gate_means.std() <= STEADY_DB)

    def _learn(self, levels: Floats) -> None:
        self._levels = np.maximum(levels, LOWEST_FLOOR_DBFS)
        self.known = True
        self._update()

    def _follow(self, levels: Floats, *, touching: bool, loud: bool, hops: int) -> None:
        """Move the floor a little towards the levels; falling is always right, as
        nothing is quieter than silence."""
        away = levels - self._levels
        over = float(away[-1])
        rise = RISE_TOUCHED if touching else RISE
        passed = hops * BANDS_HOP
        # Not `np.clip`, which takes three times as long for so few.
        move = np.maximum(APPROACH * hops * away, -FALL * passed)
        move = np.minimum(move, rise * passed)
        if loud:
            move[-1] = min(move[-1], RISE_TOUCHED * passed)
        self._levels = np.maximum(self._levels + move, LOWEST_FLOOR_DBFS)
        if not touching and over < 2 * MOST_DB:
            # The floor lies a standard deviation under the mean, so half of the mean
            # square over it is the variance.
            self._variance = _bounded(
                self._variance + SPREAD_SHARE * (over * over / 2 - self._variance)
            )
        self._update()

    def _update(self) -> None:
        spread = math.sqrt(self._variance)
        floor = float(self._levels[-1]) + spread
        self._highest = max(floor, self._highest - FORGET_DB)
        margin = margin_db(spread, FALSE_ALARMS)
        self.threshold_dbfs = min(max(floor + margin, LOWEST_DBFS), HIGHEST_DBFS)
        self.release_dbfs = self.threshold_dbfs - RELEASE_SHARE * margin


def margin_db(spread_db: float, false_alarms: float) -> float:
    """Return how far over its mean, in dB, noise is contact for a share of the time.

    The power of noise is gamma distributed, with a shape that follows from the standard
    deviation of its level; its quantile is Wilson and Hilferty's (Proc. Natl. Acad.
    Sci. 17, 684, 1931). Each exceedance lasts `SHORTEST_ALARM`.

    >>> round(margin_db(0.5, 0.01), 2), round(margin_db(1.5, 0.01), 2)
    (2.12, 4.78)
    """
    spread_db = max(spread_db, LEAST_DB)
    shape = (10 / math.log(10) / spread_db) ** 2
    ninth = 1 / (9 * shape)
    return FLOOR_DRIFT_DB + 30 * math.log10(
        1 - ninth + _quantile(false_alarms) * math.sqrt(ninth)
    )


@functools.cache
def _quantile(false_alarms: float) -> float:
    return statistics.NormalDist().inv_cdf(
        1 - false_alarms * FLOOR_WINDOW / SHORTEST_ALARM / HEAVY_TAIL
    )


def _bounded(variance: float) -> float:
    return min(max(variance, LEAST_DB**2), MOST_DB**2)


SAME_FLOOR_DB = 2.0
"""Cells so near the quietest steady one belong to the same floor."""

LEAST_CELLS = 2
"""Steady cells (0.2 s each) that show a floor: strokes have single ones too."""

UNDER_DB = 3.0
"""From so far under the floor a level counts against it: nothing is quieter than
silence."""

MOST_UNDER = 0.02
"""Share of levels that may lie so far under the floor: of steady simulated noise none
does; a stroke that was steady for a moment has quieter ones before and after."""

SAME_SPECTRUM_DB = 1.5
"""Standard deviation over the bands of the difference between two levels of one noise,
up to which only its gain has changed: 0.5 to 1.2 on recordings that were made so. From
noise to touch it is 8 to 9 on those, and 2.4 to 3.8 on real taps."""

NOISE_CELLS = 3
"""Such steady cells in a row, 0.4 s, show noise; a live run measures it for as long."""

FLOOR_FADE = 10
"""Levels, 0.1 s, at either end that are not counted there: an editor's fade is quieter
than silence."""


GATED_DB = 40.0
"""So far apart are the loud and the quiet part of a recording, in the mean, that
something turned the sound down in between: a noise gate, or a program that mutes. The
parts of other recordings are nearer each other: by 33 dB at most in 236 real ones. A
touch that is so loud over its silence is taken for gated too, and loses nothing but a
floor that was measured ahead."""

FIRST_LEVELS = 10
"""Levels, about 0.1 s, by which a recording begins in a touch: all are so far over its
floor."""

LEAST_PART = 0.05
"""Share of a recording that each of these two parts has at least."""

MOST_LEVELS = 100_000
"""Levels of a recording that are kept, a quarter of an hour; of a longer one every
second, fourth and so on, so that memory does not grow with its length."""

MOST_CELLS = 4_096
"""The same for its cells, seven minutes, and for those of its floor: the bands of
either take 5 MB. The quantile over so many differs by 0.02 dB from that of all."""


@dataclass(frozen=True, slots=True)
class RecordingFloor:
    """What a recording shows of its noise.

    There are four kinds of recording. In most, silence is steady, and its level is the
    floor. In a stroke from end to end there is no silence, and all of it is touch. In
    sound that was switched off or turned down in its pauses, the noise beside a touch
    is louder than in a pause, and would be taken for touch: so it begins as a live run
    does, which calls touch only what is loud enough for the model's own threshold, or
    for the noise at its beginning. Where automatic gain turned the noise up and down,
    the floor is the noise that is heard first.
    """

    threshold_dbfs: float
    """Contact threshold; where the floor is unknown, the lowest: all sound is
    contact."""
    floor_dbfs: float
    """Level of the noise; NaN where it is unknown."""
    loudest_dbfs: float
    """Greatest level over 32 ms."""
    spread_db: float = LEAST_DB
    """Standard deviation of the noise's level."""
    bands_dbfs: tuple[float, ...] = ()
    """Floor of each band where the noise is."""
    gated: bool = False
    """Whether something turned the sound down in its pauses, and it does not begin in a
    touch. Then a floor that was found is the noise of the pauses alone, and not of the
    touches."""
    gain_changes: bool = False
    """Whether automatic gain turned the noise up and down."""

    @property
    def known(self) -> bool:
        return not math.isnan(self.floor_dbfs)


def measure_floor(
    blocks: Iterable[AudioBlock],
    *,
    sample_rate: int,
    rule: LoudnessRule,
    false_alarms: float = FALSE_ALARMS,
) -> RecordingFloor:
    """Measure the noise floor of a recording.

    ``false_alarms`` is the wanted share of the time without contact that counts as
    contact.
    """
    every = _Thinned[float](MOST_LEVELS)
    heard = _Thinned[float](MOST_LEVELS)
    cells = _Cells(SPREAD_DB[rule])
    loudest = -math.inf
    for level, bands in _levels(blocks, sample_rate=sample_rate, rule=rule):
        every.add(level)
        # Digital silence is no floor.
        if level > FLOOR_SILENT_DBFS:
            heard.add(level)
            loudest = max(loudest, level)
            cells.add(level, bands)
    gated = _parts_db(every.kept) > GATED_DB
    fade = FLOOR_FADE // heard.every
    inner = heard.kept[fade : len(heard.kept) - fade]
    first = cells.first_of_changing_noise()
    same = first or cells.of_the_floor(inner)
    if not same:
        return RecordingFloor(LOWEST_DBFS, math.nan, loudest, gated=gated)
    floor = statistics.fmean(cell.mean for cell in same)
    # A live run would learn a touch that it begins in as its noise.
    begins_in_touch = min(inner[:FIRST_LEVELS], default=floor) > floor + GATED_DB
    spread = math.sqrt(
        statistics.fmean(cell.spread**2 + (cell.mean - floor) ** 2 for cell in same)
    )
    threshold = min(
        max(floor + margin_db(spread, false_alarms), LOWEST_DBFS), HIGHEST_DBFS
    )
    quiet = np.concatenate([cell.bands for cell in same])
    return RecordingFloor(
        threshold,
        floor,
        loudest,
        spread,
        tuple(np.quantile(quiet, QUIETER, axis=0).tolist()),
        gated=gated and not begins_in_touch,
        gain_changes=bool(first) and not gated,
    )


Item = TypeVar("Item")


class _Thinned(Generic[Item]):
    """Keeps every item of a stream until there are ``most``, then every second, fourth
    and so on: a sample of a long recording, and the whole of a short one.

    - ``kept``: the items kept; ``every``: one of how many these are.

    >>> thinned = _Thinned(4)
    >>> for item in range(9):
    ...     thinned.add(item)
    >>> thinned.kept, thinned.every
    ([0, 4, 8], 4)
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._seen = 0
        self.kept: list[Item] = []
        self.every = 1

    def add(self, item: Item) -> None:
        if self._seen % self.every == 0:
            self.kept.append(item)
        self._seen += 1
        if len(self.kept) > self._most:
            del self.kept[1::2]
            self.every *= 2

    def keep(self, wanted: Callable[[Item], bool]) -> None:
        """Drop the items that are not wanted any more; with none left it begins
        anew."""
        self.kept = [item for item in self.kept if wanted(item)]
        if not self.kept:
            self._seen = 0
            self.every = 1


@dataclass(frozen=True, slots=True, eq=False)
class _Cell:
    """Levels of 0.2 s, with the bands at each."""

    mean: float
    spread: float
    bands: Floats

    @property
    def spectrum(self) -> Floats:
        """Its bands, whatever its gain: over their mean."""
        bands = self.bands.mean(axis=0)
        return np.asarray(bands - bands.mean())


class _Cells:
    """Groups levels to cells, each half over the one before, and keeps the steady ones
    that may belong to the floor: those near the quietest.
    """

    def __init__(self, spread_db: float) -> None:
        self._spread_db = spread_db
        self._levels: list[float] = []
        self._bands: list[FloatArray] = []
        self._all = _Thinned[_Cell](MOST_CELLS)
        self._steady = _Thinned[_Cell](MOST_CELLS)
        # Least mean of all cells, and of steady ones.
        self._quietest = self._quietest_steady = math.inf

    def add(self, level: float, bands: FloatArray) -> None:
        self._levels.append(level)
        self._bands.append(bands)
        if len(self._levels) < FLOOR_CELL:
            return
        mean = statistics.fmean(self._levels)
        spread = statistics.pstdev(self._levels)
        self._quietest = min(self._quietest, mean)
        cell = _Cell(mean, spread, np.array(self._bands))
        self._all.add(cell)
        if self._is_steady(cell):
            self._add_steady(cell)
        del self._levels[: FLOOR_CELL // 2]
        del self._bands[: FLOOR_CELL // 2]

    def of_the_floor(self, levels: Sequence[float]) -> list[_Cell]:
        """Return the steady cells near the quietest one, the quietest first; empty if
        they are too few, or something is quieter: one of all cells, or of the levels.
        """
        same = sorted(self._steady.kept, key=lambda cell: (cell.mean, cell.spread))
        if (
            len(same) < LEAST_CELLS
            or self._quietest_steady > self._quietest + SAME_FLOOR_DB
        ):
            return []
        floor = statistics.fmean(cell.mean for cell in same)
        under = sum(level < floor - UNDER_DB for level in levels)
        return same if under <= MOST_UNDER * len(levels) else []

    def first_of_changing_noise(self) -> list[_Cell]:
        """Return the first steady cells in a row with the spectrum of the quietest, if
        they are louder; else none.

        Automatic gain moves all bands of the noise alike. Noise is then quietest right
        after a touch, and a floor measured there would make contact of all other noise.
        """
        cells = self._all.kept
        if not cells:
            return []
        quietest = sorted(cells, key=lambda cell: cell.mean)
        quietest = quietest[: max(NOISE_CELLS, round(LEAST_PART * len(cells)))]
        spectrum = np.mean([cell.spectrum for cell in quietest], axis=0)
        is_noise = [
            np.std(cell.spectrum - spectrum) <= SAME_SPECTRUM_DB for cell in cells
        ]
        shows_noise = [
            found and self._is_steady(cell)
            for found, cell in zip(is_noise, cells, strict=True)
        ]
        starts = range(len(cells) - NOISE_CELLS + 1)
        first = next(
            (at for at in starts if all(shows_noise[at : at + NOISE_CELLS])), None
        )
        if first is None:
            return []
        found = cells[first : first + NOISE_CELLS]
        lower_dbfs = min(cell.mean for cell in found) - UNDER_DB
        after = range(first + NOISE_CELLS, len(cells))
        lower = next(
            (at for at in after if is_noise[at] and cells[at].mean < lower_dbfs), None
        )
        if lower is None:
            return []
        # Only a touch between them makes a gain fall; else the first was a touch.
        return [] if all(is_noise[first:lower]) else found

    def _is_steady(self, cell: _Cell) -> bool:
        return cell.spread <= self._spread_db

    def _add_steady(self, cell: _Cell) -> None:
        if cell.mean < self._quietest_steady:
            self._quietest_steady = cell.mean
            self._steady.keep(self._is_near)
        if self._is_near(cell):
            self._steady.add(cell)

    def _is_near(self, cell: _Cell) -> bool:
        return cell.mean <= self._quietest_steady + SAME_FLOOR_DB


def _parts_db(levels: Sequence[float]) -> float:
    """Return how far apart the means of the loud and the quiet part are, where these
    are the two parts that explain most of the variance of the levels (Otsu, IEEE Trans.
    Syst. Man Cybern. 9, 62, 1979)."""
    ordered = np.sort(np.maximum(levels, FLOOR_SILENT_DBFS))
    size = len(ordered)
    least = max(1, math.ceil(LEAST_PART * size))
    if size < 2 * least:
        return 0.0
    counts = np.arange(least, size - least + 1)
    sums = np.cumsum(ordered)
    quiet = sums[counts - 1] / counts
    loud = (sums[-1] - sums[counts - 1]) / (size - counts)
    explained = counts * (size - counts) * np.square(loud - quiet)
    best = int(explained.argmax())
    return float(loud[best] - quiet[best])


def _levels(
    blocks: Iterable[AudioBlock], *, sample_rate: int, rule: LoudnessRule
) -> Iterator[tuple[float, FloatArray]]:
    """Yield the level over 32 ms in dBFS a hundred times a second, and the levels of
    the bands there."""
    steps = StepLevels(rule, sample_rate=sample_rate)
    every = steps.count(1 / RATE)
    covered = steps.count(FLOOR_WINDOW)
    bands = BandLevels(sample_rate, hop=every * steps.step_size)
    powers: Floats = np.zeros(0)
    levels = deque[float]()
    # The bands' windows are twice as long, and end nearly where the level's do: with
    # the row after those that begin with or before the level.
    row_after = covered // every
    rows = deque[FloatArray]()
    last_row: FloatArray = np.zeros(BANDS, np.float32)
    for block in blocks:
        contact = block.samples.T[CONTACT : CONTACT + 1]
        powers = np.concatenate([powers, steps.push(contact)[0]])
        ready = max(0, (len(powers) - covered) // every + 1)
        if ready:
            windows = sliding_window_view(powers, covered)[::every]
            totals = np.maximum(windows.mean(axis=1), 1e-30)
            levels.extend((20 / steps.power * np.log10(totals)).tolist())
            powers = powers[ready * every :]
        rows.extend(row[0] for row in bands.push(contact))
        while levels and len(rows) > row_after:
            yield levels.popleft(), rows[row_after]
            last_row = rows.popleft()
    # At the end, the last row stands for those that are not complete.
    last_row = rows[-1] if rows else last_row
    for at, level in enumerate(levels, row_after):
        yield level, rows[at] if at < len(rows) else last_row
