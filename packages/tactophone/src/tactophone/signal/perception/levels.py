"""The level of the contact microphone, which decides on contact: of a window, of steps
of 0.25 ms, and of bands.

There are three rules. The paper states an RMS level; its authors' code takes the mean
of the absolute value, which is 2 dB lower for Gaussian noise; ``banded`` leaves out hum
and motors.

`StepLevels` carries a partial step over to the next packet. Steps of 0.25 ms divide
packets of 2.5 ms. At a period of 64 samples they leave a remainder of 4 samples; with
steps of 1 ms, clicks were detected 0.3 ms later (p50; docs/research/processor-time.md).
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.core.types import FloatArray

LoudnessRule: TypeAlias = Literal["rms", "mean_absolute", "banded"]

ZERO_DBFS = -200.0
"""Replaces minus infinity, so that levels stay finite: below the least step of 24 bit
sound (-138 dBFS)."""


def rms_dbfs(samples: FloatArray) -> float:
    """Return the root mean square level of one channel, in dB of full scale.

    >>> rms_dbfs(np.full(100, 0.1, np.float32))
    -20.0
    >>> rms_dbfs(np.zeros(100, np.float32))
    -200.0
    """
    return _dbfs(math.sqrt(np.vecdot(samples, samples) / len(samples)))


def mean_absolute_dbfs(samples: FloatArray) -> float:
    """Return the level of the mean absolute value of one channel, in dB of full
    scale."""
    return _dbfs(float(np.abs(samples).mean(dtype=np.float64)))


def banded_dbfs(samples: FloatArray) -> float:
    """Return the RMS level of one channel between 1/32 and 1/2 of the Nyquist
    frequency: 250 Hz to 4 kHz at 16 kHz.

    Hum, motors and the arm's sway are under that band, the sound of a sliding finger in
    it: on simulated sound it detects 83 % of touching windows at 1 % false alarms, the
    unfiltered level 42 % (docs/research/detector.md).

    >>> turns = np.arange(512, dtype=np.float32) / 512
    >>> hum, hiss = np.sin(2 * np.pi * 3 * turns), np.sin(2 * np.pi * 40 * turns)
    >>> banded_dbfs(hum) < -60, round(banded_dbfs(hiss), 1)
    (True, -3.0)
    """
    size = len(samples)
    band = np.fft.rfft(samples * _taper(size))[size // 64 : size // 4]
    return _band_dbfs(band, size)


def loudness(rule: LoudnessRule, channels: Sequence[FloatArray]) -> list[float]:
    """Return the level in dBFS of each channel, of one length; spectra are computed in
    one call."""
    if rule != "banded" or len(channels) == 1:
        return list(map(LOUDNESS[rule], channels))
    size = len(channels[0])
    bands = np.fft.rfft(np.array(channels) * _taper(size))[:, size // 64 : size // 4]
    return [_band_dbfs(band, size) for band in bands]


def _band_dbfs(band: NDArray[np.complexfloating], size: int) -> float:
    # Two sides of a real spectrum; the taper's mean square is 3/8.
    return _dbfs(math.sqrt(2 * np.vdot(band, band).real / (3 / 8 * size * size)))


LOUDNESS: dict[LoudnessRule, Callable[[FloatArray], float]] = {
    "rms": rms_dbfs,
    "mean_absolute": mean_absolute_dbfs,
    "banded": banded_dbfs,
}
"""The level in dBFS of one channel, shape ``(samples,)``, by each rule."""


@functools.cache
def _taper(size: int) -> NDArray[np.float64]:
    return np.asarray(np.hanning(size + 1)[:-1])


def _dbfs(amplitude: float) -> float:
    # Rounded to an inaudible 1e-6 dB, so that levels compare equal whatever the order
    # of summation.
    return (
        max(ZERO_DBFS, round(20 * math.log10(amplitude), 6))
        if amplitude > 0
        else ZERO_DBFS
    )


def level_power(rule: LoudnessRule, sound: FloatArray, sample_rate: int) -> float:
    """Return the power of one channel as the steps of `StepLevels` have it in the mean,
    or its mean absolute value by that rule."""
    if rule == "mean_absolute":
        return float(np.abs(sound).mean())
    if rule == "rms":
        return float(np.vdot(sound, sound)) / len(sound)
    mean = mean_of_neighbours(sound, max(1, sample_rate // BANDED_RATE))
    change = mean[BANDED_LAG:] - mean[:-BANDED_LAG]
    return BANDED_POWER * float(np.vdot(change, change)) / len(change)


Sound = TypeVar("Sound", FloatArray, NDArray[np.float64])
"""Samples along the last axis, in either precision."""


def mean_of_neighbours(sound: Sound, count: int) -> Sound:
    """Average each ``count`` samples along the last axis to one; a rest at the end is
    left out.

    A sum of slices takes a fifth of the time of a mean over a short axis.

    >>> mean_of_neighbours(np.arange(7.0), 3).tolist()
    [1.0, 4.0]
    """
    whole = sound.shape[-1] // count * count
    total = sound[..., 0:whole:count].copy()
    for offset in range(1, count):
        total += sound[..., offset:whole:count]
    total /= count
    return total


LARGEST_PIECE = 512
"""Samples taken at once; longer blocks are taken in such pieces."""

STEP_RATE = 4000
"""Steps a second."""

BANDED_RATE = 8000
"""Hz that ``banded`` sound is averaged down to; a step then holds two samples."""

BANDED_LAG = 2
"""Samples at 8 kHz between the two that ``banded`` subtracts: a band around 2 kHz,
without offset, hum and motors (-22 dB at 50 Hz). Of lags 0 (all frequencies), 1, 2 and
4 and a 33-tap high-pass, it detects most touching windows of simulated sound at 1 %
false alarms: 0.85, 0.92, 0.93, 0.93 and 0.92 (32 ms, floor known)."""

BANDED_POWER = 0.7
"""Scales the power of differences so that simulated touches have the banded level of
the windows (median; noise, which is brighter, lies 1 dB lower)."""


class StepLevels:
    """Measures steps of 0.25 ms, of several microphones at once; the same values at any
    block size.

    - ``rule``: ``rms``, ``mean_absolute`` or ``banded``.
    - ``sample_rate``: in Hz; steps are whole samples, so that 44.1 kHz has 4009 of them
      a second (4410 by the rule ``banded``).

    >>> levels = StepLevels("rms", sample_rate=48_000)
    >>> levels.push(np.full((1, 30), 0.5, np.float32)).tolist()
    [[0.25, 0.25]]
    >>> levels.count(0.032)
    128
    """

    def __init__(self, rule: LoudnessRule, *, sample_rate: int, count: int = 1) -> None:
        self._rule: LoudnessRule = rule
        self._sample_rate = sample_rate
        self._decimation = max(1, sample_rate // BANDED_RATE) if rule == "banded" else 1
        whole_steps = sample_rate / STEP_RATE / self._decimation
        parts = max(
            1, round(whole_steps) if rule == "banded" else sample_rate // STEP_RATE
        )
        self.step_size = parts * self._decimation
        # The level is a mean of |x| to this power; so are the thresholds that it is
        # compared with.
        self.power = 1 if rule == "mean_absolute" else 2
        # The mean of `decimation` neighbours, a low-pass that costs little (what it
        # lets alias is quiet in a contact sound), less the mean a lag before. As one
        # filter, because each call on a packet costs more than its sums. Scaled so that
        # the squares of a step's differences sum up to its power.
        mean = np.full(
            self._decimation,
            math.sqrt(BANDED_POWER / parts) / self._decimation,
            np.float32,
        )
        self._filter = np.concatenate(
            (-mean, np.zeros((BANDED_LAG - 1) * self._decimation, np.float32), mean)
        )
        self._before = BANDED_LAG * self._decimation if rule == "banded" else 0
        # What precedes the next step and is part of its differences, and the beginning
        # of that step; then new sound.
        self._sound: FloatArray = np.zeros(
            (count, self._before + self.step_size + LARGEST_PIECE), np.float32
        )
        # Of each number of steps: they always begin at the same place, and making a
        # view takes as long as a sum.
        self._views: dict[int, tuple[FloatArray, FloatArray]] = {}
        self.reset()

    def reset(self) -> None:
        self._sound[:, : self._before] = 0
        self._filled = self._before

    def count(self, duration: float) -> int:
        """Return how many steps come nearest to so many seconds."""
        return round(duration * self._sample_rate / self.step_size)

    def push(self, contacts: FloatArray) -> FloatArray:
        """Take samples, ``(count, samples)``; return power, or mean absolute value, of
        the steps that they complete."""
        if (size := contacts.shape[1]) <= LARGEST_PIECE:
            return self._push(contacts)
        pieces = (
            contacts[:, start : start + LARGEST_PIECE]
            for start in range(0, size, LARGEST_PIECE)
        )
        return np.concatenate([self._push(piece) for piece in pieces], axis=1)

    def _push(self, contacts: FloatArray) -> FloatArray:
        sound = self._sound
        end = self._filled + contacts.shape[1]
        sound[:, self._filled : end] = contacts
        steps = (end - self._before) // self.step_size
        if not steps:
            self._filled = end
            return sound[:, :0]
        levels = self._measure(steps)
        measured = steps * self.step_size
        self._filled = end - measured
        sound[:, : self._filled] = sound[:, measured:end]
        return levels

    def _measure(self, steps: int) -> FloatArray:
        new, around = self._views.get(steps) or self._make_views(steps)
        if self._rule == "banded":
            change = np.vecdot(around, self._filter)
            powers: FloatArray = np.vecdot(change, change)
            return powers
        sums = np.vecdot(new, new) if self.power == 2 else np.abs(new).sum(axis=2)
        return np.asarray(sums / np.float32(self.step_size))

    def _make_views(self, steps: int) -> tuple[FloatArray, FloatArray]:
        """Return so many steps, and what the filter covers for each of their
        differences."""
        rows = len(self._sound)
        (far, one) = self._sound.strides
        new = np.ndarray(
            (rows, steps, self.step_size),
            np.float32,
            self._sound,
            one * self._before,
            (far, one * self.step_size, one),
        )
        # Without a filter its view would reach over the end of the sound.
        around = new
        if self._rule == "banded":
            shape = rows, steps, self.step_size // self._decimation, len(self._filter)
            strides = far, one * self.step_size, one * self._decimation, one
            around = np.ndarray(shape, np.float32, self._sound, strides=strides)
        self._views[steps] = new, around
        return self._views[steps]


BANDS = 16
"""Number of the logarithmic bands of `BandLevels`."""

LOWEST_BAND = 100.0
"""Lower edge of the bands in Hz: from 250 Hz, 4 % less of a soft rubber tip's touch is
found."""

HIGHEST_BAND = 8000.0
"""Upper edge of the bands in Hz: up to 4 kHz only, motors pass for touch."""

BANDS_WINDOW = 0.064
"""Seconds that a band's level covers."""

