"""How long packets are under way, seen without a common clock.

A packet's arrival less its timestamp is its transit plus an unknown constant. The *least* of it over a while is the
line at its emptiest: what lies above is queueing, and how the least itself creeps is the difference of the two clocks.
Loss and jitter do not move it, which is why playout and staleness are steered by it and not by the average.
"""

import math
from collections import deque
from statistics import linear_regression

WINDOW = 0.5
"""Seconds of a window; the newest two count. A longer way is believed after one to two of them, a shorter at once."""

_ENOUGH = 10
"""Packets that a window needs to count, so that a stall and the clump after it do not pass for a longer way."""


_POINTS = 30
_SHORTEST = 10.0
"""Points, one a second, by which the clocks are compared, and seconds that they must span at least."""


class MinDelayFilter:
    """The least transit of the newest two windows.

    Examples
    --------
    >>> envelope = MinDelayFilter()
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


class Skew:
    """How much faster the other side's clock runs than ours, by the slope of the least transit over half a minute.

    Examples
    --------
    >>> skew = Skew()
    >>> for second in range(20):
    ...     skew.push(3.0 - 100e-6 * second, now=float(second))
    >>> round(skew.ppm)
    100
    """

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque(maxlen=_POINTS)

    @property
    def ppm(self) -> float:
        """Millionths; NaN until ten seconds have passed."""
        if len(self._points) < 2 or self._points[-1][0] - self._points[0][0] < _SHORTEST:
            return math.nan
        times, transits = zip(*self._points, strict=True)
        return -1e6 * linear_regression(times, transits).slope

    def push(self, transit: float, *, now: float) -> None:
        """Take a transit; of each second the least is kept."""
        if not self._points or now - self._points[-1][0] >= 1.0:
            self._points.append((now, transit))
        elif transit < self._points[-1][1]:
            self._points[-1] = (self._points[-1][0], transit)
