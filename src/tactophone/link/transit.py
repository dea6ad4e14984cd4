"""How long packets are under way, seen without a common clock.

A packet's arrival less its timestamp is its transit plus an unknown constant. The *least* of it over a while is the
line at its emptiest: what lies above is queueing, and how the least itself creeps is the difference of the two clocks.
Loss and jitter do not move it, which is why playout and staleness are steered by it and not by the average.
"""

import math

WINDOW = 0.5
"""Seconds of a window; the newest two count. A longer way is believed after one to two of them, a shorter at once."""

_ENOUGH = 10
"""Packets that a window needs to count, so that a stall and the clump after it do not pass for a longer way."""


class Envelope:
    """The least transit of the newest two windows.

    Examples
    --------
    >>> envelope = Envelope()
    >>> for transit in (3.2, 3.0, 3.4):
    ...     envelope.push(transit, now=0.0)
    >>> envelope.least
    3.0
    """

    def __init__(self) -> None:
        self._begun = -math.inf
        self._count = 0
        self._current = self._previous = math.inf

    @property
    def least(self) -> float:
        """In seconds; infinite before the first packet."""
        return min(self._current, self._previous)

    def push(self, transit: float, *, now: float) -> None:
        """Take the transit of one packet."""
        if now - self._begun >= WINDOW and (self._count >= _ENOUGH or math.isinf(self._begun)):
            self._previous, self._current = self._current, math.inf
            self._begun, self._count = now, 0
        self._current = min(self._current, transit)
        self._count += 1
