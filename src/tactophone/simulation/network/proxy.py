"""An impaired link between two real sockets: the robot calls the proxy instead of the operator."""

import select
import threading
import time
from collections.abc import Callable
from typing import Self

from tactophone.link import Address, UdpSocket
from tactophone.simulation.network.impairments import ImpairedLink, NetworkProfile

_MAX_WAIT = 0.05


class ImpairmentProxy:
    """Forwards datagrams in both directions through two impaired links, in its own thread; a context manager.

    Parameters
    ----------
    operator
        Destination of the robot's datagrams.
    profile
        Of each direction.
    seed
        Random seed of the direction to the operator; the other direction uses the next.
    host, port
        Address for the robot; port 0 lets the system choose.
    prepare
        Called first in the thread: to give it the priority of the sound, as a busy machine delays no real network.
    """

    def __init__(
        self,
        operator: Address,
        profile: NetworkProfile,
        *,
        seed: int = 0,
        host: str = "127.0.0.1",
        port: int = 0,
        prepare: Callable[[], object] = lambda: None,
    ) -> None:
        self._operator, self._prepare = operator, prepare
        self._robot: Address | None = None
        self._to_operator = ImpairedLink(profile, seed=seed)
        self._to_robot = ImpairedLink(profile, seed=seed + 1)
        self._robot_side = UdpSocket(host, port)
        self._operator_side = UdpSocket(host)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.run, name="impairment-proxy", daemon=True)

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
        """The address for the robot to call."""
        return self._robot_side.address

    def run(self) -> None:
        """Forward until the context ends."""
        self._prepare()
        while not self._stop.is_set():
            self._forward(time.monotonic())

    def _forward(self, now: float) -> None:
        due = min(self._to_operator.next_due, self._to_robot.next_due)
        select.select([self._robot_side, self._operator_side], [], [], max(0.0, min(due - now, _MAX_WAIT)))
        now = time.monotonic()
        for datagram, source in self._robot_side.receive(0):
            self._robot = source
            self._to_operator.push(datagram, now=now)
        for datagram, _ in self._operator_side.receive(0):
            self._to_robot.push(datagram, now=now)
        self._operator_side.send((datagram, self._operator) for datagram in self._to_operator.pull(now))
        back = self._to_robot.pull(now)
        if self._robot is not None:
            self._robot_side.send([(datagram, self._robot) for datagram in back])
