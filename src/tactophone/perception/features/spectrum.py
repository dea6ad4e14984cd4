"""The features of the paper's network: the magnitudes of a window's spectrum, channel after channel.

They are not normalised (paper, section III): the level of the air microphone relative to the contact microphone
separates rough from smooth.
"""

import numpy as np

from tactophone.perception.features.real_fft import real_fft
from tactophone.types import FloatArray


def magnitudes(window: FloatArray) -> FloatArray:
    """Return the magnitude of each channel's real FFT, concatenated; of windows ``(..., samples, channels)``.

    Shape ``(..., (samples // 2 + 1) * channels)``, float32: all of channel 0, then all of channel 1.

    Examples
    --------
    >>> magnitudes(np.ones((512, 2), np.float32)).shape
    (514,)
    >>> float(magnitudes(np.ones((512, 2), np.float32))[257])
    512.0
    """
    # Sound is (samples, channels), a spectrum is (channels, bins).
    sound = window.swapaxes(-1, -2)
    flat: FloatArray = np.abs(real_fft(sound)).reshape(*sound.shape[:-2], -1)
    return flat