BANDS_HOP = 0.005
"""About the seconds from one level of a band to the next: a whole number of steps."""

BANDS_RATE = 16_000
"""Hz that the sound is averaged down to for the bands."""

MOST_HOPS = 64
"""Hops of a longer block whose bands are measured at once."""

FAINTEST_POWER = 1e-14
"""Added to the power of a band, so that digital silence has a finite level."""


class BandLevels:
    """Measures the level of bands every 5 ms, each over the 64 ms before; the same
    values at any block size.

    ``hop`` is the number of samples from one row of levels to the next, ``count`` of
    microphones measured at once.

    >>> levels = BandLevels(48_000, hop=240)
    >>> [rows.shape for rows in levels.push(np.zeros((1, 500), np.float32))]
    [(1, 16), (1, 16)]
    """

    def __init__(self, sample_rate: int, *, hop: int, count: int = 1) -> None:
        most = max(1, sample_rate // BANDS_RATE)
        self._decimation = max(each for each in range(1, most + 1) if hop % each == 0)
        rate = sample_rate / self._decimation
        size = round(BANDS_WINDOW * rate)
        edges = (
            np.geomspace(LOWEST_BAND, min(HIGHEST_BAND, 0.45 * rate), BANDS + 1)
            * size
            / rate
        )
        # At low rates the lowest bands have one bin each.
        order = np.arange(BANDS + 1)
        self._edges = np.maximum.accumulate(np.round(edges).astype(int) - order) + order
        self._window = np.asarray(np.hanning(size + 2)[1:-1] / size, np.float32)
        self._hop = hop
        self._count = count
        self.reset()

    def reset(self) -> None:
        self._recent = np.zeros((self._count, len(self._window)), np.float32)
        self._rest = np.zeros((self._count, 0), np.float32)

    def push(self, contacts: FloatArray) -> list[FloatArray]:
        """Take samples, ``(count, samples)``; return the levels in dBFS, ``(count,
        BANDS)``, of each hop they complete."""
        rows = list[FloatArray]()
        sound = (
            np.concatenate((self._rest, contacts), axis=1)
            if self._rest.shape[1]
            else contacts
        )
        whole = sound.shape[1] // self._hop * self._hop
        self._rest = sound[:, whole:]
        for start in range(0, whole, MOST_HOPS * self._hop):
            part = sound[:, start : min(start + MOST_HOPS * self._hop, whole)]
            rows += self._measure(part)
        return rows

    def _measure(self, new: FloatArray) -> list[FloatArray]:
        """Take whole hops, ``(count, samples)``; return the levels of each."""
        count = self._count
        steps = new.shape[1] // self._hop
        step = self._hop // self._decimation
        size = len(self._window)
        decimated = mean_of_neighbours(new, self._decimation)
        sound = np.concatenate((self._recent, decimated), axis=1)
        self._recent = sound[:, -size:]
        if not np.vdot(sound, sound):
            return [
                np.full((count, BANDS), 10 * np.log10(FAINTEST_POWER), np.float32)
            ] * steps
        # As `sliding_window_view`, which takes as long as the rest of this for a single
        # hop.
        windows = np.ndarray(
            (count, steps, size),
            np.float32,
            sound,
            4 * step,
            (sound.strides[0], 4 * step, 4),
        )
        return list(self._bands_of(windows).swapaxes(0, 1))

    @property
    def window(self) -> int:
        """Samples that a level covers."""
        return len(self._window) * self._decimation

    def of_window(self, sound: FloatArray) -> FloatArray:
        """Return the levels in dBFS, ``(BANDS,)``, of one channel of `window` samples,
        whatever was pushed."""
        return self._bands_of(mean_of_neighbours(sound, self._decimation))

    def _bands_of(self, windows: FloatArray) -> FloatArray:
        """Return the levels of windows along the last axis."""
        spectra = np.fft.rfft(windows * self._window)
        power = np.add.reduceat(
            np.square(spectra.real) + np.square(spectra.imag), self._edges, axis=-1
        )[..., :BANDS]
        return np.asarray(10 * np.log10(power + FAINTEST_POWER), np.float32)


def band_weights(rule: LoudnessRule, sample_rate: int) -> NDArray[np.float64]:
    """Return how much the power of each band counts in the level of steps by a rule,
    ``(BANDS,)``."""
    if rule != "banded":
        return np.ones(BANDS)
    rate = sample_rate / max(1, sample_rate // BANDED_RATE)
    edges = np.geomspace(LOWEST_BAND, HIGHEST_BAND, BANDS + 1)
    centres = np.sqrt(edges[1:] * edges[:-1])
    # The mean of neighbours, then the difference over the lag.
    response = np.sinc(centres / rate) * np.sin(np.pi * centres * BANDED_LAG / rate)
    return np.square(response)


FAST = 0.004
"""Seconds that the short level of `LevelMeter` covers: half a period of 125 Hz."""

SLOW = 0.032
"""Seconds that the long level of `LevelMeter` covers: a period of 31 Hz."""

MOST_STEPS = 64
"""Steps of a longer block that are taken at once."""


class LevelMeter:
    """Measures what the contact gates of all fingers decide by, in one call for all,
    and keeps it until they take it.

    - ``steps``: measures steps.
    - ``slow``, ``fast``: of each finger, the levels over `SLOW` and `FAST` seconds of
      the steps not taken yet.
    - ``bands``: of each finger, the levels of the bands of the hops not taken yet.
    - ``ahead``: samples whose steps were measured ahead, and that are yet to be pushed.
    """

    def __init__(
        self, rule: LoudnessRule, *, sample_rate: int, bands: bool, count: int = 1
    ) -> None:
        self.settings = rule, sample_rate, bands
        self.steps = StepLevels(rule, sample_rate=sample_rate, count=count)
        self._slow = self.steps.count(SLOW)
        fast = self.steps.count(FAST)
        hop = self.steps.count(BANDS_HOP) * self.steps.step_size
        self._bands = BandLevels(sample_rate, hop=hop, count=count) if bands else None
        # Powers of the steps that the slow level covers, then of new ones.
        self._powers = np.zeros((count, self._slow + MOST_STEPS))
        self._slow_windows = sliding_window_view(
            self._powers[:, 1:], self._slow, axis=1
        )
        self._fast_windows = self._slow_windows[:, :, -fast:]
        self._slow_weights = np.full(self._slow, 1 / self._slow)
        self._fast_weights = np.full(fast, 1 / fast)
        self.reset()

    def reset(self) -> None:
        count = len(self._powers)
        self.slow: list[list[float]] = [[] for _ in range(count)]
        self.fast: list[list[float]] = [[] for _ in range(count)]
        self.bands: list[list[NDArray[np.float64]]] = [[] for _ in range(count)]
        self.ahead = 0
        self.steps.reset()
        self._powers[:] = 0
        if self._bands:
            self._bands.reset()

    def for_fingers(self, count: int) -> "LevelMeter":
        rule, sample_rate, bands = self.settings
        return LevelMeter(rule, sample_rate=sample_rate, bands=bands, count=count)

    def push(self, contacts: FloatArray) -> None:
        """Take samples, shape ``(count, samples)``; the steps of the first `ahead` of
        them were measured already."""
        if contacts.shape[1] > self.ahead:
            self._measure(contacts[:, self.ahead :])
        self.ahead = max(0, self.ahead - contacts.shape[1])
        for rows in self._bands.push(contacts) if self._bands else ():
            # In the precision of the floors, or NumPy would convert them in each sum.
            for queue, row in zip(self.bands, rows.astype(np.float64), strict=True):
                queue.append(row)

    def look_ahead(self, contacts: FloatArray) -> None:
        """Measure the steps of samples now that are pushed later, together with those
        that follow."""
        self._measure(contacts)
        self.ahead += contacts.shape[1]

    def _measure(self, contacts: FloatArray) -> None:
        # Each level is a sum of its own, so that it is the same at any block size.
        powers = self.steps.push(contacts)
        for start in range(0, powers.shape[1], MOST_STEPS):
            part = powers[:, start : start + MOST_STEPS]
            new = part.shape[1]
            self._powers[:, self._slow : self._slow + new] = part
            slow = np.vecdot(self._slow_windows[:, :new], self._slow_weights).tolist()
            fast = np.vecdot(self._fast_windows[:, :new], self._fast_weights).tolist()
            self._powers[:, : self._slow] = self._powers[:, new : new + self._slow]
            for finger in range(len(slow)):
                self.slow[finger] += slow[finger]
                self.fast[finger] += fast[finger]
