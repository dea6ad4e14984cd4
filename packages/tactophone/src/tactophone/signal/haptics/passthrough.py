"""The sound itself as vibration, without a detector: what the paper's authors tried
first (section III-B).

``direct``: the contact microphone's sound goes to the actuator through a band-pass of
the tactile range, an expander that suppresses noise, and a transient shaper. ``pitch``:
the sound is shifted down by three octaves first, so that the band in which surfaces
differ falls into the tactile range. ``median-frequency``: a sine whose frequency is the
median frequency of the sound, as the stimulus of Svensson et al. (2021) has it.

The low band is processed sample by sample at 4 kHz, so that the result is bit-equal in
blocks of any size.

Sound alone has no information on contact, faults or stale data. So
`PassthroughRenderer` gates it by the amplitude of the newest command, and only while
commands keep arriving: whatever silences the oscillator silences it too.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

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

STEP_SIZE = 12
"""Samples from one value of the low band to the next: 4 kHz, four times the highest
frequency of the actuator."""

TAPS = 97
"""Length of the low-pass before decimation: 1 ms of delay, 50 dB down from 2.3 kHz
on."""

GRAIN = 1440
"""Samples, 30 ms, over which the two heads of the pitch shifter alternate: two periods
of 70 Hz."""

MEDIAN_SIZE = 256
"""Values, 64 ms at 4 kHz, over which the median frequency is taken: two periods of the
actuator's lowest."""

MEDIAN_HOP = 16
"""Values, 4 ms, from one median to the next."""

Floats = NDArray[np.float64]


RATIO = 3.0
"""Decibels out of the expander for each decibel under its threshold."""

SHARPNESS = 0.5
"""Exponent on fast over slow level; 0: transients unchanged."""

PASSTHROUGH_GAIN_DB = 24.0
"""Overall gain; a soft limiter (tanh) holds the result under the ceiling."""


class Passthrough:
    """Renders the contact microphone's sound as vibration.

    - ``shift``: factor on every frequency; 1: unchanged.
    - ``threshold_dbfs``: level in the tactile band above which sound passes unchanged; below it the expander works.
    - ``limits``: bounds of the vibration.
    - ``open_chain``: makes what turns values of the low band into vibration; by default the sound itself, with
      dynamics.

    >>> time = np.arange(4800) / 48_000
    >>> vibration = Passthrough().render_whole(0.3 * np.sin(2 * np.pi * 200 * time).astype(np.float32)[:, None])
    >>> vibration.shape, bool(abs(vibration).max() > 0.25)
    ((4800,), True)
    """

    def __init__(
        self,
        *,
        shift: float = 1.0,
        threshold_dbfs: float = -38.0,
        limits: Limits | None = None,
        open_chain: "type[_Chain] | None" = None,
    ) -> None:
        self._shift, self._threshold_dbfs, self._limits = (
            shift,
            threshold_dbfs,
            limits or Limits(),
        )
        self._open_chain = open_chain or _Chain
        # A windowed-sinc low-pass (Hann window), of gain 1 at 0 Hz.
        place, corner = np.arange(TAPS) - TAPS // 2, LIVE_SAMPLE_RATE / STEP_SIZE * 0.4
        kernel = (
            np.sinc(2 * corner / LIVE_SAMPLE_RATE * place) * np.hanning(TAPS + 2)[1:-1]
        )
        self._kernel: Floats = kernel / kernel.sum()
        self.latency: float = (
            TAPS // 2 + STEP_SIZE + (GRAIN / 2 if shift != 1 else 0)
        ) / LIVE_SAMPLE_RATE
        """Seconds: the low-pass, the step to the next value, and half a grain if pitch
        is shifted."""
        self.reset()

    def reset(self) -> None:
        self._past: Floats = np.zeros(GRAIN + 1)
        self._count = 0
        self._waiting: Floats = np.zeros(TAPS - 1)
        self._chain = self._open_chain(self._threshold_dbfs, self._limits)
        self._last = 0.0

    def push(self, samples: FloatArray) -> FloatArray:
        """Process 48 kHz sound, shape ``(samples, channels)``; returns the vibration it
        completes, in steps of 12."""
        sound = np.nan_to_num(
            samples[:, 0].astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0
        )
        sound = np.clip(sound, -1.0, 1.0)
        shifted = sound if self._shift == 1 else self._shifted(sound)
        self._waiting = np.concatenate((self._waiting, shifted))
        count = (len(self._waiting) - TAPS + 1) // STEP_SIZE
        if count <= 0:
            # After a whole number of steps less than a window waits, and a view of it
            # cannot be made.
            return np.zeros(0, np.float32)
        windows = sliding_window_view(self._waiting, TAPS)[
            : count * STEP_SIZE : STEP_SIZE
        ]
        values = [
            self._chain.step(float(value))
            for value in (windows * self._kernel).sum(axis=1)
        ]
        self._waiting = self._waiting[count * STEP_SIZE :]
        return self._ramps(np.array(values))

    def render_whole(self, samples: FloatArray) -> FloatArray:
        """Render a whole sound from the initial state; returns as many samples."""
        self.reset()
        vibration = self.push(samples)
        return np.pad(vibration, (0, len(samples) - len(vibration)))

    def _shifted(self, sound: Floats) -> Floats:
        """Shift the pitch with two delay heads that fall behind and jump forward in
        turn, each silent when it jumps."""
        # ``behind`` grows by 1 - shift a sample: each head reads the past at ``shift``
        # times the speed, with a delay that wraps at one grain. The squared sines of
        # the two heads, half a grain apart, add up to 1.
        line = np.concatenate((self._past, sound))
        behind = (1 - self._shift) * (self._count + np.arange(len(sound)))
        place = np.arange(GRAIN + 1, len(line))
        out = np.zeros(len(sound))
        for head in (0.0, 0.5):
            delay = (behind + head * GRAIN) % GRAIN
            whole = np.floor(delay).astype(np.intp)
            share = delay - whole
            value = (1 - share) * line[place - whole] + share * line[place - whole - 1]
            out += value * np.sin(np.pi * delay / GRAIN) ** 2
        self._past = line[len(line) - GRAIN - 1 :]
        self._count += len(sound)
        return out

    def _ramps(self, values: Floats) -> FloatArray:
        """Interpolate linearly from value to value, ``STEP_SIZE`` samples each."""
        before = np.concatenate(([self._last], values[:-1]))
        self._last = float(values[-1])
        share = (
            np.arange(1, STEP_SIZE + 1) / STEP_SIZE
        )  # shape (STEP_SIZE,); broadcast to (values, STEP_SIZE)
        return np.asarray(
            (before[:, None] + (values - before)[:, None] * share).reshape(-1),
            np.float32,
        )


