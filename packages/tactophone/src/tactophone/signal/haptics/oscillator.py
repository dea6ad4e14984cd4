r"""The sine for the actuator: no click, no step, and silence when commands stop
arriving.

Amplitude and frequency follow their targets through a first-order low-pass. Between two
commands the targets are constant, so everything has a closed form: ``n`` samples after
a command that found amplitude :math:`a_0`,

.. math::

    a_n = a + (a_0 - a) r^n, \quad
    \varphi_n = \varphi_0 + (f n + (f_0 - f) \sum_{k=1}^n r^k) / f_s

with :math:`r = e^{-1 / (\tau f_s)}`. A sample thus depends on the command and its
distance from it, never on the device's block size: rendering in any pieces is
bit-equal. After `SETTLED_TIME_CONSTANTS`, :math:`r^n` counts as zero, so that rest is
exact silence.
"""

import math
import operator
from collections import Counter, deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    AudioBlock,
    FloatArray,
    HapticCommand,
)
from tactophone.signal.haptics.limits import Limits, is_finite

RAMP = 0.004
"""Seconds: time constant of the low-pass on amplitude and frequency. It bounds the
slew: an amplitude never moves faster than ``1 / RAMP`` of full drive a second. That is
far under the 30 ms of the shortest burst that a finger notices, and slow enough that
nothing clicks. An amplitude falls to exact silence in 12 time constants, 48 ms."""

COMMAND_STALE_AFTER = 0.035
"""Longest time, in s, from a vibration's last command to the beginning of its fade:
three missed hops of 10.67 ms. The fade begins within 40 ms, and ends within 35 + 48 <
100 ms."""

SETTLED_TIME_CONSTANTS = 12
"""Time constants after which the target counts as reached."""

NEGLIGIBLE = math.exp(-SETTLED_TIME_CONSTANTS)
"""What is left of a full gap by then: 6e-6, 104 dB down."""

MAX_PIECE = 1024
"""Samples rendered at once; longer blocks are rendered in such pieces, so that no
memory is allocated later."""


class Renderer:
    """Base of the renderers: commands in, waveform out, called in the actuator's
    thread.

    ``submit``, ``stop`` and ``release`` may be called from a thread other than
    ``render``'s: each sets one attribute.

    Parameters
    ----------
    limits
        Bounds of everything rendered. Other limits may be assigned: ceiling and band
        take effect at once.

    Attributes
    ----------
    faults
        Counts of ``command`` (not finite, rendered as silence) and ``stale`` (a
        vibration faded because commands stopped arriving).
    silent
        Whether the last samples rendered are all exactly 0; false where that is not
        known.
    latency
        Seconds from input to its first effect on the waveform; 0 where the first sample
        already moves towards it.
    stopped
        Whether :meth:`stop` is in force.
    """

    silent = False
    latency = 0.0
    sample_rate: int = LIVE_SAMPLE_RATE
    """Of the waveform, in Hz."""

    def __init__(self, limits: Limits | None) -> None:
        self.limits = limits or Limits()
        self.faults: Counter[str] = Counter()
        self.stopped = False

    def submit(self, command: HapticCommand) -> None:
        """Replace the current command; one that is not finite means silence. Never
        waits."""
        if not is_finite(command):
            self.faults["command"] += 1
            command = HapticCommand(0.0, self.limits.lowest, command.time)
        # A new list each time, so that an equal command counts as fresh.
        self._slot = [command]

    def stop(self) -> None:
        """Fade to silence and stay silent, whatever is submitted, until
        :meth:`release`."""
        self.stopped = True

    def release(self) -> None:
        """Undo :meth:`stop`; called only when a person arms."""
        self.stopped = False

    def reset(self) -> None:
        """Return to silence and the initial state; a stop stays in force."""
        self._slot = [HapticCommand(0.0, self.limits.lowest, 0.0)]

    def render(self, out: FloatArray) -> None:
        """Write the next ``len(out)`` samples, shape ``(samples,)``, in place."""
        raise NotImplementedError


