"""Mains hum in a recording: steady lines at the harmonics of 50 and 60 Hz, found in a
first reading, then subtracted.

Hum that a microphone's cable picks up is louder than a faint stroke, hides its low
bands and flattens its crest (docs/research/contact.md). Its lines are narrower than 1
Hz and last as long as the recording; a stroke's sound is broad and comes and goes. So
each line is measured over 1 s, twice a second, and what is subtracted takes about 2 Hz
of the sound with it.
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

Amplitudes = NDArray[np.complex64]


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
        return _tracked(self._rate, self._lines[lines, None] * found[lines], amplitude)

    def _measure(self, frame: FloatArray) -> None:
        # A bin is 1 Hz wide, as a frame lasts 1 s; a cosine of amplitude 1 gives 1 at
        # its bin.
        spectrum = np.fft.rfft(frame * self._window, axis=0) * np.float32(
            4 / self._rate
        )
        power = np.square(np.abs(spectrum))
        around = np.median(power[self._lines[:, None] + APART], axis=1)
        self._frames.append(spectrum[self._lines].astype(np.complex64))
        self._over.append(power[self._lines] > around * 10 ** (OVER_DB / 10))


def _tracked(rate: int, nominal: NDArray[np.int64], amplitude: Amplitudes) -> Hum:
    """Return the hum at its true frequencies, at which the amplitude stands still on
    average.

    The mains frequency and the recorder's clock are a little off, which shifts the
    harmonics by up to some tenths of a hertz.
    """
    hop = (rate // 2) / rate
    frames = np.arange(amplitude.shape[-1])
    # From each frame's start back to the recording's, at the nominal frequency.
    still = amplitude * np.exp(-2j * np.pi * nominal[..., None] * hop * frames)
    turn = np.angle((still[..., 1:] * still[..., :-1].conj()).sum(axis=-1))
    off = turn / (2 * np.pi * hop)
    # The window weighs a line that is off by d Hz with sinc(d) / (1 - d^2), and turns
    # it by half a frame.
    loss = np.sinc(off) / np.where(np.abs(off) > 0.999, np.inf, 1 - off * off)
    middle = (
        np.exp(-1j * (turn[..., None] * frames + np.pi * off[..., None]))
        / np.maximum(loss, 0.5)[..., None]
    )
    return Hum(
        rate,
        np.where(nominal, nominal + off, 0.0),
        (still * middle).astype(np.complex64),
    )
