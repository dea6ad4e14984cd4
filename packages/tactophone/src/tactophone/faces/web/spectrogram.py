"""The contact sound as the texture detector hears it: the level of each of its bands,
again and again, for a picture."""

import functools

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.core.texture_bands import POWER_FLOOR, design_bands
from tactophone.core.types import FloatArray

WINDOW = 0.032
"""Seconds of a window, as the detector's."""

HOP = 0.02
"""Seconds from one column of the picture to the next: twice the detector's hop, and
about a pixel of the 5 s shown."""


class Spectrogram:
    """Measures columns of a picture; the same at any block size.

    ``sample_rate`` is the sound's, in Hz.

    >>> Spectrogram(48_000).push(np.zeros(4800, np.float32)).shape
    (4, 16)
    """

    def __init__(self, sample_rate: int) -> None:
        self.sample_rate = sample_rate
        self._size = round(WINDOW * sample_rate)
        self.hop = round(HOP * sample_rate)
        self.reset()

    def reset(self) -> None:
        """Forget the sound that came: what comes next does not follow it."""
        self._rest = np.zeros(0, np.float32)

    @property
    def waiting(self) -> int:
        """Samples since the end of the newest column."""
        overlap = self._size - self.hop
        return len(self._rest) - overlap

    def push(self, sound: FloatArray) -> NDArray[np.float64]:
        """Take samples of one microphone; return the level in dB of each band (shape
        ``(columns, BAND_COUNT)``) of each window that they complete."""
        sound = np.concatenate([self._rest, sound])
        count = max(0, (len(sound) - self._size) // self.hop + 1)
        self._rest = sound[count * self.hop :]
        if not count:
            return np.zeros((0, _bank(self._size, self.sample_rate).shape[1]))
        windows = sliding_window_view(sound, self._size)[:: self.hop][:count]
        spectra = np.fft.rfft(windows * _taper(self._size))
        power = np.square(spectra.real) + np.square(spectra.imag)
        return np.asarray(
            10 * np.log10(power @ _bank(self._size, self.sample_rate) + POWER_FLOOR)
        )


@functools.cache
def _taper(size: int) -> NDArray[np.float64]:
    return np.asarray(np.hanning(size + 1)[:-1])


@functools.cache
def _bank(size: int, sample_rate: int) -> NDArray[np.float64]:
    """Return the bands, scaled as in the model: white noise shows its power per bin."""
    scale = np.square(_taper(size)).sum() * size / 2
    return np.asarray(design_bands(size, sample_rate) / scale)
