"""When to play what: the control of the clocked playout, apart from any sound.

The place to read from is steered to *the newest sample that the line at its emptiest would have brought by now, less a
margin*. The least transit of each second (:mod:`~tactophone.link.delay_estimator`) tells the first part, and neither loss nor
jitter moves it; a slow proportional-integral loop turns the rest into a speed. A common loop on the fill level or on
arrival times is unstable at 2 ms of jitter; this one holds the ratio to a few millionths (both measured).

The margin is what the line needs: a packet, the block asked for, and enough for all but the latest 1 in 1000 of them,
learnt in a quarter of a second of listening before anything is played. It grows as soon as 1 in 250 comes too late,
and shrinks when a thousand packets have shown that half would do. Changes are played a little faster or slower, by
`SLEW`: a ninth of the least change of frequency that a finger notices (Pongrac 2008), so nothing jumps. Only when the
way itself has changed by more than `JUMP` is the place set anew.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.link.packet import CLOCK_RATE

TIME_CONSTANT = 8.0
"""Seconds of the loop: slow against jitter, fast against the drift of quartz; damped critically."""

LARGEST_SKEW = 400e-6
"""Ratio that the integral may reach: twice the worst pair of sound cards."""

SLEW = 0.02
"""Speed by which playing hurries or dawdles at most, to reach a changed margin: 20 ms in a second."""

STEADY = 0.002
"""Seconds of error up to which the slow loop is left alone; beyond, it slews."""

JUMP = 0.04
"""Seconds of error from which the place is set anew: slewing would take more than two seconds."""

LEAST_ALLOWANCE, LARGEST_ALLOWANCE = 0.002, 0.08
"""Seconds that may be kept for jitter; what is later than the largest is a stall, and is not waited for."""

LISTENING = 0.25
"""Seconds of listening before the first sound."""

_WANTED, _TOLERATED = 1 / 1000, 1 / 250
"""Shares of packets that come too late: what a new allowance is made for, and what makes a new one."""

_LONG, _SHORT = 4_000, 1_000
"""Packets that are looked back upon to grow, and to shrink: 20 and 5 seconds of 5 ms each."""

_MUCH_LESS = 0.5
"""Part of the allowance that must have sufficed for it to shrink, so that chance does not move it to and fro."""

_WAY_CHANGED = 20
"""Packets late in a row that mean a longer way, not jitter."""


@dataclass(frozen=True, slots=True)
class Step:
    """How to render the next block: samples read for each one played, and whether the place was set anew."""

    speed: float
    jumped: bool = False


class PlayoutController:
    """Steers the playout of one stream; positions are the sender's samples, times are ours.

    Parameters
    ----------
    block_size
        Samples asked for at once.

    Attributes
    ----------
    position
        The next sample to play.
    """

    def __init__(self, *, block_size: int) -> None:
        self.position = math.nan
        self._block_size = block_size
        self._packet_size = 0
        self._first = math.inf
        self._least = math.inf
        self._allowance = Allowance()
        self._second = _Second()
        self._integral = 0.0
        self._speed = 1.0
        self._late: list[float] = []

    @property
    def margin(self) -> float:
        """Seconds by which we play behind the newest sound of the line at its emptiest."""
        return (self._packet_size + self._block_size) / CLOCK_RATE + self._allowance.duration

    @property
    def skew_ppm(self) -> float:
        """How much faster the sender's clock runs than ours, as the loop has found it."""
        return 1e6 * self._integral

    def delay(self, now: float) -> float:
        """Seconds that sound truly lies behind now."""
        return now - self._least - self.position / CLOCK_RATE

    def push(self, start: int, size: int, *, now: float) -> None:
        """Note that a packet came."""
        self._packet_size = size
        transit = now - (start + size) / CLOCK_RATE
        self._second.push_transit(transit)
        self._least = min(self._least, transit)
        self._allowance.push(transit - self._least)
        self._late = [*self._late, transit] if start < self.position else []
        if len(self._late) >= _WAY_CHANGED:
            self._least, self._late = min(self._late), []
            self._allowance.forget()

    def step(self, size: int, *, now: float) -> Step:
        """Move on by ``size`` samples played at ``now``; `position` is NaN while there is nothing to play yet."""
        if not self._has_listened(now):
            return Step(1.0)
        target = (now - self._least - self.margin) * CLOCK_RATE
        jumped = not abs(target - self.position) < JUMP * CLOCK_RATE
        if jumped:
            self.position = target
        self._second.push_error((target - self.position) / CLOCK_RATE)
        if self._second.is_over(now):
            self._steer(self._second.error)
            self._least = self._second.smoothed(self._least)
            self._second = _Second(now)
            self._allowance.settle()
        self.position += size * self._speed
        return Step(self._speed, jumped)

    def _has_listened(self, now: float) -> bool:
        if not math.isnan(self.position):
            return True
        self._first = min(self._first, now if math.isfinite(self._least) else math.inf)
        if now - self._first < LISTENING:
            return False
        self._allowance.settle()
        return True

    def _steer(self, error: float) -> None:
        if abs(error) > STEADY:
            self._speed = 1 + self._integral + math.copysign(min(SLEW, abs(error)), error)
            return
        self._integral += error / (2 * TIME_CONSTANT**2)
        self._integral = max(-LARGEST_SKEW, min(self._integral, LARGEST_SKEW))
        self._speed = 1 + self._integral + error / TIME_CONSTANT


class Allowance:
    """What is kept for jitter, in seconds."""

    def __init__(self) -> None:
        self.duration = LEAST_ALLOWANCE
        self._known: deque[float] = deque(maxlen=_LONG)

    def push(self, lateness: float) -> None:
        """Note how late a packet was against the line's emptiest; a stall's are left out."""
        if lateness <= LARGEST_ALLOWANCE:
            self._known.append(lateness)

    def settle(self) -> None:
        """Grow where too many were late, shrink where few would be; call it once a second."""
        known = np.array(self._known)
        newest = known[-_SHORT:]
        if known.size and (known > self.duration).mean() > _TOLERATED:
            self.duration = _enough(known)
        elif len(newest) == _SHORT and _enough(newest) < _MUCH_LESS * self.duration:
            self.duration = _enough(newest)

    def forget(self) -> None:
        """Drop what is known, because the way has changed."""
        self._known.clear()


def _enough(known: NDArray[np.float64]) -> float:
    needed = np.quantile(known, 1 - _WANTED) + LEAST_ALLOWANCE / 2 if known.size else LEAST_ALLOWANCE
    return float(np.clip(needed, LEAST_ALLOWANCE, LARGEST_ALLOWANCE))


class _Second:
    """What one second has shown."""

    def __init__(self, begun: float = math.nan) -> None:
        self._begun = begun
        self._least = math.inf
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
        self._least = min(self._least, transit)

    def push_error(self, error: float) -> None:
        self._sum += error
        self._count += 1

    def smoothed(self, least: float) -> float:
        """Follow this second's least transit: half of a small change, all of one that is no drift."""
        if math.isinf(self._least):
            return least
        change = self._least - least
        return self._least if abs(change) > STEADY else least + change / 2
