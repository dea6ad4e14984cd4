"""Both ends of the line joined in virtual time: no socket, no thread, and hours in seconds."""

from dataclasses import dataclass, field

from tactophone.link import Codec, Identity, Peers, ReceiveEvent, ReceiveSession, RedundancyRule, SendSession, Session
from tactophone.simulation.network.impairments import ImpairedLine, NetworkProfile

ROBOT_ADDRESS, OPERATOR_ADDRESS = ("192.0.2.1", 5_000), ("192.0.2.2", 6_000)
"""Where the two would be; these hosts exist in documents alone (RFC 5737)."""

_LONGEST_HANDSHAKE = 10.0


def paired_ends(
    codec: Codec, *, rule: RedundancyRule | None = None, reorder: int = 1
) -> tuple[SendSession, ReceiveSession]:
    """Make a robot's and an operator's end that trust each other, with keys that nobody else ever sees."""
    robot, operator = Identity.create("robot"), Identity.create("operator")
    calling = Session(robot, Peers({operator.fingerprint: "operator"}), call=OPERATOR_ADDRESS)
    answering = Session(operator, Peers({robot.fingerprint: "robot"}))
    return SendSession(calling, codec, rule=rule), ReceiveSession(answering, reorder=reorder)


@dataclass
class VirtualLine:
    """A robot and an operator, and an impaired line each way.

    Parameters
    ----------
    there, back
        From the robot to the operator, and the other way.
    """

    robot: SendSession
    operator: ReceiveSession
    there: ImpairedLine = field(default_factory=lambda: ImpairedLine(NetworkProfile()))
    back: ImpairedLine = field(default_factory=lambda: ImpairedLine(NetworkProfile()))

    def connect(self, now: float) -> float:
        """Let them find each other; returns the time at which they have.

        Raises
        ------
        TimeoutError
            When they have not within ten seconds.
        """
        begun = now
        while self.operator.session.peer is None or self.robot.session.peer is None:
            self.carry(now)
            now += 0.005
            if now - begun > _LONGEST_HANDSHAKE:
                raise TimeoutError(f"no session within {_LONGEST_HANDSHAKE:g} s over {self.there}")
        return now

    def carry(self, now: float) -> list[ReceiveEvent]:
        """Let both ends and the line work until nothing more happens at ``now``; give what the operator heard."""
        self.robot.poll(now)
        news = self.operator.poll(now)
        while self._pass(now, news):
            pass
        return news

    def _pass(self, now: float, news: list[ReceiveEvent]) -> bool:
        for datagram, _ in self.robot.outgoing():
            self.there.push(datagram, now=now)
        for datagram, _ in self.operator.outgoing():
            self.back.push(datagram, now=now)
        to_operator = [(datagram, ROBOT_ADDRESS) for datagram in self.there.pull(now)]
        to_robot = [(datagram, OPERATOR_ADDRESS) for datagram in self.back.pull(now)]
        news += self.operator.receive(to_operator, now=now)
        self.robot.receive(to_robot, now=now)
        return bool(to_operator or to_robot)
