"""Mains hum in a recording: steady lines at the harmonics of 50 and 60 Hz, found in a
first reading, then subtracted.

Hum that a microphone's cable picks up is louder than a faint stroke, hides its low
bands and flattens its crest (docs/research/contact.md). Its lines are narrower than 1
Hz and last as long as the recording; a stroke's sound is broad and comes and goes. So
each line is measured over 1 s, twice a second, and what is subtracted takes about 2 Hz
of the sound with it.

A second that is full of a stroke says little about the line beneath it, and hum hardly
changes. So each frame counts by how little other sound it has beside the line, and
borrows the rest from its neighbours in time. Otherwise a part of the stroke would be
taken for hum and, as a frame reaches over the stroke's ends, be added to the silence
beside it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import FloatArray

HIGHEST = 1000
"""Hz; over that, hum is weak and a line wanders by more than the width that is looked
at."""

LINES = np.array(sorted({*range(50, HIGHEST + 1, 50), *range(60, HIGHEST + 1, 60)}))
"""Hz, of either mains frequency."""

APART = np.array([*range(-12, -3), *range(4, 13)])
"""Hz from a line to the neighbours that it is compared with: beyond the window's main
lobe."""

OVER_DB = 10.0
"""How far a line must stand over the median of its neighbours, in dB; one bin of noise
in 500 does."""

LEAST_SHARE = 0.8
"""Share of the frames in which a line of hum has to stand out: a stroke's tone does not
last."""

LEAST_FRAMES = 4
"""Fewest frames from which hum is told, 2.5 s."""

CHANGE = 0.01
"""Share of its mean amplitude by which a line is expected to change from one frame to
the next, 0.5 s, under a stroke. In a pause a faster change is followed too, as nothing
hides it there."""

QUIETEST = 1e-20
"""Power beside a line, -200 dBFS, that is taken for no noise at all."""

TURNS = 4
"""Rounds in which the frequency is found: a line that is off by 0.3 Hz turns by a
radian from frame to frame, and its amplitudes can be averaged only after that."""

Amplitudes = NDArray[np.complex64]
Powers = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Hum:
    """The lines of a recording."""

    sample_rate: int
    """In Hz."""
    frequency: NDArray[np.float64]
    """True frequency of each line in each channel, in Hz, ``(lines, channels)``."""
    amplitude: Amplitudes
    """At the middle of each frame, 0.5 s, 1 s, and so on; relative to a cosine of that
    frequency that starts at 0: shape ``(lines, channels, frames)``. 0 if the channel
    lacks that line."""

    @property
    def level_dbfs(self) -> float:
        """Level of all lines together, in dBFS, in the channel with the most hum."""
        power = np.square(np.abs(self.amplitude)).mean(axis=-1).sum(axis=0).max() / 2
        return float(10 * np.log10(power))

    @property
    def mains(self) -> int:
        """Mains frequency, 50 or 60 Hz, whichever explains more of the harmonics."""
        power = np.square(np.abs(self.amplitude)).mean(axis=-1).max(axis=-1)
        nearest = np.rint(self.frequency.max(axis=-1))
        return max(
            (50, 60),
            key=lambda mains: float(
                power[np.abs(nearest / mains % 1 - 0.5) > 0.45].sum()
            ),
        )

    def waveform(self, first: int, size: int) -> FloatArray:
        """Return the hum's samples from number ``first`` on, shape ``(size,
        channels)``."""
        time = (first + np.arange(size)) / self.sample_rate
        middles = 0.5 * np.arange(1, self.amplitude.shape[-1] + 1)
        hum = np.zeros((size, self.amplitude.shape[1]), np.float32)
        for line, channel in np.argwhere(self.frequency):
            phase = 2 * np.pi * self.frequency[line, channel] * time
            amplitude = np.interp(time, middles, self.amplitude[line, channel])
            hum[:, channel] += (amplitude * np.exp(1j * phase)).real
        return hum


class HumMeter:
    """Measures the lines of a recording that is read once; its memory is 1 s of sound
    and 1 kB a second."""

    def __init__(self, sample_rate: int, channels: int) -> None:
        self._rate = sample_rate
        self._hop = sample_rate // 2
        self._pending = np.zeros((0, channels), np.float32)
        self._window = np.hanning(sample_rate + 1)[:-1, None].astype(np.float32)
        self._lines = LINES[LINES + APART[-1] < self._hop]
        self._frames: list[Amplitudes] = []
        self._around: list[Powers] = []
        self._over: list[NDArray[np.bool_]] = []

    def push(self, samples: FloatArray) -> None:
        """Add the next samples, shape ``(samples, channels)``."""
        self._pending = np.concatenate((self._pending, samples))
        while len(self._pending) >= self._rate:
            self._measure(self._pending[: self._rate])
            self._pending = self._pending[self._hop :]

    def hum(self) -> Hum | None:
        """Return the lines in the sound so far, or ``None``."""
        if len(self._frames) < LEAST_FRAMES:
            return None
        found = np.mean(self._over, axis=0) >= LEAST_SHARE
        lines = found.any(axis=1)
        if not lines.any():
            return None
        # (frames, lines, channels) to (lines, channels, frames), without what is no
        # line of its channel.
        amplitude = np.moveaxis(np.array(self._frames)[:, lines] * found[lines], 0, -1)
        noise = np.moveaxis(np.array(self._around)[:, lines], 0, -1)
        nominal = self._lines[lines, None] * found[lines]
        return _tracked(self._rate, nominal, amplitude, noise)

    def _measure(self, frame: FloatArray) -> None:
        # A bin is 1 Hz wide, as a frame lasts 1 s; a cosine of amplitude 1 gives 1 at
        # its bin.
        spectrum = np.fft.rfft(frame * self._window, axis=0) * np.float32(
            4 / self._rate
        )
        power = np.square(np.abs(spectrum))
        around = np.median(power[self._lines[:, None] + APART], axis=1)
        self._around.append(around.astype(np.float32))
        self._frames.append(spectrum[self._lines].astype(np.complex64))
        self._over.append(power[self._lines] > around * 10 ** (OVER_DB / 10))


def _tracked(
    rate: int, nominal: NDArray[np.int64], amplitude: Amplitudes, noise: Powers
) -> Hum:
    """Return the hum at its true frequencies, at which the amplitude stands still on
    average; ``noise`` is the power beside each line.

    The mains frequency and the recorder's clock are a little off, which shifts the
    harmonics by up to some tenths of a hertz.
    """
    hop = (rate // 2) / rate
    frames = np.arange(amplitude.shape[-1])
    # From each frame's start back to the recording's, at the nominal frequency.
    still = amplitude * np.exp(-2j * np.pi * nominal[..., None] * hop * frames)
    turn = np.zeros(nominal.shape)
    steady = _steadied(still, noise)
    for _ in range(TURNS):
        pairs = steady[..., 1:] * steady[..., :-1].conj()
        turn = turn + np.angle(pairs.sum(axis=-1))
        turned = np.exp(-1j * turn[..., None] * frames)
        steady = _steadied(still * turned, noise)
    off = turn / (2 * np.pi * hop)
    # The window weighs a line that is off by d Hz with sinc(d) / (1 - d^2), and turns
    # it by half a frame.
    loss = np.sinc(off) / np.where(np.abs(off) > 0.999, np.inf, 1 - off * off)
    middle = np.exp(-1j * np.pi * off) / np.maximum(loss, 0.5)
    return Hum(
        rate,
        np.where(nominal, nominal + off, 0.0),
        (steady * middle[..., None]).astype(np.complex64),
    )


def _steadied(amplitude: NDArray[np.complex128], noise: Powers) -> Amplitudes:
    """Return the likeliest amplitudes, where a measured one is off by the noise beside
    its line and a line changes by `CHANGE` from frame to frame.

    This is Rauch, Tung and Striebel's smoother of a random walk (AIAA J. 3, 1445,
    1965): one pass forwards, in which each frame corrects what came before, and one
    back.
    """
    off = noise.astype(np.float64) + QUIETEST
    power = np.average(np.square(np.abs(amplitude)), axis=-1, weights=1 / off)
    change = CHANGE**2 * power
    best = [amplitude[..., 0]]
    variance = [off[..., 0]]
    for frame in range(1, amplitude.shape[-1]):
        expected = variance[-1] + change
        gain = expected / (expected + off[..., frame])
        best.append(best[-1] + gain * (amplitude[..., frame] - best[-1]))
        variance.append(gain * off[..., frame])
    for frame in reversed(range(len(best) - 1)):
        share = variance[frame] / (variance[frame] + change)
        best[frame] = best[frame] + share * (best[frame + 1] - best[frame])
    return np.stack(best, axis=-1)
