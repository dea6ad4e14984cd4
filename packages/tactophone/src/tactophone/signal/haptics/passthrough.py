"""The sound itself as vibration, without a detector: what the paper's authors tried
first (section III-B).

``direct``: the contact microphone's sound goes to the actuator through a band-pass of
the tactile range, an expander that suppresses noise, and a transient shaper. A package
of your own adds another by an entry point in ``tactophone.passthroughs``;
``examples/plugins/tactophone_passthroughs`` adds two.

The low band is processed sample by sample at 4 kHz, so that the result is bit-equal in
blocks of any size.

Sound alone has no information on contact, faults or stale data. So
`PassthroughRenderer` gates it by the amplitude of the newest command, and only while
commands keep arriving: whatever silences the oscillator silences it too.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.plugins import PASSTHROUGHS, load, registered
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    FloatArray,
    HapticCommand,
    Prediction,
    Touch,
)
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import (
    COMMAND_STALE_AFTER,
    MAX_PIECE,
    NEGLIGIBLE,
    RAMP,
    Renderer,
)
from tactophone.signal.haptics.profiles import PROFILES

STEP_SIZE = 12
"""Samples from one value of the low band to the next: 4 kHz, four times the highest
frequency of the actuator."""

LOW_BAND_RATE = LIVE_SAMPLE_RATE / STEP_SIZE
"""Values of the low band in a second."""

TAPS = 97
"""Length of the low-pass before decimation: 1 ms of delay, 50 dB down from 2.3 kHz
on."""

EXPANDER_RATIO = 3.0
"""Decibels out of the expander for each decibel under its threshold."""

EXPANDER_THRESHOLD_DBFS = -38.0
"""Level in the tactile band above which sound passes unchanged; below it the expander
works."""

SHARPNESS = 0.5
"""Exponent on the ratio of fast to slow level; 0 leaves transients unchanged."""

SHARPEST = 4.0
"""Bounds the ratio of fast to slow level at 12 dB either way: for a tap after silence
it would grow without limit."""

FAST_LEVEL = 2e-3
"""Seconds over which the level that follows transients is averaged."""

SLOW_LEVEL = 40e-3
"""Seconds over which the level that transients stand out from is averaged."""

PASSTHROUGH_GAIN_DB = 24.0
"""Overall gain; a soft limiter (tanh) holds the result under the ceiling."""

Floats = NDArray[np.float64]


class LowPass:
    """A first-order low-pass of the low band, with its corner in Hz."""

    def __init__(self, corner: float) -> None:
        self._share = 1 - math.exp(-2 * math.pi * corner / LOW_BAND_RATE)
        self._value = 0.0

    @classmethod
    def averaging(cls, duration: float) -> "LowPass":
        """Make the low-pass with a time constant in seconds."""
        return cls(1 / (2 * math.pi * duration))

    def step(self, value: float) -> float:
        self._value += self._share * (value - self._value)
        return self._value


class Chain(Protocol):
    """Turns the low band into vibration, one value at a time, at 4 kHz."""

    def step(self, value: float) -> float: ...


class DirectChain:
    """Band-pass, expander, transient shaper, limiter and band limits.

    The limiter turns pulses of one sign into a constant force, and edges into steps.
    What follows it takes both out again: an integral of the output is subtracted, which
    is a high-pass that keeps the mean at 0 within the bounds too, and no value is
    further from the last one than in a sine of full amplitude at the upper end of the
    band.
    """

    def __init__(self, threshold_dbfs: float, limits: Limits) -> None:
        self._low = LowPass(limits.lowest)
        self._high = LowPass(min(limits.highest, 0.2 * LOW_BAND_RATE))
        self._fast = LowPass.averaging(FAST_LEVEL)
        self._slow = LowPass.averaging(SLOW_LEVEL)
        self._threshold = 10 ** (threshold_dbfs / 20)
        self._gain = 10 ** (PASSTHROUGH_GAIN_DB / 20)
        self._ceiling = limits.ceiling
        self._offset_share = 2 * math.pi * limits.lowest / LOW_BAND_RATE
        self._steepest = 2 * math.pi * limits.highest / LOW_BAND_RATE
        self._offset = 0.0
        self._last = 0.0

    def step(self, value: float) -> float:
        band = self._high.step(value - self._low.step(value))
        fast = self._fast.step(abs(band))
        slow = self._slow.step(abs(band))
        under = min(1.0, slow / self._threshold) ** (EXPANDER_RATIO - 1)
        ratio = (fast + 1e-6) / (slow + 1e-6)
        sharp = min(SHARPEST, max(1 / SHARPEST, ratio)) ** SHARPNESS
        wanted = math.tanh(band * under * sharp * self._gain) - self._offset
        # What is felt may neither jump nor leave the bounds, and its mean returns to 0:
        # the offset integrates what is put out, not what was wanted.
        highest = self._last + self._steepest
        lowest = self._last - self._steepest
        wanted = min(max(wanted, lowest), highest)
        self._last = min(1.0, max(-1.0, wanted))
        self._offset += self._offset_share * self._last
        return self._ceiling * self._last


class Passthrough:
    """Renders the contact microphone's sound as vibration.

    - ``limits``: bounds of the vibration.
    - ``threshold_dbfs``: see `EXPANDER_THRESHOLD_DBFS`.
    - ``open_chain``: makes what turns values of the low band into vibration; by default
      the sound itself, with dynamics.

    >>> time = np.arange(4800) / 48_000
    >>> sound = 0.3 * np.sin(2 * np.pi * 200 * time).astype(np.float32)
    >>> vibration = Passthrough().render_whole(sound[:, None])
    >>> vibration.shape, bool(abs(vibration).max() > 0.25)
    ((4800,), True)
    """

    def __init__(
        self,
        limits: Limits | None = None,
        *,
        threshold_dbfs: float = EXPANDER_THRESHOLD_DBFS,
        open_chain: Callable[[float, Limits], Chain] = DirectChain,
    ) -> None:
        self._limits = limits or Limits()
        self._threshold_dbfs = threshold_dbfs
        self._open_chain = open_chain
        # A windowed-sinc low-pass (Hann window), of gain 1 at 0 Hz.
        place = np.arange(TAPS) - TAPS // 2
        corner = LOW_BAND_RATE * 0.4
        sinc = np.sinc(2 * corner / LIVE_SAMPLE_RATE * place)
        kernel = sinc * np.hanning(TAPS + 2)[1:-1]
        self._kernel: Floats = kernel / kernel.sum()
        self.latency: float = (TAPS // 2 + STEP_SIZE) / LIVE_SAMPLE_RATE
        """Seconds: the low-pass, and the step to the next value."""
        self.reset()

    def reset(self) -> None:
        self._waiting: Floats = np.zeros(TAPS - 1)
        self._chain = self._open_chain(self._threshold_dbfs, self._limits)
        self._last = 0.0

    def prepare(self, sound: Floats) -> Floats:
        """Change the contact microphone's sound before it is brought to the low band.

        A passthrough of your own overrides it; here the sound stays as it is. Samples
        are finite and in [-1, 1]; as many are returned.
        """
        return sound

    def push(self, samples: FloatArray) -> FloatArray:
        """Process 48 kHz sound, shape ``(samples, channels)``; returns the vibration it
        completes, in steps of 12."""
        sound = np.nan_to_num(
            samples[:, 0].astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0
        )
        prepared = self.prepare(np.clip(sound, -1.0, 1.0))
        self._waiting = np.concatenate((self._waiting, prepared))
        count = (len(self._waiting) - TAPS + 1) // STEP_SIZE
        if count <= 0:
            # After a whole number of steps less than a window waits, and a view of it
            # cannot be made.
            return np.zeros(0, np.float32)
        windows = sliding_window_view(self._waiting, TAPS)
        windows = windows[: count * STEP_SIZE : STEP_SIZE]
        low_band = (windows * self._kernel).sum(axis=1)
        values = [self._chain.step(float(value)) for value in low_band]
        self._waiting = self._waiting[count * STEP_SIZE :]
        return self._ramps(np.array(values))

    def render_whole(self, samples: FloatArray) -> FloatArray:
        """Render a whole sound from the initial state; returns as many samples."""
        self.reset()
        vibration = self.push(samples)
        return np.pad(vibration, (0, len(samples) - len(vibration)))

    def _ramps(self, values: Floats) -> FloatArray:
        """Interpolate linearly from value to value, ``STEP_SIZE`` samples each."""
        before = np.concatenate(([self._last], values[:-1]))
        self._last = float(values[-1])
        share = np.arange(1, STEP_SIZE + 1) / STEP_SIZE
        # The share, of shape (STEP_SIZE,), is broadcast to (values, STEP_SIZE).
        ramps = before[:, None] + (values - before)[:, None] * share
        return np.asarray(ramps.reshape(-1), np.float32)


PASSTHROUGH: Mapping[str, Callable[[Limits | None], Passthrough]] = {
    "direct": Passthrough
}
"""Passthroughs that are built in, by the name that ``--profile`` takes."""


def passthrough_names() -> tuple[str, ...]:
    """Return the names of all passthroughs: first the built-in ones, then what other
    packages add."""
    added = registered(PASSTHROUGHS)
    return (
        *PASSTHROUGH,
        *(name for name in added if name not in (*PASSTHROUGH, *PROFILES)),
    )


def is_passthrough(profile: str) -> bool:
    """Return whether a profile renders the sound itself.

    No other package replaces a profile that is built in.
    """
    return profile not in PROFILES and profile in passthrough_names()


def open_passthrough(name: str, limits: Limits | None = None) -> Passthrough:
    """Make the passthrough of a name.

    Raises
    ------
    ConfigError
        If there is no passthrough of that name.
    """
    if name in PASSTHROUGH:
        return PASSTHROUGH[name](limits)
    if is_passthrough(name):
        made: Passthrough = load(PASSTHROUGHS, name)(limits)
        return made
    names = passthrough_names()
    raise ConfigError(
        f"no passthrough {name!r}; there are {', '.join(names)}"
        f"{did_you_mean(name, names)}"
    )


@dataclass(frozen=True, slots=True)
class GateProfile:
    """The profile that gates passed sound: open in contact, closed without. Its
    frequency is unused."""

    name: str

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return full amplitude during contact, and zero without."""
        return HapticCommand(
            float(prediction.touch is not Touch.NONE), 0.0, prediction.end
        )


