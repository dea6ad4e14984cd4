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
    spectra = np.abs(np.fft.rfft(np.swapaxes(window, -1, -2), axis=-1))
    flat: FloatArray = spectra.reshape(*spectra.shape[:-2], -1).astype(np.float32, copy=False)
    return flat
