"""Statistics of reception, network delay and clock skew, named as in RFC 3550 and
WebRTC's inbound statistics.

======================  ===============================================================
here                    WebRTC (``RTCInboundRtpStreamStats``)
======================  ===============================================================
``packets_received``    ``packetsReceived``, without duplicates
``packets_lost``        ``packetsLost``: expected less received, before any recovery
``most_lost``           none: the maximum of ``packets_lost``, which a late packet
                        lowers, while a counter must not fall
``packets_late``        ``packetsDiscarded``: received after their place had been filled
``packets_duplicated``  none; RFC 3550 counts them as received
``packets_reordered``   none: received after a newer one
``packets_recovered``   ``fecPacketsReceived`` that were used
``packets_concealed``   none: lost packets whose sound was concealed
``packets_skipped``     none: too late for a prediction, used as history only
``jitter``              ``jitter``, RFC 3550 section 6.4.1
``samples_received``    ``totalSamplesReceived``
``samples_concealed``   ``concealedSamples``
``samples_skipped``     none: gaps too long to conceal
======================  ===============================================================

Delay and skew are estimated without a common clock. A packet's arrival time less its
timestamp is its transit time plus an unknown constant. The *minimum* over a while is
the delay of the empty network: what lies above it is queueing, and its slow drift is
the difference of the two clocks. Loss and jitter do not move the minimum, so playout
and staleness are derived from it and not from the average.
"""

import math
from collections import deque
from dataclasses import dataclass
from statistics import linear_regression

from tactophone.net.link.packet import CLOCK_RATE, ahead
from tactophone.net.link.rtcp import ReceiverReport, SenderReport

_WRAP = (1 << 32) / CLOCK_RATE
"""Seconds until an RTP timestamp repeats: 24.86 h."""


@dataclass(slots=True)
class StreamStats:
    """Counters of one stream since it began; the module explains them."""

    packets_received: int = 0
    packets_late: int = 0
    packets_duplicated: int = 0
    packets_reordered: int = 0
    packets_recovered: int = 0
    packets_concealed: int = 0
    packets_skipped: int = 0
    packets_broken: int = 0
    samples_received: int = 0
    samples_concealed: int = 0
    samples_skipped: int = 0
    jitter: float = 0.0
    most_lost: int = 0
    first: int | None = None
    highest: int = 0

    @property
    def packets_expected(self) -> int:
        """From the first to the highest sequence number received."""
        return 0 if self.first is None else self.highest - self.first + 1

    @property
    def packets_lost(self) -> int:
        """Expected and never received (RFC 3550 appendix A.3)."""
        return max(0, self.packets_expected - self.packets_received)


