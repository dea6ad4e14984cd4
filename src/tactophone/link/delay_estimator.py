"""Estimating network delay and clock skew without a common clock.

A packet's arrival time less its timestamp is its transit time plus an unknown constant. The *minimum* over a while is
the delay of the empty network: what lies above it is queueing, and its slow drift is the difference of the two clocks.
Loss and jitter do not move the minimum, so playout and staleness are derived from it and not from the average.
"""

import math
from collections import deque
from statistics import linear_regression

WINDOW = 0.14
"""Seconds of a window; the newest two count. A longer path is followed after one to two windows, a shorter at once.
Two windows stay under 0.3 s, the longest that sound may count as stale after a stall has ended. Half a second, as
before, kept it stale for 0.5 to 0.9 s whenever a stall had made the way longer (measured with a stopped robot)."""

_MIN_PACKETS = 5
"""Packets that complete a window, so that a stall and the burst after it are not taken for a longer path; fewer than
a window holds of the longest packets, 20 ms."""

_POINTS = 30
_MIN_SPAN = 10.0
"""Points, one a second, of the regression of the clocks, and seconds that they must span at least."""


class MinDelayFilter:
    """The minimum transit time over the newest two windows.

    Examples
    --------
    >>> delay = MinDelayFilter()
    >>> for transit in (3.2, 3.0, 3.4):
    ...     delay.push(transit, now=0.0)
    >>> delay.minimum
    3.0
    """

    def __init__(self) -> None:
        self._window_start = -math.inf
        self._count = 0
        self._current = self._previous = math.inf

    @property
    def minimum(self) -> float:
        """In seconds; infinite before the first packet."""
        return min(self._current, self._previous)

    def push(self, transit: float, *, now: float) -> None:
        """Add the transit time of one packet, in s."""
        if now - self._window_start >= WINDOW and (self._count >= _MIN_PACKETS or math.isinf(self._window_start)):
            self._previous, self._current = self._current, math.inf
            self._window_start, self._count = now, 0
        self._current = min(self._current, transit)
        self._count += 1


class Skew:
    """How much faster the peer's clock runs than the local one: the slope of the minimum transit time over 30 s.

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
        """Parts per million; NaN until ten seconds have passed."""
        if len(self._points) < 2 or self._points[-1][0] - self._points[0][0] < _MIN_SPAN:
            return math.nan
        times, transits = zip(*self._points, strict=True)
        return -1e6 * linear_regression(times, transits).slope

    def push(self, transit: float, *, now: float) -> None:
        """Add a transit time, in s; the minimum of each second is kept."""
        if not self._points or now - self._points[-1][0] >= 1.0:
            self._points.append((now, transit))
        elif transit < self._points[-1][1]:
            self._points[-1] = (self._points[-1][0], transit)
