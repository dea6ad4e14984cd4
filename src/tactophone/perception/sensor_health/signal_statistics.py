"""Statistics of each microphone's signal: half a second of sound in a few numbers, eight times a second.

Everything is measured under 4 kHz, on sound averaged down to about 8 kHz, so that a codec's bandwidth does not change
it; only clipping is measured on the original sound. Measures lie on a fixed grid of cells, whatever the block size.
"""

import functools
import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.types import AIR, CONTACT, AudioBlock, FloatArray

CELL = 0.125
"""Seconds between two measures."""

CELLS = 4
"""Cells that a measure covers: half a second separates 50 Hz from 60 Hz and holds several strokes of a wiggle."""

MAINS = (50, 60)
"""Hz."""

LOWEST_DBFS = -150.0
"""Level of digital silence: under the last bit of any converter, and still finite."""

_BASS_RATE = 1000
_TREBLE_STEPS = 8
_HARMONICS = 7
_FULL_SCALE = 0.99
_LOUD = 0.1
"""Neighbours that are equal over this level are against a rail; in quiet sound of few bits they are not."""


@dataclass(frozen=True, slots=True)
class ChannelStatistics:
    """Half a second of sound in numbers; one entry a channel where there are several."""

    end: float
    """Seconds since the stream began."""
    level_dbfs: tuple[float, ...]
    treble_dbfs: tuple[float, ...]
    """`level_dbfs` and `treble_dbfs`: RMS without the mean, and that of the difference of neighbours at 8 kHz, which
    weighs 1 to 4 kHz most."""
    offset: tuple[float, ...]
    """The mean (DC), of full scale."""
    clipped: tuple[float, ...]
    """Share of samples at full scale or flat against a rail."""
    hum_dbfs: tuple[float, ...]
    masking_dbfs: tuple[float, ...]
    """`hum_dbfs` and `masking_dbfs`: RMS of the mains' harmonics, and of the noise in the same narrow bands, which can
    hide hum of that level."""
    mains: int
    """50 or 60, whichever has more power in its harmonics, in Hz."""
    correlation: float
    """Correlation of the two channels' treble, -1 to 1; 0 with one channel."""

    def tilt_db(self, channel: int) -> float:
        """Brightness of a channel: treble over level, in dB; independent of gain."""
        return self.treble_dbfs[channel] - self.level_dbfs[channel]