class Reception:
    """Updates a stream's `StreamStats` and makes its receiver reports."""

    def __init__(self) -> None:
        self.stats = StreamStats()
        self._transit: float | None = None
        self._seen: set[int] = set()
        self._reported = (0, 0)
        self._last_report = (0, 0.0)

    def count(self, sequence: int, timestamp: int, *, now: float) -> bool:
        """Count a packet; return false for a duplicate (among the newest 2**10)."""
        stats = self.stats
        following = stats.highest + 1
        if sequence == following % (1 << 16) and stats.first is not None:
            stats.highest = following  # in order: new, and as many are lost as before
            self._mark_seen(following)
            stats.packets_received += 1
        elif not self._count_other(sequence):
            return False
        self._update_jitter(timestamp, now)
        return True

    def _count_other(self, sequence: int) -> bool:
        """Count a packet that is not the next in order."""
        stats = self.stats
        if stats.first is None:
            stats.first = stats.highest = sequence
        # The number that continues the highest one, forwards or backwards (RFC 3550
        # appendix A.1).
        number = stats.highest + ahead(sequence, stats.highest % (1 << 16), bits=16)
        if number in self._seen:
            stats.packets_duplicated += 1
            return False
        self._mark_seen(number)
        stats.packets_received += 1
        stats.packets_reordered += number < stats.highest
        stats.highest = max(stats.highest, number)
        stats.most_lost = max(stats.most_lost, stats.packets_lost)
        return True

    def came_late(self, position: int, due: int) -> bool:
        """Whether sound at a position comes after its place was filled, which counts
        its packet as late."""
        self.stats.packets_late += position < due
        return position < due

    def note_sender_report(self, report: SenderReport, *, now: float) -> None:
        """Keep the peer's report, whose stamp and age the next receiver report
        returns."""
        self._last_report = (report.stamp, now)

    def report(self, *, ssrc: int, of: int, now: float) -> ReceiverReport:
        """Make the receiver report on stream ``of`` since the last report."""
        stats = self.stats
        expected = stats.packets_expected - self._reported[0]
        received = stats.packets_received - self._reported[1]
        self._reported = (stats.packets_expected, stats.packets_received)
        fraction = max(0.0, 1 - received / expected) if expected > 0 else 0.0
        stamp, received_at = self._last_report
        since = now - received_at if stamp else 0.0
        return ReceiverReport(
            ssrc,
            of,
            fraction,
            stats.packets_lost,
            stats.highest,
            stats.jitter,
            stamp,
            since,
        )

    def _mark_seen(self, number: int) -> None:
        self._seen.add(number)
        # Old numbers are dropped one by one: the sweep below, which gaps make
        # necessary, takes long.
        self._seen.discard(number - (1 << 10))
        if len(self._seen) > 1 << 11:
            self._seen = {
                seen for seen in self._seen if seen > self.stats.highest - (1 << 10)
            }

    def _update_jitter(self, timestamp: int, now: float) -> None:
        """Average the change of transit times with a weight of 1/16 (RFC 3550 appendix
        A.8)."""
        transit = now - timestamp / CLOCK_RATE
        if self._transit is not None:
            # The timestamp wraps once a day; that step is not jitter. The change is
            # taken to the nearest turn.
            turns = round((transit - self._transit) / _WRAP)
            change = abs(transit - self._transit - turns * _WRAP)
            self.stats.jitter += (change - self.stats.jitter) / 16
        self._transit = transit


TRANSIT_WINDOW = 0.14
"""Seconds of a window; the newest two count. A longer path is followed after one to two
windows, a shorter at once. Two windows stay under 0.3 s, the longest that sound may
count as stale after a stall has ended. Windows of half a second kept it stale for 0.5
to 0.9 s whenever a stall had made the path longer (measured with a stopped robot)."""

_MIN_PACKETS = 5
"""Packets that complete a window, so that a stall and the burst after it are not taken
for a longer path. Even of the longest packets, 20 ms, a window holds more."""

_POINTS = 30
"""Points of the regression of the clocks, one a second."""

_MIN_SPAN = 10.0
"""Seconds that these points must span before there is an estimate."""


class MinDelayFilter:
    """The minimum transit time over the newest two windows.

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
        # The window that ends becomes the previous one, so that the minimum always
        # covers one to two windows.
        if now - self._window_start >= TRANSIT_WINDOW and (
            self._count >= _MIN_PACKETS or math.isinf(self._window_start)
        ):
            self._previous = self._current
            self._current = math.inf
            self._window_start = now
            self._count = 0
        self._current = min(self._current, transit)
        self._count += 1


class Skew:
    """How much faster the peer's clock runs than the local one: the slope of the
    minimum transit time over 30 s.

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
        if (
            len(self._points) < 2
            or self._points[-1][0] - self._points[0][0] < _MIN_SPAN
        ):
            return math.nan
        times, transits = zip(*self._points, strict=True)
        return -1e6 * linear_regression(times, transits).slope

    def push(self, transit: float, *, now: float) -> None:
        """Add a transit time, in s; the minimum of each second is kept."""
        if not self._points or now - self._points[-1][0] >= 1.0:
            self._points.append((now, transit))
        elif transit < self._points[-1][1]:
            self._points[-1] = (self._points[-1][0], transit)
