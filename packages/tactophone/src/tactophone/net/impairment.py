"""A simulated network that loses, delays, duplicates and stalls; a seed makes it
repeatable.

Loss follows the Gilbert-Elliott model (Gilbert, Bell Syst. Tech. J. 39, 1960; Elliott,
ibid. 42, 1963): the good state loses no packet, the bad state loses every packet and
lasts for ``burst`` packets on average. A burst of 1 is independent random loss. Delay
is a constant, plus an exponential queue as in a busy Wi-Fi cell, plus occasional stalls
(roaming, scanning), after which all held packets arrive at once.

The proxy is such a link between two real sockets: the robot calls it instead of the
operator.
"""

import heapq
import math
import select
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import Self

import numpy as np

from tactophone.core.errors import ConfigError
from tactophone.net.link.packet import Address
from tactophone.net.link.udp import UdpSocket


@dataclass(frozen=True, slots=True)
class NetworkProfile:
    """The impairments of one direction of a link."""

    loss: float = 0.0
    """Share of packets lost, 0 to below 1."""
    burst: float = 1.0
    """Mean number of packets lost in a row."""
    delay: float = 0.0
    """Seconds of constant delay."""
    jitter: float = 0.0
    """Mean, in s, of the exponential queueing delay."""
    spread: float = 0.0
    """Seconds of further delay, uniform from 0."""
    duplicates: float = 0.0
    """Share of packets that arrive twice."""
    overtaking: bool = False
    """Whether packets may overtake one another; if not, a delayed packet also delays
    those behind it."""
    stall: float = 0.0
    """Seconds of a stall."""
    stall_interval: float = math.inf
    """Mean seconds between two stalls; infinite: none."""

    def __post_init__(self) -> None:
        if not 0 <= self.loss < 1:
            raise ConfigError(
                f"a network's loss is a share from 0 to below 1, not {self.loss:g}"
            )
        if not 0 <= self.duplicates <= 1:
            raise ConfigError(
                "a network's duplicates are a share from 0 to 1, "
                f"not {self.duplicates:g}"
            )
        if not 1 <= self.burst < math.inf:
            raise ConfigError(
                f"a network's burst is at least 1 packet, not {self.burst:g}"
            )
        for name in ("delay", "jitter", "spread", "stall"):
            seconds = getattr(self, name)
            if not 0 <= seconds < math.inf:
                raise ConfigError(
                    f"a network's {name} is a time in s, at least 0, not {seconds:g}"
                )
        if not self.stall_interval > 0:
            raise ConfigError(
                "a network's stall_interval is a time over 0 s, "
                f"not {self.stall_interval:g}"
            )


NETWORK_PROFILES: dict[str, NetworkProfile] = {
    "clean": NetworkProfile(),
    "lan": NetworkProfile(delay=0.0002, jitter=0.00005),
    "wifi": NetworkProfile(loss=0.002, burst=1.5, delay=0.001, jitter=0.0015),
    "wifi-busy": NetworkProfile(
        loss=0.02, burst=2.0, delay=0.002, jitter=0.004, stall=0.05, stall_interval=10.0
    ),
    "wifi-roaming": NetworkProfile(
        loss=0.005, burst=2.0, delay=0.001, jitter=0.002, stall=0.2, stall_interval=15.0
    ),
    "internet": NetworkProfile(
        loss=0.005, burst=1.2, delay=0.02, jitter=0.001, overtaking=True
    ),
    "bursty": NetworkProfile(loss=0.05, burst=5.0, delay=0.002),
}
"""Profiles by name. The Wi-Fi profiles model milliseconds of contention, loss mostly
hidden by retransmission, and pauses while a station scans or changes its access point;
their values are assumed, not measured."""


def network_profile(text: str) -> NetworkProfile:
    """Parse a profile's name and changes: ``wifi``, ``wifi,loss=0.05``,
    ``loss=0.1,burst=3``.

    >>> network_profile("lan,loss=0.05").loss
    0.05
    """
    name, *changes = text.split(",")
    if "=" in name:
        # Changes alone, without a name, apply to the network that changes nothing.
        changes.insert(0, name)
        name = "clean"
    if name not in NETWORK_PROFILES:
        raise ConfigError(
            f"no network is named {name!r}; there are {', '.join(NETWORK_PROFILES)}, "
            "or write loss=0.05,burst=3"
        )
    try:
        numbers = {
            key: float(value)
            for key, value in (change.split("=") for change in changes)
        }
        return replace(NETWORK_PROFILES[name], **numbers)  # type: ignore[arg-type]
    except (ValueError, TypeError) as error:
        raise ConfigError(
            f"{text!r} is not a network ({error}); "
            "write for instance wifi,loss=0.05,delay=0.01"
        ) from error