class SignalStatistics:
    """Measures a stream: blocks of any size in, a :class:`ChannelStatistics` out at each full cell.

    Examples
    --------
    >>> statistics = SignalStatistics(48_000)
    >>> tone = np.sin(2 * np.pi * 50 * np.arange(48_000) / 48_000).astype(np.float32)
    >>> measured = statistics.push(AudioBlock(np.stack([tone, 0 * tone], axis=1) / 2, 48_000))
    >>> len(measured), round(measured[-1].hum_dbfs[0], 1), measured[-1].mains
    (5, -9.1, 50)
    """

    def __init__(self, sample_rate: int) -> None:
        self._rate = sample_rate
        self._decimation = max(1, sample_rate // (_BASS_RATE * _TREBLE_STEPS))
        self.cell_size = round(CELL * _BASS_RATE) * _TREBLE_STEPS * self._decimation
        self.reset()

    def push(self, block: AudioBlock) -> list[ChannelStatistics]:
        """Take sound; return the measures that it completes, oldest first."""
        measured, rest = [], block.samples
        while len(rest):
            taken = min(self.cell_size - self._filled, len(rest))
            self._parts.append(rest[:taken])
            self._filled += taken
            rest = rest[taken:]
            if self._filled == self.cell_size:
                measured.extend(self._close(block.end - len(rest)))
        return measured

    def reset(self) -> None:
        """Return to the initial state."""
        self._parts: list[FloatArray] = []
        self._filled = 0
        self._decimated: deque[NDArray[np.float64]] = deque(maxlen=CELLS)
        self._clipped: deque[NDArray[np.float64]] = deque(maxlen=CELLS)

    def _close(self, end: int) -> list[ChannelStatistics]:
        # Channels first from here on: a sum over rows of two numbers takes ten times as long as one along a row.
        cell = np.ascontiguousarray(np.concatenate(self._parts).T)
        self._parts, self._filled = [], 0
        with np.errstate(invalid="ignore", over="ignore"):
            self._clipped.append(_clipped(cell))
            finite = np.nan_to_num(cell, posinf=0.0, neginf=0.0).clip(-4, 4).astype(np.float64)
        self._decimated.append(_mean_of_neighbours(finite, self._decimation))
        if len(self._decimated) < CELLS:
            return []
        sound, clipped = np.concatenate(self._decimated, axis=1), np.mean(self._clipped, axis=0)
        return [_measure(sound, clipped, rate=self._rate / self._decimation, end=end / self._rate)]


def _measure(sound: NDArray[np.float64], clipped: NDArray[np.float64], *, rate: float, end: float) -> ChannelStatistics:
    """Measure sound of shape ``(channels, samples)``."""
    treble = np.diff(sound)
    hums, maskings = _hum(sound, rate / _TREBLE_STEPS)
    stronger = int(hums.max(axis=1).argmax())
    return ChannelStatistics(
        end,
        level_dbfs=_dbfs(sound.var(axis=1)),
        treble_dbfs=_dbfs(np.vecdot(treble, treble) / treble.shape[1]),
        offset=tuple(sound.mean(axis=1).tolist()),
        clipped=tuple(clipped.tolist()),
        hum_dbfs=_dbfs(hums[stronger]),
        masking_dbfs=_dbfs(maskings[stronger]),
        mains=MAINS[stronger],
        correlation=_correlation(treble),
    )


def _clipped(cell: FloatArray) -> NDArray[np.float64]:
    loud = np.abs(cell)
    railed = loud >= _FULL_SCALE
    railed[:, 1:] |= (cell[:, 1:] == cell[:, :-1]) & (loud[:, 1:] > _LOUD)
    return np.asarray(railed.mean(axis=1))


def _hum(sound: NDArray[np.float64], rate: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the power of each mains' harmonics, and of the noise in their bands; shape ``(mains, channels)`` each."""
    bass = _mean_of_neighbours(sound, _TREBLE_STEPS)
    size = bass.shape[1]
    taper, tones, noises = _harmonics(size, rate)
    # The main lobe of a Hann window, three bins, holds all but 0.1 % of a tone; one-sided, so twice its power.
    power = 2 * np.abs(np.fft.rfft((bass - bass.mean(axis=1)[:, None]) * taper)) ** 2 / (size * (taper**2).sum())
    # The median of a noise bin's power, exponentially distributed, is its mean times ln 2. Of an even number of bins
    # it is the mean of the two in the middle; `np.median` for each band takes ten times as long.
    middle = noises.shape[-1] // 2
    medians = np.sort(power[:, noises])[..., middle - 1 : middle + 1].mean(axis=-1)
    noise = 3 * medians / np.log(2)
    total = np.maximum(power[:, tones].sum(axis=-1) - noise, 0.0).sum(axis=-1)
    return total.T, noise.sum(axis=-1).T


@functools.cache
def _harmonics(size: int, rate: float) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
    """Return a taper, ``(size,)``, and the bins of tones and of noise, ``(mains, harmonics, bins)`` each."""
    centres = np.array([[round(n * mains * size / rate) for n in range(1, _HARMONICS + 1)] for mains in MAINS])
    noises = [*range(-7, -2), *range(3, 8)]
    return np.hanning(size + 1)[:-1], centres[..., None] + [-1, 0, 1], centres[..., None] + noises


def _mean_of_neighbours(sound: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Average each ``count`` samples to one; a sum of slices takes a fifth of the time of a mean over a short axis."""
    return np.asarray(sum(sound[:, n::count] for n in range(count)) / count)


def _correlation(treble: NDArray[np.float64]) -> float:
    if len(treble) < 2:
        return 0.0
    contact, air = treble[CONTACT], treble[AIR]
    scale = math.sqrt(np.vecdot(contact, contact) * np.vecdot(air, air))
    return float(np.vecdot(contact, air)) / scale if scale > 0 else 0.0


def _dbfs(power: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple((10 * np.log10(np.maximum(power, 10 ** (LOWEST_DBFS / 10)))).tolist())