class PassthroughRenderer(Renderer):
    """Renders sound, gated by the amplitude of commands.

    - ``passthrough``: makes vibration from sound, with a ceiling of 1, as the gate
      applies the ceiling.
    - ``pull``: called with a number of samples; returns that much sound at 48 kHz,
      shape ``(samples, channels)``, and silence where no sound arrived.
    """

    def __init__(
        self,
        passthrough: Passthrough,
        pull: Callable[[int], FloatArray],
        limits: Limits | None = None,
    ) -> None:
        super().__init__(limits)
        self._passthrough = passthrough
        self._pull = pull
        self.latency = passthrough.latency + (STEP_SIZE - 1) / LIVE_SAMPLE_RATE
        self._timeout = round(COMMAND_STALE_AFTER * LIVE_SAMPLE_RATE)
        self._decay = np.exp(
            -np.arange(1, MAX_PIECE + 1) / (RAMP * LIVE_SAMPLE_RATE)
        ).astype(np.float32)
        self.reset()

    def reset(self) -> None:
        self._passthrough.reset()
        # Vibration is made in whole steps: with this reserve, a full period is always
        # ready.
        self._ready = np.zeros(STEP_SIZE - 1, np.float32)
        super().reset()
        self._seen = self._slot
        self._gain = 0.0
        self._since_command = 0
        self._period = 0

    def render(self, out: FloatArray) -> None:
        for start in range(0, len(out), MAX_PIECE):
            self._write(out[start : start + MAX_PIECE])

    def _write(self, out: FloatArray) -> None:
        target = self._target(len(out))
        # The gate's gain falls towards its target as the oscillator's amplitude does:
        # target + (gain - target) r^n.
        np.multiply(self._gain - target, self._decay[: len(out)], out=out)
        out += target
        last = float(out[-1])
        self._gain = last if target or last > NEGLIGIBLE else 0.0
        # Sound is fetched even while the gate is closed: the clocked buffer is steered
        # by what is taken from it.
        out *= self._vibration(len(out))
        np.clip(out, -self.limits.machine, self.limits.machine, out=out)

    def _target(self, size: int) -> float:
        """Return the gate's target, 0 to 1; 0 once commands are stale."""
        slot = self._slot
        if slot is not self._seen:
            self._seen = slot
            self._since_command = 0
        # A period counts as a whole: it fades from its beginning if the command becomes
        # stale anywhere in it. The fault is counted once, in the period that crosses
        # the limit.
        before = self._since_command
        self._since_command = before + size
        if self._since_command > self._timeout:
            self.faults["stale"] += before <= self._timeout and slot[0].amplitude > 0
            return 0.0
        if self.stopped:
            return 0.0
        return self.limits.bound(slot[0]).amplitude

    def _vibration(self, size: int) -> FloatArray:
        # Sound is pulled in pieces of one length, as the clocked buffer needs it,
        # though PortAudio's periods may vary.
        self._period = max(self._period, size)
        while len(self._ready) < size:
            more = self._passthrough.push(self._pull(self._period))
            self._ready = np.concatenate((self._ready, more))
        now = self._ready[:size]
        self._ready = self._ready[size:]
        return now
