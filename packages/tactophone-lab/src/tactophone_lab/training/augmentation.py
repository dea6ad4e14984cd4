"""Copies of a take as other microphones, cables, hands and rooms would have recorded
it.

A training set holds a few microphones and rooms, and a shipped model meets all of them.
What they do to rough sound, take its treble or fill the quiet between its clicks, makes
it smooth to a model that learnt from clean sound alone (docs/research/detector.md). So
the waveform is varied, before features: each copy has a speed, a gain and an equaliser
of its own, and half of them a low-pass, half noise, half a room.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.core.microphones import AIR
from tactophone.core.types import FloatArray

_FASTEST_ROOM = 0.05
"""Seconds in which the sound of the driest room falls by 60 dB."""

_SLOWEST_ROOM = 0.3
"""Seconds in which the sound of the most reverberant room falls by 60 dB."""

_LOW_PASS_ORDER = 4
"""Order of the Butterworth low-pass: 24 dB an octave."""


@dataclass(frozen=True, slots=True)
class Augmentation:
    """How takes are varied; the values are the first that were tried."""

    copies: int = 5
    """Of each take, beside the take itself."""
    speed: tuple[float, float] = (0.6, 1.6)
    low_pass_hz: tuple[float, float] = (2500.0, 6500.0)
    snr_db: tuple[float, float] = (3.0, 20.0)
    """`speed` to `snr_db`: bounds; the first two are drawn evenly in the logarithm."""
    gain_db: float = 6.0
    """Standard deviation of the gain; microphones and mounts differ by as much."""
    equaliser_db: float = 3.5
    """The same of the equaliser, at each of its knots."""
    knots: int = 5
    """Of the equaliser, evenly spaced over the logarithm of frequencies from 100 Hz;
    linear in dB between them."""
    share: float = 0.5
    """Of the copies that get a low-pass, of those that get noise, and of those that get
    a room."""

    def draw_speed(self, rng: np.random.Generator) -> float:
        return float(np.exp(rng.uniform(*np.log(self.speed))))

    def vary(
        self, sound: FloatArray, rate: int, rng: np.random.Generator
    ) -> FloatArray:
        """Return sound ``(samples, channels)`` as another channel would have delivered
        it."""
        size = 1 << max(9, (len(sound) + round(_SLOWEST_ROOM * rate)).bit_length())
        frequency = np.asarray(np.fft.rfftfreq(size, 1 / rate), np.float64)
        low_pass, noise, room = rng.random(3) < self.share
        found = np.empty_like(sound)
        cutoff = np.exp(rng.uniform(*np.log(self.low_pass_hz)))
        snr_db = rng.uniform(*self.snr_db)
        for channel in range(sound.shape[1]):
            response = 10 ** (self._equaliser(frequency, rng) / 20) + 0j
            if low_pass:
                response *= _butterworth(frequency / cutoff)
            # A contact microphone hears no room.
            if room and channel == min(AIR, sound.shape[1] - 1):
                response *= np.fft.rfft(_room(rate, rng), size)
            varied = np.fft.irfft(
                np.fft.rfft(sound[:, channel], size) * response, size
            )[: len(sound)]
            if noise:
                # White to pink.
                colour = np.maximum(frequency, 20.0) ** -rng.uniform(0, 0.5)
                added = np.fft.irfft(
                    np.fft.rfft(rng.standard_normal(len(sound)), size) * colour, size
                )[: len(sound)]
                varied += added * _rms(varied) / _rms(added) * 10 ** (-snr_db / 20)
            found[:, channel] = varied
        return found

    def _equaliser(
        self, frequency: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float64]:
        places = np.linspace(np.log(100.0), np.log(frequency[-1]), self.knots)
        heights = rng.normal(0, self.equaliser_db, self.knots) + rng.normal(
            0, self.gain_db
        )
        return np.asarray(
            np.interp(np.log(np.maximum(frequency, 1.0)), places, heights)
        )


def _butterworth(frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the response of a low-pass at multiples of its cutoff: as a filter's, so
    that nothing rings before."""
    order = _LOW_PASS_ORDER
    poles = np.exp(1j * np.pi * (2 * np.arange(order) + order + 1) / (2 * order))
    return np.asarray(1 / np.prod(1j * frequency[:, None] - poles, axis=1))


def _room(rate: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return an impulse response: the sound itself, and noise that decays, 0 to 12 dB
    under it."""
    decay = np.exp(rng.uniform(*np.log((_FASTEST_ROOM, _SLOWEST_ROOM))))
    time = np.arange(round(decay * rate)) / rate
    tail = rng.standard_normal(len(time)) * np.exp(-np.log(1000) * time / decay)
    tail *= 10 ** (-rng.uniform(0, 12) / 20) / np.sqrt(np.square(tail).sum())
    tail[0] = 1
    return np.asarray(tail)


def _rms(sound: NDArray[np.floating[Any]]) -> float:
    return float(np.sqrt(np.square(sound, dtype=np.float64).mean())) + 1e-12
