"""Both ends of a link in virtual time: no socket, no thread, and hours simulated in
seconds."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.send import Datagrams, SendGroup
from tactophone.net.link.session import Session
from tactophone.net.link.stream import RedundancyRule

ROBOT_ADDRESS = ("192.0.2.1", 5_000)
"""The robot's address, from the range reserved for documentation (RFC 5737)."""

OPERATOR_ADDRESS = ("192.0.2.2", 6_000)
"""The operator's address, from the same range."""

_CONNECT_TIMEOUT = 10.0

T_co = TypeVar("T_co", covariant=True)
T = TypeVar("T")


class Receiver(Protocol[T_co]):
    """The operator's end: a `ReceiveSession`, or an `OperatorEndpoint` with its
    pipeline."""

    @property
    def session(self) -> "Session | ReceiveSession":
        """What opens its datagrams, and has those to send."""

    def receive(self, datagrams: Datagrams, *, now: float) -> Iterable[T_co]:
        """Process the datagrams that arrived."""

    def poll(self, now: float) -> Iterable[T_co]:
        """Let time pass."""


def paired_sessions(
    codec: Codec, *, rule: RedundancyRule | None = None, reorder: int = 1
) -> tuple[SendGroup, ReceiveSession]:
    """Make a robot's and an operator's session that trust each other, with fresh
    keys."""
    robot, operator = Identity.create("robot"), Identity.create("operator")
    calling = Session(
        robot, Peers({operator.fingerprint: "operator"}), call=OPERATOR_ADDRESS
    )
    answering = Session(operator, Peers({robot.fingerprint: "robot"}))
    return SendGroup([calling], codec, rule=rule), ReceiveSession(
        answering, reorder=reorder
    )


@dataclass
class VirtualLink(Generic[T]):
    """A robot and an operator with an impaired link each way."""

    robot: SendGroup
    operator: Receiver[T]
    """Its session alone, or its whole endpoint; `carry` returns what that returns."""
    to_operator: ImpairedLink = field(
        default_factory=lambda: ImpairedLink(NetworkProfile())
    )
    to_robot: ImpairedLink = field(
        default_factory=lambda: ImpairedLink(NetworkProfile())
    )
    """`to_operator` and `to_robot`: the two directions of the link."""
    number: int = 0
    """Which of the robot's operators this one is."""

    @property
    def _session(self) -> Session:
        return self.robot.members[self.number].session

    @property
    def _answering(self) -> Session:
        session = self.operator.session
        return session if isinstance(session, Session) else session.session

    def connect(self, now: float) -> float:
        """Let both ends connect; return the time at which they have.

        Raises `TimeoutError` when they have not connected within ten seconds.
        """
        begun = now
        while self._answering.peer is None or self._session.peer is None:
            self.carry(now)
            now += 0.005
            if now - begun > _CONNECT_TIMEOUT:
                raise TimeoutError(
                    f"no session within {_CONNECT_TIMEOUT:g} s over {self.to_operator}"
                )
        return now

    def carry(self, now: float) -> list[T]:
        """Run both ends and the link until nothing more happens at ``now``; return what
        the operator received."""
        self.robot.poll(now, operator=self.number)
        received = list(self.operator.poll(now))
        while self._pass(now, received):
            pass
        return received

    def _pass(self, now: float, received: list[T]) -> bool:
        for datagram, _ in self._session.outgoing():
            self.to_operator.push(datagram, now=now)
        for datagram, _ in self._answering.outgoing():
            self.to_robot.push(datagram, now=now)
        to_operator = [
            (datagram, ROBOT_ADDRESS) for datagram in self.to_operator.pull(now)
        ]
        to_robot = [
            (datagram, OPERATOR_ADDRESS) for datagram in self.to_robot.pull(now)
        ]
        received += self.operator.receive(to_operator, now=now)
        self.robot.receive(to_robot, now=now, operator=self.number)
        return bool(to_operator or to_robot)
