"""Finds what no microphone can have said: NaN, infinities, and numbers far beyond full scale."""

import numpy as np
from numpy.typing import NDArray

from tactophone.types import AudioBlock, FloatArray

PLAUSIBLE_PEAK = 8.0
"""Times full scale. Float files and mixers may pass 1 a little; 18 dB over it is a broken driver or decoder."""

_NOTHING = np.empty(0, np.intp)


def find_garbage(samples: FloatArray) -> NDArray[np.intp]:
    """Give the indices of the samples at which any channel is garbage."""
    # What has not even the energy of one such sample holds none: most sound is known to be clean by this alone.
    if np.vdot(samples, samples) <= PLAUSIBLE_PEAK**2:
        return _NOTHING
    # Written so that a comparison with NaN, which is always false, counts as garbage.
    return np.flatnonzero(~(np.abs(samples) <= PLAUSIBLE_PEAK).all(axis=1))


class GarbageFilter:
    """Replaces garbage with silence and remembers where it was.

    Examples
    --------
    >>> garbage = GarbageFilter()
    >>> block = AudioBlock(np.array([[0.1], [np.nan], [0.2]], np.float32), sample_rate=48_000)
    >>> garbage.clean(block).samples[:, 0].tolist()
    [0.10000000149011612, 0.0, 0.20000000298023224]
    >>> garbage.any_between(0, 2), garbage.any_between(2, 3)
    (True, False)
    """

    def __init__(self) -> None:
        self._found = _NOTHING
        self._count = 0

    def clean(self, block: AudioBlock) -> AudioBlock:
        """Give the block with silence for garbage; where it is clean, that is the block itself."""
        here = find_garbage(block.samples)
        position, self._count = self._count, self._count + block.size
        if not len(here):
            return block
        self._found = np.concatenate((self._found, position + here))
        samples = block.samples.copy()
        samples[here] = 0
        return AudioBlock(samples, block.sample_rate, block.start, block.concealed)

    def any_between(self, start: int, end: int) -> bool:
        """Whether garbage came from sample ``start`` to before ``end`` of what was cleaned.

        Ask in ascending order of ``start``: what lies before it is forgotten.
        """
        if self._found is _NOTHING:
            return False
        self._found = self._found[np.searchsorted(self._found, start) :]
        return bool(len(self._found)) and bool(self._found[0] < end)
