"""Brings sound to the rate that a model wants, the same to the bit in one piece or in a thousand.

A rational resampler: between two rates in lowest terms ``up / down``, output sample ``n`` lies at input position
``n * down / up``, and is the sum of the input samples around it, weighted by a windowed sinc whose cut-off lies just
under the lower of the two Nyquist frequencies. There are ``up`` different sets of weights, one a fractional position.

The kernel is the paper's authors' own for 48 to 2 kHz (torchaudio's default: a Hann-windowed sinc of six zeros a
side, rolling off at 0.99 of the Nyquist frequency): 293 taps, half of which are the delay of 3.04 ms.

Library resamplers do not serve here: soxr's stream was measured to hold 150 to 600 ms back at this ratio.
"""

import math

import numpy as np

from tactophone.types import FloatArray

ZERO_CROSSINGS = 6
ROLL_OFF = 0.99
LOWEST_RATE = 2000


class Resampler:
    """Resamples a stream, block by block.

    Parameters
    ----------
    input_rate, output_rate
        In Hz.
    channels
        Of the sound to come.

    Attributes
    ----------
    reach
        Input samples on either side that have a part in an output sample.
    latency
        The same in seconds: how much later an output sample is known than its own moment.

    Examples
    --------
    >>> resampler = Resampler(48_000, 2000, channels=1)
    >>> len(resampler.push(np.zeros((48_000, 1), np.float32))) + len(resampler.flush())
    2000
    >>> round(resampler.latency * 1000, 2)
    3.04
    """

    def __init__(self, input_rate: int, output_rate: int, *, channels: int) -> None:
        common = math.gcd(input_rate, output_rate)
        self._up, self._down = output_rate // common, input_rate // common
        self._kernels = design_kernels(input_rate, output_rate)
        self.reach = self._kernels.shape[1] // 2
        self._channels = channels
        self.latency: float = self.reach / input_rate
        self.reset()

    def reset(self) -> None:
        """Become as new."""
        # Channels first and each contiguous, for speed. The stream is preceded by silence; `_kept` begins at input
        # sample `_first`.
        self._kept: FloatArray = np.zeros((self._channels, self.reach), np.float32)
        self._first = -self.reach
        self._given = 0

    def push(self, samples: FloatArray) -> FloatArray:
        """Take sound in, shape ``(samples, channels)``; give the output samples that it completes, alike."""
        self._kept = np.concatenate((self._kept, samples.T), axis=1)
        return self._samples_before(self._first + self._kept.shape[1] - self.reach)

    def flush(self) -> FloatArray:
        """Give the output samples that only silence after the end still completes."""
        end = self._first + self._kept.shape[1]
        self._kept = np.concatenate((self._kept, np.zeros((self._channels, self.reach), np.float32)), axis=1)
        return self._samples_before(end)

    def _samples_before(self, position: int) -> FloatArray:
        """The output samples not given yet that lie before an input position."""
        ready = -(-position * self._up // self._down)
        if ready <= self._given:
            return np.empty((0, self._channels), np.float32)
        windows, weights = self._around(self._given, ready)
        # A dot product a sample: its rounding depends on the number of taps alone. That of a matrix product, faster
        # still, changes with the number of rows.
        output: FloatArray = np.vecdot(windows, weights).T
        self._given = ready
        self._forget(ready * self._down // self._up - self.reach)
        return output

    def _around(self, start: int, end: int) -> tuple[FloatArray, FloatArray]:
        """The input around each output sample of a stretch, shape ``(channels, samples, taps)``, and its weights."""
        taps = self._kernels.shape[1]
        if self._up == 1:
            # What is kept begins with what the next sample needs, and whole hops further on lie those after it.
            return _windows(self._kept, taps, hop=self._down)[:, : end - start], self._kernels
        places = np.arange(start, end) * self._down
        starts = places // self._up - self.reach - self._first
        return _windows(self._kept, taps, hop=1)[:, starts], self._kernels[places % self._up]

    def _forget(self, before: int) -> None:
        unneeded = max(0, min(before - self._first, self._kept.shape[1]))
        self._kept = self._kept[:, unneeded:]
        self._first += unneeded


def design_kernels(input_rate: int, output_rate: int) -> FloatArray:
    """Make the weights of each fractional position, shape ``(up, taps)``; each set sums to 1.

    Source: windowed-sinc interpolation with a Hann window, J. O. Smith, "Digital Audio Resampling" (CCRMA, 2002).

    Examples
    --------
    >>> design_kernels(48_000, 2000).shape
    (1, 293)
    >>> design_kernels(44_100, 2000).shape
    (20, 269)
    >>> design_kernels(2000, 2000).tolist()
    [[1.0]]
    """
    if min(input_rate, output_rate) < LOWEST_RATE:
        raise ValueError(f"{input_rate} to {output_rate} Hz: both rates must be {LOWEST_RATE} Hz or more")
    if input_rate == output_rate:
        return np.ones((1, 1), np.float32)
    up = output_rate // math.gcd(input_rate, output_rate)
    cutoff = min(input_rate, output_rate) * ROLL_OFF / input_rate
    reach = math.ceil(ZERO_CROSSINGS / cutoff)
    offsets = np.arange(-reach, reach + 1) - np.arange(up)[:, None] / up
    place = np.clip(offsets * cutoff, -ZERO_CROSSINGS, ZERO_CROSSINGS)
    kernels = np.sinc(place) * np.cos(place * np.pi / ZERO_CROSSINGS / 2) ** 2
    return np.asarray(kernels / kernels.sum(axis=1, keepdims=True), np.float32)


def _windows(kept: FloatArray, taps: int, *, hop: int) -> FloatArray:
    """View stretches of ``taps`` samples, shape ``(channels, starts, taps)``; NumPy's own takes longer."""
    channels, size = kept.shape
    shape = (channels, max(0, size - taps + hop) // hop, taps)
    return np.ndarray(shape, np.float32, kept, strides=(kept.strides[0], 4 * hop, 4))