def deliveries(profile: NetworkProfile, *, seed: int) -> Iterator[tuple[float, ...]]:
    """Yield the delays (s) of the copies of each datagram, without end: none when it is
    lost, two when duplicated."""
    random = np.random.default_rng(seed)
    bad = False
    recover = 1 / profile.burst
    # With this probability of leaving the good state, the chain is in the bad state for
    # a share `loss` of the time.
    decay = recover * profile.loss / (1 - profile.loss)
    while True:
        turn, double, queue, spread = random.random(4)
        if profile.burst == 1:
            # Each packet is drawn independently.
            bad = turn < profile.loss
        elif bad:
            bad = turn >= recover
        else:
            bad = turn < decay
        queueing = -profile.jitter * math.log1p(-queue)
        delay = profile.delay + queueing + profile.spread * spread
        if bad:
            yield ()
        elif double < profile.duplicates:
            yield (delay, delay)
        else:
            yield (delay,)


class ImpairedLink:
    """One direction of an impaired link; time is an argument.

    A seed gives the same deliveries to the same packets, whatever the time between
    them. ``lost`` says whether each packet in turn is lost, instead of the profile's
    loss.
    """

    def __init__(
        self,
        profile: NetworkProfile,
        *,
        seed: int = 0,
        lost: Iterator[bool] | None = None,
    ) -> None:
        self._profile = profile
        self._fates = deliveries(profile, seed=seed)
        self._lost = lost
        self._stalls = np.random.default_rng((seed, 1))
        self._stall_begins: float | None = None
        self._queue: list[tuple[float, int, bytes]] = []
        self._numbers = count()
        self._last = -math.inf

    @property
    def next_due(self) -> float:
        """When the next datagram is delivered; infinite when none is in transit."""
        return self._queue[0][0] if self._queue else math.inf

    def push(self, datagram: bytes, *, now: float) -> None:
        delays = next(self._fates)
        lost = next(self._lost) if self._lost else not delays
        if lost:
            return
        # Where ``lost`` spares a packet that the profile would lose, it has the
        # profile's constant delay.
        for delay in delays or (self._profile.delay,):
            due = self._after_stall(now + delay)
            if not self._profile.overtaking:
                due = max(due, self._last)
                self._last = due
            heapq.heappush(self._queue, (due, next(self._numbers), datagram))

    def pull(self, now: float) -> list[bytes]:
        """Return the datagrams delivered by ``now``, oldest first."""
        out = []
        while self._queue and self._queue[0][0] <= now:
            out.append(heapq.heappop(self._queue)[2])
        return out

    def _after_stall(self, due: float) -> float:
        """Return the delivery time, postponed to the end of a stall that it falls
        into."""
        if not math.isfinite(self._profile.stall_interval):
            return due
        if self._stall_begins is None:
            self._stall_begins = due + self._pause()
        while due > self._stall_begins + self._profile.stall:
            self._stall_begins += self._profile.stall + self._pause()
        if due > self._stall_begins:
            return self._stall_begins + self._profile.stall
        return due

    def _pause(self) -> float:
        return float(self._stalls.exponential(self._profile.stall_interval))


_MAX_WAIT = 0.05
"""Seconds after which the proxy looks whether it should end."""


class ImpairmentProxy:
    """Forwards datagrams in both directions through two impaired links, in its own
    thread; a context manager.

    ``operator`` gets the robot's datagrams. The direction to the operator has the given
    random seed, the other one the next. ``prepare`` is called first in the thread: it
    gives the thread the priority of the sound, as a busy machine delays no real
    network.
    """

    def __init__(
        self,
        operator: Address,
        profile: NetworkProfile,
        *,
        seed: int = 0,
        prepare: Callable[[], object] = lambda: None,
    ) -> None:
        self._operator = operator
        self._prepare = prepare
        self._robot: Address | None = None
        self._to_operator = ImpairedLink(profile, seed=seed)
        self._to_robot = ImpairedLink(profile, seed=seed + 1)
        self._robot_side = UdpSocket("127.0.0.1", 0)
        self._operator_side = UdpSocket("127.0.0.1")
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=self.run, name="impairment-proxy", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._robot_side.close()
        self._operator_side.close()

    @property
    def address(self) -> Address:
        return self._robot_side.address

    def run(self) -> None:
        """Forward until the context ends."""
        self._prepare()
        while not self._stop.is_set():
            self._forward(time.monotonic())

    def _forward(self, now: float) -> None:
        due = min(self._to_operator.next_due, self._to_robot.next_due)
        wait = max(0.0, min(due - now, _MAX_WAIT))
        select.select([self._robot_side, self._operator_side], [], [], wait)
        now = time.monotonic()
        for datagram, source in self._robot_side.receive(0):
            self._robot = source
            self._to_operator.push(datagram, now=now)
        for datagram, _ in self._operator_side.receive(0):
            self._to_robot.push(datagram, now=now)
        self._operator_side.send(
            (datagram, self._operator) for datagram in self._to_operator.pull(now)
        )
        back = self._to_robot.pull(now)
        if self._robot is not None:
            self._robot_side.send([(datagram, self._robot) for datagram in back])