class _Chain:
    """Band-pass, expander, transient shaper, limiter, band limits: one value in, one
    out, at 4 kHz.

    The limiter turns pulses of one sign into a constant force, and edges into steps.
    What follows it takes both out again: an integral of the output is subtracted, which
    is a high-pass that keeps the mean at 0 within the bounds too, and no value is
    further from the last one than in a sine of full amplitude at the upper end of the
    band.
    """

    def __init__(self, threshold_dbfs: float, limits: Limits) -> None:
        rate = LIVE_SAMPLE_RATE / STEP_SIZE
        self._low, self._high = (
            _Pole(limits.lowest, rate),
            _Pole(min(limits.highest, 0.2 * rate), rate),
        )
        self._fast, self._slow = (
            _Pole(1 / (2 * math.pi * 2e-3), rate),
            _Pole(1 / (2 * math.pi * 40e-3), rate),
        )
        self._threshold, self._gain, self._ceiling = (
            10 ** (threshold_dbfs / 20),
            10 ** (PASSTHROUGH_GAIN_DB / 20),
            limits.ceiling,
        )
        self._offset_share, self._steepest = (
            2 * math.pi * limits.lowest / rate,
            2 * math.pi * limits.highest / rate,
        )
        self._offset = self._last = 0.0

    def step(self, value: float) -> float:
        band = self._high.step(value - self._low.step(value))
        fast, slow = self._fast.step(abs(band)), self._slow.step(abs(band))
        under = min(1.0, slow / self._threshold) ** (RATIO - 1)
        # The ratio is held within 12 dB either way: for a tap after silence it would be
        # unbounded.
        sharp = min(4.0, max(0.25, (fast + 1e-6) / (slow + 1e-6))) ** SHARPNESS
        wanted = math.tanh(band * under * sharp * self._gain) - self._offset
        wanted = min(
            max(wanted, self._last - self._steepest), self._last + self._steepest
        )
        self._last = min(1.0, max(-1.0, wanted))
        self._offset += self._offset_share * self._last
        return self._ceiling * self._last


