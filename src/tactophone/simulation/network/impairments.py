"""A network that loses, delays, doubles and stalls, by a seed: the same packets meet the same fate in every run.

Loss follows Gilbert and Elliott (Gilbert, Bell Syst. Tech. J. 39, 1960; Elliott, ibid. 42, 1963): the line is good, and
loses nothing, or bad, and loses everything; it stays bad for ``burst`` packets in the mean. A burst of 1 is loss at
random. Delay is a constant, plus an exponential queue as in a busy Wi-Fi cell, plus now and then a stall (roaming,
scanning), during which everything waits and after which it comes in one clump.
"""

import heapq
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from tactophone.errors import ConfigError


@dataclass(frozen=True, slots=True)
class NetworkProfile:
    """What a line does to datagrams, one way.

    Parameters
    ----------
    loss
        Share of packets lost, from 0 to below 1.
    burst
        Packets lost in a row, in the mean.
    delay, jitter
        Seconds: the constant part, and the mean of what an exponential queue adds.
    spread
        Seconds of further delay, uniform from 0.
    duplicates
        Share of packets that come twice.
    overtaking
        Whether packets may overtake one another; else one that queues holds up those behind it.
    stall, stall_interval
        Seconds that a stall lasts, and mean seconds between two; none when the interval is infinite.
    """

    loss: float = 0.0
    burst: float = 1.0
    delay: float = 0.0
    jitter: float = 0.0
    spread: float = 0.0
    duplicates: float = 0.0
    overtaking: bool = False
    stall: float = 0.0
    stall_interval: float = math.inf

    def __post_init__(self) -> None:
        if not (0 <= self.loss < 1 and self.burst >= 1 and min(self.delay, self.jitter, self.spread, self.stall) >= 0):
            raise ConfigError(f"no network is like {self}: loss is 0 to below 1, a burst at least 1, no time negative")


PROFILES: dict[str, NetworkProfile] = {
    "clean": NetworkProfile(),
    "lan": NetworkProfile(delay=0.0002, jitter=0.00005),
    "wifi": NetworkProfile(loss=0.002, burst=1.5, delay=0.001, jitter=0.0015),
    "wifi-busy": NetworkProfile(loss=0.02, burst=2.0, delay=0.002, jitter=0.004, stall=0.05, stall_interval=10.0),
    "wifi-roaming": NetworkProfile(loss=0.005, burst=2.0, delay=0.001, jitter=0.002, stall=0.2, stall_interval=15.0),
    "internet": NetworkProfile(loss=0.005, burst=1.2, delay=0.02, jitter=0.001, overtaking=True),
    "bursty": NetworkProfile(loss=0.05, burst=5.0, delay=0.002),
}
"""Lines by name. The Wi-Fi ones have that network's habits (milliseconds of contention, loss mostly hidden by
retransmission, pauses while a station scans or changes its access point) at sizes that we chose, not measured."""


def network(text: str) -> NetworkProfile:
    """Read a line from a profile's name, with changes: ``wifi``, ``wifi,loss=0.05``, ``loss=0.1,burst=3``.

    Examples
    --------
    >>> network("lan,loss=0.05").loss
    0.05
    """
    name, *changes = text.split(",")
    if "=" in name:
        name, changes = "clean", [name, *changes]
    if name not in PROFILES:
        raise ConfigError(f"no network is named {name!r}; there are {', '.join(PROFILES)}, or write loss=0.05,burst=3")
    try:
        numbers = {key: float(value) for key, value in (change.split("=") for change in changes)}
        return replace(PROFILES[name], **numbers)  # type: ignore[arg-type]
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{text!r} is no network ({error}); write for instance wifi,loss=0.05,delay=0.01") from error


@dataclass(frozen=True, slots=True)
class Fate:
    """What happens to one datagram: the delays of its copies, none when it is lost."""

    delays: tuple[float, ...]


def fates(profile: NetworkProfile, *, seed: int) -> Iterator[Fate]:
    """Draw the fate of each datagram in turn, without end."""
    random = np.random.default_rng(seed)
    bad = False
    recover = 1 / profile.burst
    # The chain is bad for `loss` of the time when it turns bad this often.
    decay = recover * profile.loss / (1 - profile.loss)
    while True:
        turn, double, queue, spread = random.random(4)
        # Without memory (burst 1) each packet is drawn afresh; else the state persists.
        bad = turn < profile.loss if profile.burst == 1 else (turn >= recover if bad else turn < decay)
        delay = profile.delay - profile.jitter * math.log1p(-queue) + profile.spread * spread
        yield Fate(() if bad else (delay, delay) if double < profile.duplicates else (delay,))


class ImpairedLine:
    """Carries datagrams one way, late or never; time is an argument.

    Parameters
    ----------
    profile
        What the line is like.
    seed
        Gives the same fates to the same packets, whatever the time between them.
    lost
        Tells of each packet in turn whether it is lost, in place of the profile's loss.
    """

    def __init__(self, profile: NetworkProfile, *, seed: int = 0, lost: Iterator[bool] | None = None) -> None:
        self._profile = profile
        self._fates = fates(profile, seed=seed)
        self._lost = lost
        self._stalls = np.random.default_rng((seed, 1))
        self._stall_begins: float | None = None
        self._queue: list[tuple[float, int, bytes]] = []
        self._numbers = count()
        self._last = -math.inf

    @property
    def next_due(self) -> float:
        """When the next datagram comes out; infinite when none is under way."""
        return self._queue[0][0] if self._queue else math.inf

    def push(self, datagram: bytes, *, now: float) -> None:
        """Send a datagram."""
        fate = next(self._fates)
        delays = fate.delays or (self._profile.delay,)
        if next(self._lost) if self._lost else not fate.delays:
            return
        for delay in delays:
            due = self._after_stall(now + delay)
            if not self._profile.overtaking:
                due = self._last = max(due, self._last)
            heapq.heappush(self._queue, (due, next(self._numbers), datagram))

    def pull(self, now: float) -> list[bytes]:
        """Give what has come out by now, oldest first."""
        out = []
        while self._queue and self._queue[0][0] <= now:
            out.append(heapq.heappop(self._queue)[2])
        return out

    def _after_stall(self, due: float) -> float:
        """Hold back what would come within a stall until its end."""
        if not math.isfinite(self._profile.stall_interval):
            return due
        if self._stall_begins is None:
            self._stall_begins = due + self._pause()
        while due > self._stall_begins + self._profile.stall:
            self._stall_begins += self._profile.stall + self._pause()
        return self._stall_begins + self._profile.stall if due > self._stall_begins else due

    def _pause(self) -> float:
        return float(self._stalls.exponential(self._profile.stall_interval))
