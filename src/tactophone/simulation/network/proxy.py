"""An impaired line between two real sockets: the robot calls the proxy in place of the operator."""

import select
import threading
import time
from types import TracebackType
from typing import Self

from tactophone.link import Endpoint, UdpSocket
from tactophone.simulation.network.impairments import ImpairedLine, NetworkProfile

_LONGEST_WAIT = 0.05


class ImpairmentProxy:
    """Relays datagrams both ways through two impaired lines, in a thread of its own, as a context manager.

    Parameters
    ----------
    operator
        Where the robot's datagrams go.
    profile
        Of each way.
    seed
        Of the way to the operator; the way back has the next.
    host, port
        Where the robot finds the proxy; port 0 lets the system choose.
    """

    def __init__(
        self, operator: Endpoint, profile: NetworkProfile, *, seed: int = 0, host: str = "127.0.0.1", port: int = 0
    ) -> None:
        self._operator = operator
        self._robot: Endpoint | None = None
        self._to_operator = ImpairedLine(profile, seed=seed)
        self._to_robot = ImpairedLine(profile, seed=seed + 1)
        self._robot_side = UdpSocket(host, port)
        self._operator_side = UdpSocket(host)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.run, name="impairment-proxy", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        self._robot_side.close()
        self._operator_side.close()

    @property
    def address(self) -> Endpoint:
        """Whom the robot calls."""
        return self._robot_side.address

    def run(self) -> None:
        """PassthroughRenderer until the context ends."""
        while not self._stop.is_set():
            self._relay(time.monotonic())

    def _relay(self, now: float) -> None:
        due = min(self._to_operator.next_due, self._to_robot.next_due)
        select.select([self._robot_side, self._operator_side], [], [], max(0.0, min(due - now, _LONGEST_WAIT)))
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
