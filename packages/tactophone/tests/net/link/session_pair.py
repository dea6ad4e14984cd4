"""Two sessions joined in virtual time, without socket or clock; losses are a list of
booleans."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, repeat

from tactophone.net.link.events import Event
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.session import Session

ROBOT, OPERATOR, UNTRUSTED = (
    Identity.create(name) for name in ("robot", "operator", "untrusted")
)
AT_ROBOT, AT_OPERATOR = ("192.0.2.1", 5_000), ("192.0.2.2", 6_000)


def calling(identity: Identity = ROBOT, trusts: Identity = OPERATOR) -> Session:
    return Session(identity, Peers({trusts.fingerprint: trusts.name}), call=AT_OPERATOR)


def answering(identity: Identity = OPERATOR, trusts: Identity = ROBOT) -> Session:
    return Session(identity, Peers({trusts.fingerprint: trusts.name}))


@dataclass
class SessionPair:
    """Carries datagrams in both directions without delay; ``lost`` says for each in
    turn whether it is lost."""

    robot: Session = field(default_factory=calling)
    operator: Session = field(default_factory=answering)
    lost: Iterable[bool] = ()
    now: float = 0.0
    passed: list[bytes] = field(default_factory=list)
    at_robot: list[Event] = field(default_factory=list)
    at_operator: list[Event] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.lose(self.lost)

    def lose(self, lost: Iterable[bool]) -> None:
        self._losses: Iterator[bool] = chain(lost, repeat(False))

    def wait(self, seconds: float, *, step: float = 0.05) -> None:
        for _ in range(round(seconds / step)):
            self.now += step
            self.at_robot += self.robot.poll(self.now)
            self.at_operator += self.operator.poll(self.now)
            self.exchange()

    def exchange(self) -> None:
        while datagrams := [*self.robot.outgoing(), *self.operator.outgoing()]:
            for datagram, target in datagrams:
                self.passed.append(datagram)
                if next(self._losses):
                    continue
                if target == AT_OPERATOR:
                    self.at_operator += self.operator.receive(
                        datagram, source=AT_ROBOT, now=self.now
                    )
                elif target == AT_ROBOT:
                    self.at_robot += self.robot.receive(
                        datagram, source=AT_OPERATOR, now=self.now
                    )
