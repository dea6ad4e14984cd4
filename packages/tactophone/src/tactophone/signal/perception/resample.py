"""Resamples sound to the rate of a model and cuts it into windows, bit-equal at any
block size.

A rational resampler: between two rates in lowest terms ``up / down``, output sample
``n`` lies at input position ``n * down / up``, and is the sum of the input samples
around it, weighted by a windowed sinc whose cut-off is just under the lower of the two
Nyquist frequencies. There are ``up`` sets of weights, one for each fractional position.

For 48 to 2 kHz the kernel is that of the paper's authors (torchaudio's default: a
Hann-windowed sinc of six zeros a side, rolling off at 0.99 of the Nyquist frequency):
293 taps, half of which are the delay of 3.04 ms.

Library resamplers do not serve here: soxr's stream delays sound by 150 to 600 ms at
this ratio (measured).

Window ``k`` ends ``size + floor(k * hop)`` samples into the stream. The hop is a
fraction because the paper classifies at every sound buffer: 512 samples at 48 kHz are
21 1/3 samples at 2 kHz, so that its windows end 21 or 22 samples apart. Every window is
full of real sound: the first one ends ``size`` samples into the stream.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from tactophone.core.types import FloatArray

ZERO_CROSSINGS = 6
ROLL_OFF = 0.99
RESAMPLER_LOWEST_RATE = 2000


class Resampler:
    """Resamples a stream from ``input_rate`` to ``output_rate`` Hz, block by block.

    - ``reach``: input samples on either side that contribute to an output sample.
    - ``latency``: the same in seconds: the delay from an output sample's own time to
      its availability.

    >>> resampler = Resampler(48_000, 2000, channels=1)
    >>> len(resampler.push(np.zeros((48_000, 1), np.float32))) + len(resampler.flush())
    2000
    >>> round(resampler.latency * 1000, 2)
    3.04
    """

    def __init__(self, input_rate: int, output_rate: int, *, channels: int) -> None:
        common = math.gcd(input_rate, output_rate)
        self._up = output_rate // common
        self._down = input_rate // common
        self._kernels = design_kernels(input_rate, output_rate)
        self.reach = self._kernels.shape[1] // 2
        self._channels = channels
        self.latency: float = self.reach / input_rate
        self.reset()

    def reset(self) -> None:
        # Channels first and each contiguous, for speed. The stream is preceded by
        # silence; `_kept` begins at input sample `_first`.
        self._kept: FloatArray = np.zeros((self._channels, self.reach), np.float32)
        self._first = -self.reach
        self._returned = 0

    def push(self, samples: FloatArray) -> FloatArray:
        """Take sound, shape ``(samples, channels)``; return the output samples that it
        completes, alike."""
        self._kept = np.concatenate((self._kept, samples.T), axis=1)
        return self._samples_before(self._first + self._kept.shape[1] - self.reach)

    def missing_until(self, end: int) -> int:
        """Return how many more input samples must be pushed for the output samples
        before ``end`` to be returned.

        >>> resampler = Resampler(48_000, 16_000, channels=1)
        >>> silence = np.zeros((resampler.missing_until(160), 1), np.float32)
        >>> len(resampler.push(silence[1:])), len(resampler.push(silence[:1]))
        (159, 1)
        """
        missing: int = (
            (end - 1) * self._down // self._up
            + 1
            + self.reach
            - self._first
            - self._kept.shape[1]
        )
        return missing

    def flush(self) -> FloatArray:
        """Return the output samples that only silence after the end completes."""
        end = self._first + self._kept.shape[1]
        self._kept = np.concatenate(
            (self._kept, np.zeros((self._channels, self.reach), np.float32)), axis=1
        )
        return self._samples_before(end)

    def _samples_before(self, position: int) -> FloatArray:
        """Return the output samples before an input position that were not returned
        yet."""
        ready = -(-position * self._up // self._down)
        if ready <= self._returned:
            return np.empty((0, self._channels), np.float32)
        # The input around each output sample, of shape (channels, samples, taps), and
        # its weights.
        taps = self._kernels.shape[1]
        if self._up == 1:
            # The kept sound begins with what the next output sample needs; those after
            # it are whole hops further on.
            windows = _windows(self._kept, taps, hop=self._down)[
                :, : ready - self._returned
            ]
            weights = self._kernels
        else:
            places = np.arange(self._returned, ready) * self._down
            starts = places // self._up - self.reach - self._first
            windows = _windows(self._kept, taps, hop=1)[:, starts]
            weights = self._kernels[places % self._up]
        # A dot product for each sample: its rounding depends on the number of taps
        # alone. A matrix product is faster, but its rounding changes with the number of
        # rows.
        output: FloatArray = np.vecdot(windows, weights).T
        self._returned = ready
        unneeded = max(
            0,
            min(
                ready * self._down // self._up - self.reach - self._first,
                self._kept.shape[1],
            ),
        )
        self._kept = self._kept[:, unneeded:]
        self._first += unneeded
        return output


def design_kernels(input_rate: int, output_rate: int) -> FloatArray:
    """Return the weights of each fractional position, shape ``(up, taps)``; each set
    sums to 1.

    Source: windowed-sinc interpolation with a Hann window, J. O. Smith, "Digital Audio
    Resampling" (CCRMA, 2002).

    >>> design_kernels(48_000, 2000).shape
    (1, 293)
    >>> design_kernels(44_100, 2000).shape
    (20, 269)
    >>> design_kernels(2000, 2000).tolist()
    [[1.0]]
    """
    if min(input_rate, output_rate) < RESAMPLER_LOWEST_RATE:
        raise ValueError(
            f"{input_rate} to {output_rate} Hz: both rates must be "
            f"{RESAMPLER_LOWEST_RATE} Hz or more"
        )
    if input_rate == output_rate:
        return np.ones((1, 1), np.float32)
    up = output_rate // math.gcd(input_rate, output_rate)
    # The ideal low-pass is a sinc over all time; a Hann window, cos^2, ends it after
    # six zeros a side. In input samples its zeros lie 1 / cutoff apart, so that the
    # kernel reaches 6 / cutoff to either side.
    cutoff = min(input_rate, output_rate) * ROLL_OFF / input_rate
    reach = math.ceil(ZERO_CROSSINGS / cutoff)
    offsets = np.arange(-reach, reach + 1) - np.arange(up)[:, None] / up
    place = np.clip(offsets * cutoff, -ZERO_CROSSINGS, ZERO_CROSSINGS)
    kernels = np.sinc(place) * np.cos(place * np.pi / ZERO_CROSSINGS / 2) ** 2
    return np.asarray(kernels / kernels.sum(axis=1, keepdims=True), np.float32)


def _windows(kept: FloatArray, taps: int, *, hop: int) -> FloatArray:
    """Return a view of stretches, shape ``(channels, starts, taps)``; NumPy's
    `sliding_window_view` takes longer."""
    channels, size = kept.shape
    shape = (channels, max(0, size - taps + hop) // hop, taps)
    return np.ndarray(shape, np.float32, kept, strides=(kept.strides[0], 4 * hop, 4))


class Window(NamedTuple):
    """A window of a stream."""

    end: int
    """The sample of the stream after its last one."""
    samples: FloatArray
    """Its sound, ``(samples, channels)``."""


class Windower:
    """Keeps the newest sound and returns each window as soon as it is complete.

    ``size`` is in samples; ``hop`` too, and may be a fraction, but is at least 1.

    >>> windower = Windower(4, Fraction(3, 2), channels=1)
    >>> sound = np.arange(8, dtype=np.float32)[:, None]
    >>> [(end, window[:, 0].tolist()) for end, window in windower.push(sound)][:2]
    [(4, [0.0, 1.0, 2.0, 3.0]), (5, [1.0, 2.0, 3.0, 4.0])]
    """

    def __init__(self, size: int, hop: Fraction, *, channels: int) -> None:
        if size < 1 or hop < 1:
            raise ValueError(
                f"window of {size} samples at a hop of {hop}: both must be at least 1"
            )
        self._size = size
        self._hop = hop.as_integer_ratio()
        self._channels = channels
        self.reset()

    def reset(self) -> None:
        self._kept: FloatArray = np.empty((0, self._channels), np.float32)
        self._first = 0  # index in the stream of the first sample kept
        self._count = 0

    def push(self, samples: FloatArray) -> list[Window]:
        """Take sound; return each window that it completes, oldest first.

        Their sound is a view: use it before the next push.
        """
        if not len(samples):
            return []
        self._kept = np.concatenate((self._kept, samples))
        windows = []
        while (end := self.next_end) <= self._first + len(self._kept):
            start = end - self._size - self._first
            windows.append(Window(end, self._kept[start : start + self._size]))
            self._count += 1
        unneeded = max(0, self.next_end - self._size - self._first)
        self._kept = self._kept[unneeded:]
        self._first += unneeded
        return windows

    @property
    def next_end(self) -> int:
        """Index in the stream of the sample after the last of the next window."""
        # In integers, as products of fractions take as long as a spectrum.
        numerator, denominator = self._hop
        return self._size + self._count * numerator // denominator
