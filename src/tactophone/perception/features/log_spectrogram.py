"""The log spectrogram that a convolutional network classifies, as for tyre noise on road surfaces.

A quarter of a second of the contact and air microphones as log band powers over time.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tactophone.perception.features.bands import FLOOR, design_bands
from tactophone.types import FloatArray

SPAN, STRIDE = 512, 160
"""Samples of each column, and from one to the next: 32 and 10 ms at 16 kHz."""


class LogSpectrogram:
    """Computes the spectrogram of a window, flattened; features of kind ``scalogram``."""

    def __init__(self, sample_rate: int) -> None:
        self._taper = np.hanning(SPAN + 1)[:-1].astype(np.float32)
        power = np.square(self._taper).sum() * SPAN / 2
        self._banks = (design_bands(SPAN, sample_rate) / power).astype(np.float32)

    def of(self, window: FloatArray) -> FloatArray:
        """Return log10 of the band powers of a window, in the order channel, band, time."""
        pieces = sliding_window_view(window, SPAN, axis=0)[::STRIDE]
        spectra = np.fft.rfft(pieces * self._taper)
        powers = (np.square(spectra.real) + np.square(spectra.imag)) @ self._banks
        spectrogram: FloatArray = np.log10(powers + FLOOR, dtype=np.float32)
        # From (time, channel, band).
        return spectrogram.transpose(1, 2, 0).reshape(-1)
