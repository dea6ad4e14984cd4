"""The sound itself as vibration, with no detector: what the paper's authors tried first (section III-C).

``direct``: the contact microphone's sound straight to the actuator, through an expander that closes on noise, a band
that the finger feels, and a sharpening of transients. ``pitch``: the same, shifted down by three octaves first, so that
the band in which surfaces differ comes to lie where a finger feels.

The low band is worked on sample by sample at 4 kHz, so that it is the same to the bit in blocks of any size.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.haptics.limits import Limits
from tactophone.types import FloatArray

RATE = 48_000
"""Hz, of sound and of vibration."""

STEP_SIZE = 12
"""Samples from one value of the low band to the next: 4 kHz, four times the highest frequency of the actuator."""

TAPS = 97
"""Of the low-pass before: 1 ms of delay, 50 dB down from 2.3 kHz on."""

GRAIN = 1440
"""Samples, 30 ms, over which the two heads of the pitch shifter take turns: two periods of 70 Hz."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Dynamics:
    """How loudness is treated.

    Parameters
    ----------
    threshold_dbfs
        Level in the felt band from which sound passes as it is; what is under it is pushed down.
    ratio
        Decibels out for each decibel under the threshold.
    sharpness
        Exponent on fast over slow level: 0 leaves transients alone.
    gain_db
        Of all; beyond full drive a soft limiter bends.
    """

    threshold_dbfs: float = -38.0
    ratio: float = 3.0
    sharpness: float = 0.5
    gain_db: float = 24.0


class Passthrough:
    """Renders the contact microphone's sound as vibration.

    Parameters
    ----------
    shift
        Factor on every frequency; 1 leaves pitch alone.
    dynamics, limits
        Of loudness; of everything felt.

    Examples
    --------
    >>> time = np.arange(4800) / 48_000
    >>> vibration = Passthrough().render_whole(0.3 * np.sin(2 * np.pi * 200 * time).astype(np.float32)[:, None])
    >>> vibration.shape, bool(abs(vibration).max() > 0.5)
    ((4800,), True)
    """

    def __init__(self, *, shift: float = 1.0, dynamics: Dynamics | None = None, limits: Limits | None = None) -> None:
        self._shift, self._dynamics, self._limits = shift, dynamics or Dynamics(), limits or Limits()
        self._kernel = _low_pass(TAPS, RATE / STEP_SIZE * 0.4)
        self.reset()

    @property
    def latency(self) -> float:
        """Seconds: the low-pass, the step to the next value, and half a grain where pitch is shifted."""
        grain = GRAIN / 2 if self._shift != 1 else 0
        return (TAPS // 2 + STEP_SIZE + grain) / RATE

    def reset(self) -> None:
        """Be silent and as new."""
        self._heard: Floats = np.zeros(GRAIN + 1)
        self._count = 0
        self._waiting: Floats = np.zeros(TAPS - 1)
        self._chain = _Chain(self._dynamics, self._limits)
        self._last = 0.0

    def push(self, samples: FloatArray) -> FloatArray:
        """Take sound at 48 kHz, shape ``(samples, channels)``; give the vibration that it completes, in steps of 12."""
        sound = np.nan_to_num(samples[:, 0].astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0)
        sound = np.clip(sound, -1.0, 1.0)
        shifted = sound if self._shift == 1 else self._shifted(sound)
        self._waiting = np.concatenate((self._waiting, shifted))
        count = max(0, (len(self._waiting) - TAPS + 1) // STEP_SIZE)
        windows = sliding_window_view(self._waiting, TAPS)[: count * STEP_SIZE : STEP_SIZE]
        values = [self._chain.step(float(value)) for value in (windows * self._kernel).sum(axis=1)]
        self._waiting = self._waiting[count * STEP_SIZE :]
        return self._ramps(np.array(values))

    def render_whole(self, samples: FloatArray) -> FloatArray:
        """Render a whole sound from a fresh start; as long as the sound."""
        self.reset()
        vibration = self.push(samples)
        return np.pad(vibration, (0, len(samples) - len(vibration)))

    def _shifted(self, sound: Floats) -> Floats:
        """Read the past with two heads that fall behind and jump forward in turn, each fading out before it jumps."""
        line = np.concatenate((self._heard, sound))
        behind = (1 - self._shift) * (self._count + np.arange(len(sound)))
        place = np.arange(GRAIN + 1, len(line))
        out = np.zeros(len(sound))
        for head in (0.0, 0.5):
            delay = (behind + head * GRAIN) % GRAIN
            whole = np.floor(delay).astype(np.intp)
            share = delay - whole
            value = (1 - share) * line[place - whole] + share * line[place - whole - 1]
            out += value * np.sin(np.pi * delay / GRAIN) ** 2
        self._heard = line[len(line) - GRAIN - 1 :]
        self._count += len(sound)
        return out

    def _ramps(self, values: Floats) -> FloatArray:
        """Go in straight lines from value to value."""
        if not len(values):
            return np.empty(0, np.float32)
        before = np.concatenate(([self._last], values[:-1]))
        self._last = float(values[-1])
        share = np.arange(1, STEP_SIZE + 1) / STEP_SIZE
        return np.asarray((before[:, None] + (values - before)[:, None] * share).reshape(-1), np.float32)


class _Chain:
    """Band, expander, transients, limiter: one value in, one out, at 4 kHz."""

    def __init__(self, dynamics: Dynamics, limits: Limits) -> None:
        rate = RATE / STEP_SIZE
        self._low, self._high = _Pole(limits.lowest, rate), _Pole(min(limits.highest, 0.2 * rate), rate)
        self._fast, self._slow = _Pole(1 / (2 * math.pi * 2e-3), rate), _Pole(1 / (2 * math.pi * 40e-3), rate)
        self._threshold = 10 ** (dynamics.threshold_dbfs / 20)
        self._gain = 10 ** (dynamics.gain_db / 20)
        self._dynamics, self._ceiling = dynamics, limits.ceiling

    def step(self, value: float) -> float:
        band = self._high.step(value - self._low.step(value))
        fast, slow = self._fast.step(abs(band)), self._slow.step(abs(band))
        under = min(1.0, slow / self._threshold) ** (self._dynamics.ratio - 1)
        # At most 12 dB either way: a tap after silence is a transient without end.
        sharp = min(4.0, max(0.25, (fast + 1e-6) / (slow + 1e-6))) ** self._dynamics.sharpness
        return self._ceiling * math.tanh(band * under * sharp * self._gain)


class _Pole:
    """A first-order low-pass."""

    def __init__(self, corner: float, rate: float) -> None:
        self._share = 1 - math.exp(-2 * math.pi * corner / rate)
        self._value = 0.0

    def step(self, value: float) -> float:
        self._value += self._share * (value - self._value)
        return self._value


PASSTHROUGH: Mapping[str, Callable[[Limits | None], Passthrough]] = MappingProxyType(
    {
        "direct": lambda limits: Passthrough(limits=limits),
        "pitch": lambda limits: Passthrough(shift=1 / 8, dynamics=Dynamics(threshold_dbfs=-45.0), limits=limits),
    }
)
"""Every renderer that needs no detector, by the name that ``feel --profile`` takes."""


def _low_pass(taps: int, corner: float) -> Floats:
    """Design a windowed-sinc low-pass (Hann window), of gain 1 at 0 Hz."""
    place = np.arange(taps) - taps // 2
    kernel = np.sinc(2 * corner / RATE * place) * np.hanning(taps + 2)[1:-1]
    return np.asarray(kernel / kernel.sum())