class _MedianChain(_Chain):
    """A sine at the median frequency of the sound, as loud as the sound after the
    expander.

    The median is taken within the actuator's band, so that it can always be rendered:
    half of the power between ``limits.lowest`` and ``limits.highest`` lies on either
    side. It lags by half of :data:`MEDIAN_SIZE`.
    """

    def __init__(self, threshold_dbfs: float, limits: Limits) -> None:
        super().__init__(threshold_dbfs, limits)
        self._rate = rate = LIVE_SAMPLE_RATE / STEP_SIZE
        self._slow = _Pole(1 / (2 * math.pi * 10e-3), rate)
        bins = np.fft.rfftfreq(MEDIAN_SIZE, 1 / rate)
        self._band = (bins >= limits.lowest) & (bins <= limits.highest)
        self._bins, self._window = bins[self._band], np.hanning(MEDIAN_SIZE)
        self._frequency = _Pole(1 / (2 * math.pi * 10e-3), rate)
        self._past: Floats = np.zeros(MEDIAN_SIZE)
        self._count, self._median, self._phase = 0, limits.lowest, 0.0

    def step(self, value: float) -> float:
        band = value - self._low.step(value)
        slow = self._slow.step(abs(band))
        self._past[self._count % MEDIAN_SIZE] = band
        self._count += 1
        if self._count % MEDIAN_HOP == 0:
            self._median = self._measure()
        # Continuous phase: the frequency glides, and nothing clicks.
        self._phase = (
            self._phase + self._frequency.step(self._median) / self._rate
        ) % 1.0
        under = min(1.0, slow / self._threshold) ** (RATIO - 1)
        return (
            self._ceiling
            * math.tanh(slow * under * self._gain)
            * math.sin(2 * math.pi * self._phase)
        )

    def _measure(self) -> float:
        ordered = np.roll(self._past, -(self._count % MEDIAN_SIZE))
        powers = np.square(np.abs(np.fft.rfft(ordered * self._window))[self._band])
        total = np.cumsum(powers)
        return (
            float(self._bins[np.searchsorted(total, total[-1] / 2)])
            if total[-1] > 0
            else self._median
        )


class _Pole:
    """A first-order low-pass."""

    def __init__(self, corner: float, rate: float) -> None:
        self._share = 1 - math.exp(-2 * math.pi * corner / rate)
        self._value = 0.0

    def step(self, value: float) -> float:
        self._value += self._share * (value - self._value)
        return self._value


PASSTHROUGH: Mapping[str, Callable[[Limits | None], Passthrough]] = {
    "direct": lambda limits: Passthrough(limits=limits),
    "median-frequency": lambda limits: Passthrough(
        limits=limits, open_chain=_MedianChain
    ),
    "pitch": lambda limits: Passthrough(
        shift=1 / 8, threshold_dbfs=-45.0, limits=limits
    ),
}
"""Renderers of the sound itself, by the name that ``feel --profile`` takes."""


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

    ``passthrough`` makes vibration from sound, with a ceiling of 1, as the gate applies
    the ceiling; ``pull`` returns the next so many samples of sound at 48 kHz, shape
    ``(samples, channels)``, silence where there is none.
    """

    def __init__(
        self,
        passthrough: Passthrough,
        pull: Callable[[int], FloatArray],
        limits: Limits | None = None,
    ) -> None:
        super().__init__(limits)
        self._passthrough, self._pull = passthrough, pull
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
        self._gain, self._since_command, self._period = 0.0, 0, 0

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
        """Target of the gate, 0 to 1; 0 once commands are stale."""
        slot = self._slot
        if slot is not self._seen:
            self._seen, self._since_command = slot, 0
        # A period counts as a whole: it fades from its beginning if the command becomes
        # stale anywhere in it. The fault is counted once, in the period that crosses
        # the limit.
        before, self._since_command = self._since_command, self._since_command + size
        if self._since_command > self._timeout:
            self.faults["stale"] += before <= self._timeout and slot[0].amplitude > 0
            return 0.0
        return 0.0 if self.stopped else self.limits.bound(slot[0]).amplitude

    def _vibration(self, size: int) -> FloatArray:
        # Always in pieces of one length, which the clocked buffer needs, though
        # PortAudio's periods may vary.
        self._period = max(self._period, size)
        while len(self._ready) < size:
            self._ready = np.concatenate(
                (self._ready, self._passthrough.push(self._pull(self._period)))
            )
        now, self._ready = self._ready[:size], self._ready[size:]
        return now