class Oscillator(Renderer):
    """Renders commands as a phase-continuous sine.

    Parameters
    ----------
    limits
        See `Renderer`.
    sample_rate
        Of the waveform, in Hz.

    Examples
    --------
    >>> from tactophone import HapticCommand
    >>> oscillator = Oscillator(Limits())
    >>> oscillator.submit(HapticCommand(amplitude=1.0, frequency=60.0, time=0.0))
    >>> out = np.empty(4800, np.float32)
    >>> oscillator.render(out)
    >>> round(float(abs(out[:1600]).max()), 2), float(abs(out[-480:]).max())
    (0.5, 0.0)
    >>> dict(oscillator.faults)
    {'stale': 1}
    """

    def __init__(
        self, limits: Limits | None = None, *, sample_rate: int = LIVE_SAMPLE_RATE
    ) -> None:
        super().__init__(limits)
        self.sample_rate = sample_rate
        self._timeout = round(COMMAND_STALE_AFTER * sample_rate)
        self._settled = math.ceil(SETTLED_TIME_CONSTANTS * RAMP * sample_rate)
        self._counts = np.arange(1.0, MAX_PIECE + 1)
        self._decay, self._decay_sum = _tables(RAMP * sample_rate, self._settled)
        self._envelope = np.empty(MAX_PIECE)
        self._phases = np.empty(MAX_PIECE)
        self.reset()

    def reset(self) -> None:
        """Return to silence and the initial state; a stop stays in force."""
        super().reset()
        self._seen = (self._slot, self.limits, self.limits.ceiling, self.stopped)
        # A segment lasts from one change of target to the next. Amplitude and frequency
        # are its targets, the gaps what was missing to them at its beginning.
        self._amplitude = 0.0
        self._amplitude_gap = 0.0
        self._frequency = self.limits.lowest
        self._frequency_gap = 0.0
        self._phase = 0.0
        """Turns, 0 to 1, at the beginning of the segment."""
        self._age = self._settled
        """Samples since the segment began."""
        self._since_command = 0
        """Samples since the newest command came."""

    def render(self, out: FloatArray) -> None:
        """Write the next ``len(out)`` samples, shape ``(samples,)``, in place."""
        self._apply_changes()
        self.silent = True
        # The time for which the newest command still holds is counted in samples
        # rendered: no clock is read, so that a late callback neither shortens nor
        # lengthens a vibration. Silence never becomes stale.
        fresh = len(out)
        if self._amplitude:
            fresh = max(0, self._timeout - self._since_command)
        if fresh >= len(out):
            self._write(out)
            return
        self._write(out[:fresh])
        self.faults["stale"] += 1
        self._retarget(0.0, self._frequency)
        self._write(out[fresh:])

    def _apply_changes(self) -> None:
        """Follow a command, limits or a stop set since the last call, perhaps by
        another thread."""
        # Each is read once and compared by identity. So no lock is needed, and a change
        # between two reads is seen next time.
        seen = (self._slot, self.limits, self.limits.ceiling, self.stopped)
        before = self._seen
        if all(map(operator.is_, seen, before)):
            return
        if seen[0] is not before[0]:
            self._since_command = 0
        self._seen = seen
        (command,), limits, _, stopped = seen
        target = limits.bound(command)
        stale = self._since_command >= self._timeout
        if stopped or stale or not target.amplitude:
            # A vibration that ends keeps its frequency while it fades.
            self._retarget(0.0, self._frequency)
        else:
            self._retarget(target.amplitude, target.frequency)

    def _retarget(self, amplitude: float, frequency: float) -> None:
        """Start towards new targets from the present amplitude, frequency and phase."""
        if (amplitude, frequency) == (self._amplitude, self._frequency):
            return
        now = min(self._age, self._settled)
        decay = float(self._decay[now])
        decay_sum = float(self._decay_sum[now])
        # The closed form restarts here: the present state becomes the initial state of
        # the new segment, and each gap is the distance from the new target that has yet
        # to decay.
        here = self._amplitude + self._amplitude_gap * decay
        # From silence a vibration begins at phase 0 and at its own frequency: nothing
        # is left to glide from.
        if here < NEGLIGIBLE:
            here = 0.0
            self._phase = 0.0
            self._frequency_gap = 0.0
        else:
            turns = self._frequency * self._age + self._frequency_gap * decay_sum
            self._phase = (self._phase + turns / self.sample_rate) % 1.0
            self._frequency_gap = (
                self._frequency + self._frequency_gap * decay - frequency
            )
        self._amplitude = amplitude
        self._amplitude_gap = here - amplitude
        self._frequency = frequency
        self._age = 0 if here or amplitude else self._settled

    def _write(self, out: FloatArray) -> None:
        self._since_command += len(out)
        for start in range(0, len(out), MAX_PIECE):
            self._write_piece(out[start : start + MAX_PIECE])

    def _write_piece(self, out: FloatArray) -> None:
        size = len(out)
        first = min(self._age, self._settled) + 1
        if first > self._settled and not self._amplitude:
            # At rest: neither age nor phase need go on, since the next segment begins
            # at phase 0.
            out[:] = 0.0
            self._age += size
            return
        self.silent: bool = False
        envelope = self._envelope[:size]
        phases = self._phases[:size]
        # Turns since the segment began: the target's, f n, and what the gap in
        # frequency adds, (f0 - f) sum(r^k).
        np.add(self._counts[:size], self._age, out=phases)
        phases *= self._frequency
        if self._frequency_gap:
            np.multiply(
                self._decay_sum[first : first + size], self._frequency_gap, out=envelope
            )
            phases += envelope
        phases *= 1 / self.sample_rate
        phases += self._phase
        # Whole turns are removed before the sine, which is exact and fast near zero
        # only.
        phases -= np.floor(phases, out=envelope)
        phases *= 2 * np.pi
        np.sin(phases, out=phases)
        np.multiply(
            self._decay[first : first + size], self._amplitude_gap, out=envelope
        )
        envelope += self._amplitude
        # Commands are bounded already. A ceiling that was lowered is followed like a
        # command, since a cut would click; only the machine's own is enforced at once.
        machine = self._seen[1].machine
        if max(self._amplitude, self._amplitude + self._amplitude_gap) > machine:
            np.minimum(envelope, machine, out=envelope)
        np.multiply(envelope, phases, out=out, casting="same_kind")
        self._age += size


