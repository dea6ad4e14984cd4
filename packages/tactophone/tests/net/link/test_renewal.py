"""Keys are renewed beside the running session, without a gap in the stream; in virtual
time."""

import numpy as np
import pytest

from tactophone.core.types import AudioBlock, FloatArray
from tactophone.net.link.codec import Codec
from tactophone.net.link.events import Connected, Disconnected
from tactophone.net.link.identity import Peers
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.rtcp import ReceiverReport
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import (
    KEY_OVERLAP,
    MAX_KEY_AGE,
    RECALL_AFTER,
    RENEW_AFTER,
    Session,
)
from tactophone.net.link.stream import DecodedAudio

from .session_pair import AT_OPERATOR, AT_ROBOT, OPERATOR, ROBOT, SessionPair

PACKET = 240


class Stream:
    """A robot that sends a ramp of samples, and an operator that decodes it, with a
    delay of one packet each way."""

    def __init__(self, *, renew_after: float) -> None:
        peers = (
            Peers({OPERATOR.fingerprint: "operator"}),
            Peers({ROBOT.fingerprint: "robot"}),
        )
        caller = Session(ROBOT, peers[0], call=AT_OPERATOR, renew_after=renew_after)
        self.robot = SendGroup([caller], Codec("pcm16", packet_size=PACKET))
        self.operator = ReceiveSession(Session(OPERATOR, peers[1]))
        self.now, self.position = 0.0, 0
        self.events: list[object] = []
        self._lost = 0

    def lose(self, number: int) -> None:
        """Lose the next ``number`` handshake datagrams."""
        self._lost = number

    def run(self, seconds: float, *, packets: bool = True) -> None:
        for _ in range(round(seconds * 200)):
            self.now += PACKET / 48_000
            if packets and self.robot.peers:
                ramp = (
                    np.arange(self.position, self.position + PACKET) % 32_768
                ) / 32_768
                self.robot.push(
                    AudioBlock(
                        np.stack([ramp, ramp], 1).astype(np.float32),
                        48_000,
                        self.position,
                    )
                )
                self.position += PACKET
            self.robot.poll(self.now)
            self._exchange()
            self.events += self.operator.poll(self.now)

    def _exchange(self) -> None:
        for datagram, _ in self.robot.members[0].session.outgoing():
            if self._passes(datagram):
                self.events += self.operator.receive(
                    [(datagram, AT_ROBOT)], now=self.now
                )
        for datagram, _ in self.operator.session.outgoing():
            if self._passes(datagram):
                self.robot.receive([(datagram, AT_OPERATOR)], now=self.now)

    def _passes(self, datagram: bytes) -> bool:
        self._lost -= (lost := self._lost > 0 and 20 <= datagram[0] < 64)
        return not lost

    def sound(self) -> FloatArray:
        return np.concatenate(
            [
                event.block.samples[:, 0]
                for event in self.events
                if isinstance(event, DecodedAudio)
            ]
        )

    def keys(self) -> bytes:
        current = self.operator.session._keys.current
        assert current is not None
        return current.agreement.secrets.inbound


@pytest.mark.parametrize("lost", [0, 1, 4, 6, 7])
def test_renewed_keys_lose_no_sample(lost: int) -> None:
    stream = Stream(renew_after=2.0)
    stream.run(1.9)
    before = stream.keys()
    stream.lose(lost)
    stream.run(4.0)
    assert stream.keys() != before
    assert sum(isinstance(event, Connected) for event in stream.events) == 1
    assert not any(isinstance(event, Disconnected) for event in stream.events)
    sound = stream.sound()
    assert len(sound) >= stream.position - 2 * PACKET
    np.testing.assert_array_equal(
        sound, (np.arange(len(sound)) % 32_768 / 32_768).astype(np.float32)
    )
    assert stream.operator.stats.packets_lost == 0
    assert stream.operator.session.refused == 0
    assert (
        stream.operator.counters["handshakes"]
        == stream.robot.counters["handshakes"]
        >= 2
    )


def test_old_keys_are_refused_after_the_overlap() -> None:
    stream = Stream(renew_after=2.0)
    stream.run(1.9)
    old = stream.robot.members[0].session._keys.current
    assert old is not None
    stream.run(0.5)
    assert len(list(stream.operator.session._keys)) == 2
    stream.run(KEY_OVERLAP)
    # Two seconds later the next renewal may be under way, but the first keys are gone.
    assert old.agreement.secrets.local_ssrc not in [
        known.stream for known in stream.operator.session._keys
    ]


@pytest.mark.slow
def test_keys_are_renewed_every_eleven_hours_and_never_older_than_twelve() -> None:
    pair = SessionPair()
    pair.wait(0.2)
    assert RENEW_AFTER < MAX_KEY_AGE <= 12 * 3600
    # So the first long step below begins right after a report.
    for side in (pair.robot, pair.operator):
        side.send(report(side))
    pair.exchange()
    ages, keys = [], set()
    while pair.now < 23 * 3600:
        # Reports alone keep the session alive; a step just below the time after which
        # the robot would call again.
        for side in (pair.robot, pair.operator):
            assert side._keys.current is not None
            side.send(report(side))
        pair.wait(0.9 * RECALL_AFTER, step=0.9 * RECALL_AFTER)
        pair.exchange()
        assert pair.operator._keys.current is not None
        ages.append(pair.now - pair.operator._keys.current.begun)
        keys.add(pair.operator._keys.current.agreement.secrets.inbound)
    assert max(ages) < RENEW_AFTER + 10
    assert len(keys) == 3
    assert [
        event for event in pair.at_operator if isinstance(event, Disconnected)
    ] == []


def test_keys_that_cannot_be_renewed_end_the_session() -> None:
    pair = SessionPair()
    pair.wait(0.2)
    assert pair.operator._keys.current is not None
    pair.operator._keys.current.last_received = pair.now = MAX_KEY_AGE + 1
    assert pair.operator.poll(pair.now) == [
        Disconnected("the keys were not renewed in time")
    ]


def test_keys_are_not_renewed_shortly_before_the_sequence_wraps() -> None:
    stream = Stream(renew_after=1.0)
    stream.run(0.1)
    packetizer = stream.robot.members[0].stream
    assert packetizer is not None
    assert stream.robot.members[0].session._keys.current is not None
    packetizer._sequence = 0xFFFF - 300
    stream.events.clear()
    before = stream.keys()
    stream.run(1.4)
    assert stream.keys() == before
    stream.run(1.0)  # past the wrap
    assert stream.keys() != before


def report(session: Session) -> bytes:
    assert session._keys.current is not None
    return bytes(
        ReceiverReport(
            session._keys.current.agreement.secrets.local_ssrc, 1, 0.0, 0, 0, 0.0
        )
    )
