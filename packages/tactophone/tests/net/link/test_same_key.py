"""Two machines with one key, as after a copied disk: the first to connect stays, and
the other learns why."""

from tactophone.net.link.events import Connected, PacketReceived
from tactophone.net.link.identity import Peers
from tactophone.net.link.rtcp import ReceiverReport
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import (
    ALIVE,
    BUSY_PAUSE,
    SAME_KEY,
    SESSION_TIMEOUT,
    Session,
)

from .session_pair import AT_OPERATOR, OPERATOR, ROBOT, answering, calling
from .test_send import OPUS

AT_ROBOTS = [("192.0.2.1", 5_000), ("192.0.2.11", 5_000)]
AT_OPERATORS = [("192.0.2.2", 6_000), ("192.0.2.12", 6_000)]
STEP = 0.02


def speak(session: Session) -> None:
    """Send a report, as each end does several times a second."""
    if current := session._keys.current:
        ssrc = current.agreement.secrets.local_ssrc
        session.send(bytes(ReceiverReport(ssrc, 1, 0.0, 0, 0, 0.0)))


class TwoRobots:
    """An operator and two robots of one key, in virtual time."""

    def __init__(self) -> None:
        self.operator = answering()
        self.robots = [calling(), calling()]
        self.now = 0.0
        self.at_operator: list[object] = []

    def run(self, seconds: float, *, of: tuple[int, ...] = (0, 1)) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            self.operator.poll(self.now)
            speak(self.operator)
            for number in of:
                self.robots[number].poll(self.now)
                speak(self.robots[number])
            self._exchange(of)

    def _exchange(self, of: tuple[int, ...]) -> None:
        for _ in range(8):
            for number in of:
                for datagram, _ in self.robots[number].outgoing():
                    self.at_operator += self.operator.receive(
                        datagram, source=AT_ROBOTS[number], now=self.now
                    )
            for datagram, target in self.operator.outgoing():
                number = AT_ROBOTS.index(target)
                if number in of:
                    self.robots[number].receive(
                        datagram, source=AT_OPERATOR, now=self.now
                    )


def test_of_two_robots_with_one_key_the_first_is_felt_and_the_second_learns_why() -> (
    None
):
    call = TwoRobots()
    call.run(1.0, of=(0,))
    begun = call.at_operator.copy()
    call.run(10.0)
    since = call.at_operator[len(begun) :]
    assert sum(isinstance(event, Connected) for event in begun) == 1
    assert {type(event) for event in since} == {PacketReceived}
    assert call.robots[0].peer == "operator"
    assert (call.robots[1].peer, call.robots[1].failure) == (None, SAME_KEY)
    assert call.operator.sent_away is not None
    assert call.operator.sent_away[0] == "robot"


def test_the_second_robot_takes_over_once_the_first_is_gone() -> None:
    call = TwoRobots()
    call.run(1.0)
    first = 0 if call.robots[0].peer else 1
    call.run(ALIVE + BUSY_PAUSE + 0.5, of=(1 - first,))
    assert call.robots[1 - first].peer == "operator"


def test_a_robot_that_starts_again_from_another_port_is_connected_at_once() -> None:
    call = TwoRobots()
    call.run(1.0, of=(0,))
    call.now += ALIVE
    call.run(0.1, of=(1,))
    assert call.robots[1].peer == "operator"


def test_of_two_operators_with_one_key_one_gets_the_sound_and_both_ends_say_why() -> (
    None
):
    trusted = Peers({OPERATOR.fingerprint: "operator"})
    group = SendGroup(
        [Session(ROBOT, trusted, call=address) for address in AT_OPERATORS], OPUS
    )
    operators = [answering(), answering()]
    connections = [0, 0]

    def run(begin: float, end: float, *, of: tuple[int, ...] = (0, 1)) -> None:
        """Let time pass, with a path to some of the operators."""
        for step in range(round(begin / STEP), round(end / STEP)):
            now = step * STEP
            for number, operator in enumerate(operators):
                group.poll(now, operator=number)
                operator.poll(now)
                speak(operator)
            for number in (0, 1) * 8:
                session, operator = group.members[number].session, operators[number]
                to_operator, to_robot = session.outgoing(), operator.outgoing()
                if number not in of:
                    continue
                for datagram, _ in to_operator:
                    events = operator.receive(datagram, source=AT_ROBOTS[0], now=now)
                    connections[number] += any(
                        isinstance(event, Connected) for event in events
                    )
                group.receive(
                    [(datagram, AT_OPERATORS[number]) for datagram, _ in to_robot],
                    now=now,
                    operator=number,
                )

    run(0.0, 1.0, of=(0,))
    run(1.0, 10.0)
    assert connections == [1, 0]
    assert group.peers == ["operator"]
    assert "give each machine its own key" in (group.members[1].session.failure or "")
    assert "another machine uses the same key" in (operators[1].failure or "")
    run(10.0, 10.0 + SESSION_TIMEOUT + BUSY_PAUSE + 0.5, of=(1,))
    assert operators[1].peer == "robot"
