r"""The sine that the finger feels: no click, no step, and silence when nobody asks for it any more.

Amplitude and frequency follow their targets through a first-order low-pass. Between two commands the targets stand
still, so everything has a closed form: ``n`` samples after a command that found amplitude :math:`a_0`,

.. math:: a_n = a + (a_0 - a) r^n, \quad \varphi_n = \varphi_0 + (f n + (f_0 - f) \sum_{k=1}^n r^k) / f_s

with :math:`r = e^{-1 / (\tau f_s)}`. A sample thus depends on the command and its distance from it, never on the
blocks in which a device asks: rendering in any pieces is equal to the bit. After ``SETTLED`` time constants
:math:`r^n` counts as zero, so that rest is exact silence.
"""

import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from tactophone.haptics.limits import Limits, is_sound
from tactophone.types import FloatArray, HapticCommand

SETTLED = 12
"""Time constants after which the target counts as reached."""

NEGLIGIBLE = math.exp(-SETTLED)
"""What is left of a full gap by then: 6e-6, 104 dB down."""

LONGEST = 1024
"""Samples rendered at once; longer blocks are rendered in such pieces, so that all memory is had beforehand."""


class Oscillator:
    """Renders commands as a phase-continuous sine; a `tactophone.types.Renderer`.

    ``submit`` and ``stop`` may be called from another thread than ``render``: each only sets one attribute.

    Parameters
    ----------
    limits
        Bounds on everything rendered. Ceiling and band change when another is assigned; the times are kept.
    sample_rate
        Of the waveform, in Hz.

    Attributes
    ----------
    faults
        Counts ``command`` (was no number, and answered with silence) and ``stale`` (a vibration faded because
        commands stopped coming).

    Examples
    --------
    >>> oscillator = Oscillator(Limits())
    >>> oscillator.submit(HapticCommand(amplitude=1.0, frequency=60.0, time=0.0))
    >>> out = np.empty(4800, np.float32)
    >>> oscillator.render(out)
    >>> round(float(abs(out[:1600]).max()), 2), float(abs(out[-480:]).max()), dict(oscillator.faults)
    (1.0, 0.0, {'stale': 1})
    """

    latency = 0.0
    """The first sample rendered after a command already moves towards it."""

    def __init__(self, limits: Limits | None = None, *, sample_rate: int = 48_000) -> None:
        self.limits = limits or Limits()
        self.faults: Counter[str] = Counter()
        self.sample_rate = sample_rate
        self._patience = round(self.limits.patience * sample_rate)
        self._settled = math.ceil(SETTLED * self.limits.settling * sample_rate)
        self._counts = np.arange(1.0, LONGEST + 1)
        self._decay, self._decay_sum = _tables(self.limits.settling * sample_rate, self._settled)
        self._envelope, self._phases = np.empty(LONGEST), np.empty(LONGEST)
        self._stopped = False
        self.reset()

    def reset(self) -> None:
        """Be silent and as new; what is stopped stays stopped."""
        self._slot = [HapticCommand(0.0, self.limits.lowest, 0.0)]
        self._seen = (self._slot, self.limits, self._stopped)
        self._amplitude = self._amplitude_gap = 0.0
        self._frequency, self._frequency_gap = self.limits.lowest, 0.0
        self._phase = 0.0
        self._age, self._unheard = self._settled, 0

    def submit(self, command: HapticCommand) -> None:
        """Put the newest command in the one slot; a command that is no number asks for silence."""
        if not is_sound(command):
            self.faults["command"] += 1
            command = HapticCommand(0.0, self.limits.lowest, command.time)
        # A new list each time, so that the same command given again counts as fresh.
        self._slot = [command]

    def stop(self) -> None:
        """Fade to silence and stay there, whatever is submitted, until :meth:`release`."""
        self._stopped = True

    def release(self) -> None:
        """Undo :meth:`stop`; only ever done on a person's word."""
        self._stopped = False

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` holds."""
        return self._stopped

    def render(self, out: FloatArray) -> None:
        """Write the next ``len(out)`` samples, shape ``(samples,)``, in place."""
        self._take()
        fresh = max(0, self._patience - self._unheard) if self._amplitude else len(out)
        self._write(out[:fresh])
        if fresh < len(out):
            self.faults["stale"] += 1
            self._retarget(0.0, self._frequency)
            self._write(out[fresh:])

    def _take(self) -> None:
        seen = (self._slot, self.limits, self._stopped)
        if all(new is old for new, old in zip(seen, self._seen, strict=True)):
            return
        if seen[0] is not self._seen[0]:
            self._unheard = 0
        self._seen = seen
        (command,), limits, stopped = seen
        wish = limits.bound(command)
        if stopped or self._unheard >= self._patience or not wish.amplitude:
            # A vibration that ends keeps its pitch on the way down.
            self._retarget(0.0, self._frequency)
        else:
            self._retarget(wish.amplitude, wish.frequency)

    def _retarget(self, amplitude: float, frequency: float) -> None:
        """Aim anew from wherever amplitude, frequency and phase are now."""
        if (amplitude, frequency) == (self._amplitude, self._frequency):
            return
        decay, decay_sum = self._now()
        here = self._amplitude + self._amplitude_gap * decay
        if here < NEGLIGIBLE:
            here, self._phase, self._frequency_gap = 0.0, 0.0, 0.0
        else:
            turns = self._frequency * self._age + self._frequency_gap * decay_sum
            self._phase = (self._phase + turns / self.sample_rate) % 1.0
            self._frequency_gap = self._frequency + self._frequency_gap * decay - frequency
        self._amplitude, self._amplitude_gap = amplitude, here - amplitude
        self._frequency, self._age = frequency, 0 if here or amplitude else self._settled

    def _now(self) -> tuple[float, float]:
        """How much of each gap is left, and its sum since the last target."""
        if not self._age:
            return 1.0, 0.0
        last = min(self._age, self._settled) - 1
        return float(self._decay[last]), float(self._decay_sum[last])

    def _write(self, out: FloatArray) -> None:
        self._unheard += len(out)
        for start in range(0, len(out), LONGEST):
            self._write_piece(out[start : start + LONGEST])

    def _write_piece(self, out: FloatArray) -> None:
        size, first = len(out), min(self._age, self._settled)
        if first == self._settled and not self._amplitude:
            out[:] = 0.0
            self._age += size
            return
        envelope, phases = self._envelope[:size], self._phases[:size]
        np.add(self._counts[:size], self._age, out=phases)
        phases *= self._frequency
        np.multiply(self._decay_sum[first : first + size], self._frequency_gap, out=envelope)
        phases += envelope
        phases *= 1 / self.sample_rate
        phases += self._phase
        # Whole turns are taken off before the sine: it is exact and fast near zero only.
        phases -= np.floor(phases, out=envelope)
        phases *= 2 * np.pi
        np.sin(phases, out=phases)
        np.multiply(self._decay[first : first + size], self._amplitude_gap, out=envelope)
        envelope += self._amplitude
        np.minimum(envelope, self._seen[1].ceiling, out=envelope)
        np.multiply(envelope, phases, out=out, casting="same_kind")
        self._age += size


def _tables(time_constant: float, settled: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Powers of the decay after 1, 2, ... samples, zero once settled, and their running sum."""
    powers = np.exp(-np.arange(1.0, settled + LONGEST + 1) / time_constant)
    powers[settled - 1 :] = 0.0
    return powers, np.cumsum(powers)
