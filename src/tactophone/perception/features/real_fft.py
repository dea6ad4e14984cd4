"""The real FFT of windows: NumPy's own, called without `numpy.fft.rfft` around it.

For two channels of 512 samples that function takes longer to look up types, axes and norms than the transform takes,
and with cold caches three times as long (`benchmarks/live_compute.py`). What it calls in the end is not public, so
where a version of NumPy lacks it, the function itself is called: the result is the same, bit for bit.
"""

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

try:
    from numpy.fft._pocketfft_umath import rfft_n_even as _transform  # type: ignore[import-not-found,unused-ignore]
except ImportError:
    _transform = None


def real_fft(sound: FloatArray) -> NDArray[np.complex64]:
    """Return the real FFT of sound, shape ``(..., samples)``; ``(..., samples // 2 + 1)``.

    >>> real_fft(np.ones((2, 512), np.float32))[:, 0].tolist()
    [(512+0j), (512+0j)]
    """
    size = sound.shape[-1]
    bins = np.empty((*sound.shape[:-1], size // 2 + 1), np.complex64)
    if _transform is not None and size % 2 == 0:
        # The second argument is a factor.
        _transform(sound, 1, out=bins)
    else:
        np.fft.rfft(sound, out=bins)
    return bins
