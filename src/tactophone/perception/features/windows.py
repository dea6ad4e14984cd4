"""Cuts sound into windows.

Window ``k`` ends ``size + floor(k * hop)`` samples into the stream. The hop is a fraction because the paper classifies
at every sound buffer: 512 samples at 48 kHz are 21 1/3 samples at 2 kHz, so that its windows end 21 or 22 samples
apart. Every window is full of real sound: the first one ends ``size`` samples into the stream.
"""

from fractions import Fraction

import numpy as np

from tactophone.types import FloatArray


class Windower:
    """Keeps the newest sound and returns each window as soon as it is complete.

    ``size`` is in samples; ``hop`` too, and may be a fraction, but is at least 1.

    Examples
    --------
    >>> windower = Windower(4, Fraction(3, 2), channels=1)
    >>> sound = np.arange(8, dtype=np.float32)[:, None]
    >>> [(end, window[:, 0].tolist()) for end, window in windower.push(sound)]
    [(4, [0.0, 1.0, 2.0, 3.0]), (5, [1.0, 2.0, 3.0, 4.0]), (7, [3.0, 4.0, 5.0, 6.0]), (8, [4.0, 5.0, 6.0, 7.0])]
    """

    def __init__(self, size: int, hop: Fraction, *, channels: int) -> None:
        if size < 1 or hop < 1:
            raise ValueError(f"window of {size} samples at a hop of {hop}: both must be at least 1")
        self._size = size
        self._hop = hop
        self._channels = channels
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._kept: FloatArray = np.empty((0, self._channels), np.float32)
        self._first = 0  # index in the stream of the first sample kept
        self._count = 0

    def push(self, samples: FloatArray) -> list[tuple[int, FloatArray]]:
        """Take sound; return each completed window with the index of the sample after its last.

        A window has shape ``(size, channels)`` and is a view: use it before the next push.
        """
        if not len(samples):
            return []
        self._kept = np.concatenate((self._kept, samples))
        windows = []
        while (end := self.next_end) <= self._first + len(self._kept):
            start = end - self._size - self._first
            windows.append((end, self._kept[start : start + self._size]))
            self._count += 1
        unneeded = max(0, self.next_end - self._size - self._first)
        self._kept = self._kept[unneeded:]
        self._first += unneeded
        return windows

    @property
    def next_end(self) -> int:
        """Index in the stream of the sample after the last of the next window."""
        # In integers, as products of fractions take as long as a spectrum.
        return self._size + self._count * self._hop.numerator // self._hop.denominator
