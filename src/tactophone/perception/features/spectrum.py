"""What the paper's network sees of a window: the magnitudes of its spectrum, channel after channel.

Not normalised, on purpose (paper, section III): how loud the air microphone is against the contact microphone tells
rough from smooth.
"""

import numpy as np

from tactophone.types import FloatArray


def magnitudes(window: FloatArray) -> FloatArray:
    """Give the magnitude of each channel's real FFT, concatenated.

    Parameters
    ----------
    window
        Shape ``(..., samples, channels)``; leading axes are a batch.

    Returns
    -------
    Shape ``(..., (samples // 2 + 1) * channels)``, float32: all of channel 0, then all of channel 1.

    Examples
    --------
    >>> magnitudes(np.ones((512, 2), np.float32)).shape
    (514,)
    >>> float(magnitudes(np.ones((512, 2), np.float32))[257])
    512.0
    """
    # The one transpose of the house: sound is (samples, channels), a spectrum is (channels, bins).
    sound = window.swapaxes(-1, -2)
    *batch, channels, size = sound.shape
    # Given where to write, NumPy's FFT need not find out of what kind that should be, which takes it a third longer.
    spectra = np.empty((*batch, channels, size // 2 + 1), np.complex64)
    flat: FloatArray = np.abs(np.fft.rfft(sound, out=spectra)).reshape(*batch, -1)
    return flat