def _tables(
    time_constant: float, settled: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the powers r^n of the decay after n = 0, 1, ... samples, and their running
    sums from n = 1.

    The frequency n samples into a segment is f + (f0 - f) r^n. The phase adds up the
    frequencies of all samples before, so the gap adds (f0 - f) times the sum of r^k: a
    table of sums makes each sample's phase one product. From ``settled`` on, powers
    count as zero, and the sum stays at what the gap has added to the phase for good.
    """
    powers = np.exp(-np.arange(1.0, settled + MAX_PIECE + 1) / time_constant)
    powers[settled - 1 :] = 0.0
    return np.concatenate(([1.0], powers)), np.concatenate(([0.0], np.cumsum(powers)))


class Playback:
    """Renders commands in stream time; an oscillator's waveform is bit-equal in
    portions of any size.

    >>> playback = Playback(Oscillator())
    >>> wave = playback.push([HapticCommand(1.0, 60.0, time=0.005)], until=0.01)
    >>> len(wave), int(np.flatnonzero(wave)[0])
    (480, 240)
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self._waiting: deque[HapticCommand] = deque()
        self._done = 0

    def hear(self, block: AudioBlock) -> None:
        """Take the sound behind the commands that are pushed next; commands alone are
        rendered without it."""

    def skip(self, until: float) -> None:
        """Leave out the waveform up to a time in s; only before anything is pushed."""
        self._done = round(until * self.renderer.sample_rate)

    def push(self, commands: Iterable[HapticCommand], *, until: float) -> FloatArray:
        """Take commands, oldest first; returns the waveform up to a time in s, shape
        ``(samples,)``."""
        self._waiting.extend(commands)
        end = max(self._done, round(until * self.renderer.sample_rate))
        out = np.empty(end - self._done, np.float32)
        first = self._done
        while self._waiting:
            due = round(self._waiting[0].time * self.renderer.sample_rate)
            if due >= end:
                break
            place = max(due, self._done)
            self.renderer.render(out[self._done - first : place - first])
            self.renderer.submit(self._waiting.popleft())
            self._done = place
        self.renderer.render(out[self._done - first :])
        self._done = end
        return out
