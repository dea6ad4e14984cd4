"""Finds samples that no microphone can produce: NaN, infinities, and values far beyond full scale."""

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

PLAUSIBLE_PEAK = 8.0
"""Times full scale. Float files and mixers may exceed 1 a little; 18 dB over it is a broken driver or decoder."""

_NONE = np.empty(0, np.intp)


def find_invalid(samples: FloatArray) -> NDArray[np.intp]:
    """Return the indices at which any channel is invalid; ``samples`` has shape ``(samples, channels)``."""
    # Sound with less energy than a single such sample contains none, so that most blocks need no further check.
    if np.vdot(samples, samples) <= PLAUSIBLE_PEAK**2:
        return _NONE
    # Written so that a comparison with NaN, which is always false, counts as invalid.
    return np.flatnonzero(~(np.abs(samples) <= PLAUSIBLE_PEAK).all(axis=1))


class InvalidSampleFilter:
    """Replaces invalid samples with silence and keeps their positions.

    Examples
    --------
    >>> invalid = InvalidSampleFilter()
    >>> invalid.clean(np.array([[0.1], [np.nan], [0.2]], np.float32))[:, 0].tolist()
    [0.10000000149011612, 0.0, 0.20000000298023224]
    >>> invalid.any_between(0, 2), invalid.any_between(2, 3)
    (True, False)
    """

    def __init__(self) -> None:
        self._found = _NONE
        self._count = 0

    def clean(self, samples: FloatArray) -> FloatArray:
        """Return the next samples of the stream with invalid ones set to 0; the array itself if there are none."""
        here = find_invalid(samples)
        position, self._count = self._count, self._count + len(samples)
        if not len(here):
            return samples
        self._found = np.concatenate((self._found, position + here))
        samples = samples.copy()
        samples[here] = 0
        return samples

    def any_between(self, start: int, end: int) -> bool:
        """Whether any sample cleaned, from ``start`` to before ``end``, was invalid.

        Call it in ascending order of ``start``: positions before it are dropped.
        """
        if self._found is _NONE:
            return False
        self._found = self._found[np.searchsorted(self._found, start) :]
        return bool(len(self._found)) and bool(self._found[0] < end)
