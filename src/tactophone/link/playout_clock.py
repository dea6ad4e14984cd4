"""The control of the clocked playout: which position of the stream to play, computed without any sound.

The play position follows *the newest sample that the empty network would have delivered by now, less a margin*. The
first part is the minimum transit time of each second, which neither loss nor jitter moves
(:mod:`~tactophone.link.delay_estimator`); a slow proportional-integral loop turns the rest into a speed. A loop on the
buffer level or on arrival times, the usual design, is unstable at 2 ms of jitter; this loop holds the clock ratio to a
few ppm (both measured).

The margin is one packet, the block to render, and an allowance for jitter: the lateness that 1 packet in 1000 exceeds,
learned during `WARM_UP` before anything is played. It grows as soon as 1 packet in 250 is too late, and shrinks when
half of it was enough for a thousand packets. Changes are played a little faster or slower, by `SLEW`: a ninth of the
smallest change of frequency that a finger notices (Pongrac 2008). Only an error above `JUMP` sets the position anew.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.link.packet import CLOCK_RATE

TIME_CONSTANT = 8.0
"""Seconds of the loop: slow against jitter, fast against the drift of quartz; critically damped."""

MAX_SKEW = 400e-6
"""Limit of the integral, as a ratio: twice the worst pair of sound cards."""

SLEW = 0.02
"""Maximum relative change of speed on the way to a changed margin: 20 ms in a second."""

DEAD_BAND = 0.002
"""Seconds of error up to which only the slow loop acts; above, the position slews."""

JUMP = 0.04
"""Seconds of error above which the position is set anew: slewing would take more than two seconds."""

MIN_ALLOWANCE, MAX_ALLOWANCE = 0.002, 0.04
"""Seconds allowed for jitter; a packet later than the maximum is a stall, which playout does not wait for. With a
packet and a period of 512 samples, the margin stays under the 60 ms from which sound counts as stale."""

WARM_UP = 0.25
"""Seconds of measuring before the first sound."""

_TARGET_LATE, _MAX_LATE = 1 / 1000, 1 / 250
"""Shares of late packets: the share that a new allowance is computed for, and the share that triggers a new one."""

_LONG, _SHORT = 4_000, 1_000
"""Packets evaluated to grow, and to shrink: 20 and 5 seconds of 5 ms each."""

_SHRINK = 0.5
"""The allowance shrinks when this part of it would have been enough; hysteresis against chance."""

_PATH_CHANGED = 20
"""Late packets in a row that mean a longer path, not jitter."""


@dataclass(frozen=True, slots=True)
class Step:
    """How to render the next block: stream samples for each rendered one, and whether the position was set anew."""

    speed: float
    jumped: bool = False


class PlayoutController:
    """Controls the playout of one stream; positions are in samples of the sender, times in s of the local clock.

    Attributes
    ----------
    position
        The next sample to play; NaN before the first.
    """

    def __init__(self, *, block_size: int) -> None:
        self.position = math.nan
        self._block_size = block_size
        self._packet_size = 0
        self._first, self._arrived = math.inf, -math.inf
        self._min_transit = math.inf
        self._allowance = Allowance()
        self._second = _Second()
        self._integral = 0.0
        self._speed = 1.0
        self._late: list[float] = []

    @property
    def margin(self) -> float:
        """Seconds from the play position to the newest sample that the empty network would have delivered."""
        return (self._packet_size + self._block_size) / CLOCK_RATE + self._allowance.duration

    @property
    def skew_ppm(self) -> float:
        """How much faster the sender's clock runs than the local one, as estimated by the loop."""
        return 1e6 * self._integral

    def delay(self, now: float) -> float:
        """Seconds from a sample's arrival over the empty network to its playout."""
        return now - self._min_transit - self.position / CLOCK_RATE

    def push(self, start: int, size: int, *, now: float) -> None:
        """Add the arrival of a packet of ``size`` samples from position ``start``."""
        self._packet_size = size
        transit = now - (start + size) / CLOCK_RATE
        self._second.push_transit(transit)
        self._min_transit = min(self._min_transit, transit)
        if now != self._arrived:
            # Packets that come together waited for the same cause: the first, which waited longest, stands for all.
            self._arrived = now
            self._allowance.push(transit - self._min_transit)
        self._late = [*self._late, transit] if start < self.position else []
        if len(self._late) >= _PATH_CHANGED:
            # The lateness known so far was measured against the shorter path.
            self._min_transit, self._late = min(self._late), []
            self._allowance.reset()

    def step(self, size: int, *, now: float) -> Step:
        """Advance by ``size`` samples rendered at ``now``; `position` is NaN until there is something to play."""
        if not self._warmed_up(now):
            return Step(1.0)
        target = (now - self._min_transit - self.margin) * CLOCK_RATE
        # Written so that a position of NaN jumps too.
        jumped = not abs(target - self.position) < JUMP * CLOCK_RATE
        if jumped:
            self.position = target
        self._second.push_error((target - self.position) / CLOCK_RATE)
        if self._second.is_over(now):
            self._steer(self._second.error)
            self._min_transit = self._second.smoothed(self._min_transit)
            self._second = _Second(now)
            self._allowance.update()
        self.position += size * self._speed
        return Step(self._speed, jumped)

    def _warmed_up(self, now: float) -> bool:
        if not math.isnan(self.position):
            return True
        self._first = min(self._first, now if math.isfinite(self._min_transit) else math.inf)
        if now - self._first < WARM_UP:
            return False
        self._allowance.update()
        return True

    def _steer(self, error: float) -> None:
        if abs(error) > DEAD_BAND:
            # A changed margin, not skew: the integral stays as it is.
            self._speed = 1 + self._integral + math.copysign(min(SLEW, abs(error)), error)
            return
        self._integral += error / (2 * TIME_CONSTANT**2)
        self._integral = max(-MAX_SKEW, min(self._integral, MAX_SKEW))
        self._speed = 1 + self._integral + error / TIME_CONSTANT


