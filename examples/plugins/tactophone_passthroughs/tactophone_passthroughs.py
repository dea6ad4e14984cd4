"""Two more ways to feel the sound itself, as a plug-in: pip install
examples/plugins/tactophone_passthroughs

    tactophone feel finger.wav --profile pitch

``pitch`` shifts the sound down by three octaves, so that the band in which surfaces
differ falls into the tactile range: the paper's authors tried it first (section III-B).
``median-frequency`` is a sine at the median frequency of the sound, the stimulus of
Svensson et al. (2021).
"""

import math

import numpy as np

from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import (
    EXPANDER_RATIO,
    LOW_BAND_RATE,
    PASSTHROUGH_GAIN_DB,
    Floats,
    LowPass,
    Passthrough,
)

SHIFT = 1 / 8
"""Factor on every frequency: three octaves down."""

SHIFT_THRESHOLD_DBFS = -45.0
"""Threshold of the expander: 7 dB lower than for the sound as it is, as the high band
is fainter than the low one."""

GRAIN = 1440
"""Samples, 30 ms, over which the two heads of the pitch shifter alternate: two periods
of 70 Hz."""

MEDIAN_SIZE = 256
"""Values, 64 ms at 4 kHz, over which the median frequency is taken: two periods of the
actuator's lowest."""

MEDIAN_HOP = 16
"""Values, 4 ms, from one median to the next."""

SMOOTHING = 10e-3
"""Seconds over which level and median frequency are averaged."""


class PitchShift(Passthrough):
    """Shifts the pitch with two delay heads that fall behind and jump forward in turn,
    each silent when it jumps."""

    def __init__(self, limits: Limits | None = None) -> None:
        super().__init__(limits, threshold_dbfs=SHIFT_THRESHOLD_DBFS)
        # The heads are half a grain behind on average.
        self.latency += GRAIN / 2 / LIVE_SAMPLE_RATE

    def reset(self) -> None:
        super().reset()
        self._past: Floats = np.zeros(GRAIN + 1)
        self._count = 0

    def prepare(self, sound: Floats) -> Floats:
        # ``behind`` grows by 1 - SHIFT a sample: each head reads the past at SHIFT
        # times the speed, with a delay that wraps at one grain. The squared sines of
        # the two heads, half a grain apart, add up to 1.
        line = np.concatenate((self._past, sound))
        behind = (1 - SHIFT) * (self._count + np.arange(len(sound)))
        place = np.arange(GRAIN + 1, len(line))
        shifted = np.zeros(len(sound))
        for head in (0.0, 0.5):
            delay = (behind + head * GRAIN) % GRAIN
            whole = np.floor(delay).astype(np.intp)
            share = delay - whole
            value = (1 - share) * line[place - whole] + share * line[place - whole - 1]
            shifted += value * np.sin(np.pi * delay / GRAIN) ** 2
        self._past = line[len(line) - GRAIN - 1 :]
        self._count += len(sound)
        return shifted


class MedianChain:
    """A sine at the median frequency of the sound, as loud as the sound after the
    expander.

    The median is taken within the actuator's band, so that it can always be rendered:
    half of the power between ``limits.lowest`` and ``limits.highest`` lies on either
    side. It lags by half of `MEDIAN_SIZE`.
    """

    def __init__(self, threshold_dbfs: float, limits: Limits) -> None:
        self._threshold = 10 ** (threshold_dbfs / 20)
        self._gain = 10 ** (PASSTHROUGH_GAIN_DB / 20)
        self._ceiling = limits.ceiling
        self._low = LowPass(limits.lowest)
        self._level = LowPass.averaging(SMOOTHING)
        self._frequency = LowPass.averaging(SMOOTHING)
        bins = np.fft.rfftfreq(MEDIAN_SIZE, 1 / LOW_BAND_RATE)
        self._band = (bins >= limits.lowest) & (bins <= limits.highest)
        self._bins = bins[self._band]
        self._window = np.hanning(MEDIAN_SIZE)
        self._past: Floats = np.zeros(MEDIAN_SIZE)
        self._count = 0
        self._median = limits.lowest
        self._phase = 0.0

    def step(self, value: float) -> float:
        band = value - self._low.step(value)
        level = self._level.step(abs(band))
        self._past[self._count % MEDIAN_SIZE] = band
        self._count += 1
        if self._count % MEDIAN_HOP == 0:
            self._median = self._measured()
        # The phase is continuous: the frequency glides, and nothing clicks.
        turns = self._frequency.step(self._median) / LOW_BAND_RATE
        self._phase = (self._phase + turns) % 1.0
        under = min(1.0, level / self._threshold) ** (EXPANDER_RATIO - 1)
        amplitude = self._ceiling * math.tanh(level * under * self._gain)
        return amplitude * math.sin(2 * math.pi * self._phase)

    def _measured(self) -> float:
        ordered = np.roll(self._past, -(self._count % MEDIAN_SIZE))
        spectrum = np.fft.rfft(ordered * self._window)[self._band]
        power = np.cumsum(np.square(np.abs(spectrum)))
        if power[-1] <= 0:
            return self._median
        return float(self._bins[np.searchsorted(power, power[-1] / 2)])


class MedianFrequency(Passthrough):
    """The sound as a sine that follows its median frequency."""

    def __init__(self, limits: Limits | None = None) -> None:
        super().__init__(limits, open_chain=MedianChain)