class Allowance:
    """The allowance for jitter, in seconds."""

    def __init__(self) -> None:
        self.duration = MIN_ALLOWANCE
        self._lateness: deque[float] = deque(maxlen=_LONG)

    def push(self, lateness: float) -> None:
        """Add a packet's lateness (s) against the empty network; packets of a stall are left out."""
        if lateness <= MAX_ALLOWANCE:
            self._lateness.append(lateness)

    def update(self) -> None:
        """Grow if too many packets were late, shrink if few would be; call it once a second."""
        lateness = np.array(self._lateness)
        newest = lateness[-_SHORT:]
        if lateness.size and (lateness > self.duration).mean() > _MAX_LATE:
            self.duration = _allowance_for(lateness)
        elif len(newest) == _SHORT and _allowance_for(newest) < _SHRINK * self.duration:
            self.duration = _allowance_for(newest)

    def reset(self) -> None:
        """Drop the measurements of a path that has changed."""
        self._lateness.clear()


def _allowance_for(lateness: NDArray[np.float64]) -> float:
    needed = np.quantile(lateness, 1 - _TARGET_LATE) + MIN_ALLOWANCE / 2 if lateness.size else MIN_ALLOWANCE
    return float(np.clip(needed, MIN_ALLOWANCE, MAX_ALLOWANCE))


class _Second:
    """The minimum transit time and the mean error of one second."""

    def __init__(self, begun: float = math.nan) -> None:
        self._begun = begun
        self._min_transit = math.inf
        self._sum = 0.0
        self._count = 0

    @property
    def error(self) -> float:
        return self._sum / max(1, self._count)

    def is_over(self, now: float) -> bool:
        if math.isnan(self._begun):
            self._begun = now
        return now - self._begun >= 1.0

    def push_transit(self, transit: float) -> None:
        self._min_transit = min(self._min_transit, transit)

    def push_error(self, error: float) -> None:
        self._sum += error
        self._count += 1

    def smoothed(self, min_transit: float) -> float:
        """Update a minimum transit time: half of a small change, all of one that cannot be drift."""
        if math.isinf(self._min_transit):
            return min_transit
        change = self._min_transit - min_transit
        return self._min_transit if abs(change) > DEAD_BAND else min_transit + change / 2
