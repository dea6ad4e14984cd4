"""The robot's end of the link to several operators: one encoder, and a session with each."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from tactophone.link.block_encoder import BlockEncoder
from tactophone.link.codec import Codec
from tactophone.link.events import Connected, Disconnected, Event
from tactophone.link.packetizer import RedundancyRule
from tactophone.link.send_session import Datagrams, SendSession
from tactophone.link.session import Session
from tactophone.types import AudioBlock, Prediction

MOST_OPERATORS = 4
"""Operators of one robot: trainer, trainee and two who watch. Each one more costs the robot an encryption a packet."""


class SendGroup:
    """Sends the same sound or predictions to up to `MOST_OPERATORS` operators.

    The sound is encoded once. Everything else is each operator's own: handshake, keys, packet numbers, redundancy,
    reports, faults. So what one operator sends, loses or leaves out changes nothing for the others, with one exception:
    the first request for a larger bandwidth than before restarts the encoder. Each session calls another address;
    ``rule`` is as of `SendSession`, ``prompt`` as of `BlockEncoder`. With ``follow`` the bandwidth
    follows the operators' requests.

    Attributes
    ----------
    members
        The session with each operator, in the order given. Whoever owns the operators' sockets passes what arrives to
        `receive`, calls `poll`, and sends what a member has to send.
    tap
        Called with what a log of this end needs: the packets to one connected operator, the first that there is.
    """

    def __init__(
        self,
        sessions: Sequence[Session],
        codec: Codec,
        *,
        rule: RedundancyRule | None = None,
        follow: bool = False,
        prompt: bool = False,
    ) -> None:
        if not 1 <= len(sessions) <= MOST_OPERATORS:
            raise ValueError(f"{len(sessions)} operators, but a robot has 1 to {MOST_OPERATORS}")
        self._encoder, self._follow = BlockEncoder(codec, prompt=prompt), follow
        self.members = [SendSession(each, self._encoder, rule=rule) for each in sessions]
        self.tap: Callable[[Event], None] = _ignore
        self._sound_faults = 0
        self._lowers = True
        self._logged: int | None = None
        self._begun: dict[int, Connected] = {}
        for number, member in enumerate(self.members):
            member.tap = partial(self._log, number)
            member.session.leave_to_others(partial(self._is_taken, number))

    @property
    def codec(self) -> Codec:
        """How the sound is encoded."""
        return self._encoder.codec

    @property
    def missing(self) -> int:
        """Samples of sound until the next packet is complete."""
        return self._encoder.missing

    @property
    def connected(self) -> list[SendSession]:
        """The sessions with operators that are connected."""
        return [member for member in self.members if member.peer is not None]

    @property
    def peers(self) -> list[str]:
        """Names of the connected operators."""
        return [member.peer for member in self.members if member.peer is not None]

    @property
    def counters(self) -> Counter[str]:
        """Totals of all sessions, in telemetry's names."""
        totals = Counter(sound_faults=self._sound_faults)
        for member in self.members:
            totals.update(member.counters)
        return totals

    @property
    def round_trip(self) -> float | None:
        """The longest round-trip time of all connected operators in s; ``None`` before the first report."""
        return max((member.round_trip for member in self.connected if member.round_trip is not None), default=None)

    @property
    def loss(self) -> float:
        """The greatest share of packets lost of all connected operators, by their newest reports."""
        return max((member.loss for member in self.connected), default=0.0)

    @property
    def origin(self) -> int | None:
        """The RTP timestamp of the source's first sample, at every operator; ``None`` while nobody is connected."""
        return self._encoder.origin if self.connected else None

    def push(self, block: AudioBlock) -> None:
        """Encode sound, and send it to all connected operators; it is dropped while there is none."""
        connected = self.connected
        if not connected:
            return
        encoded = self._encoder.push(block)
        for member in connected:
            member.send_encoded(encoded)
        self._sound_faults += bool(self._encoder.faults)
        self._encoder.faults.clear()

    def send_prediction(self, prediction: Prediction) -> None:
        """Send a prediction instead of sound."""
        for member in self.members:
            member.send_prediction(prediction)

    def send_hand(self, predictions: Mapping[int, Prediction], *, fingers: int) -> None:
        """Send predictions by finger, of windows that end together, instead of a hand's sound."""
        for member in self.members:
            member.send_hand(predictions, fingers=fingers)

    def receive(self, operator: int, datagrams: Datagrams, *, now: float) -> list[Connected | Disconnected]:
        """Process what arrived at one operator's socket by ``now`` (s)."""
        return self._follow_changes(operator, self.members[operator].receive(datagrams, now=now))

    def poll(self, operator: int, now: float) -> list[Connected | Disconnected]:
        """Let time pass for one operator; call it about twenty times a second for each."""
        return self._follow_changes(operator, self.members[operator].poll(now))

    def hang_up(self) -> None:
        """Send a goodbye to each operator."""
        for member in self.members:
            member.session.hang_up()

    def _follow_changes(self, operator: int, events: list[Connected | Disconnected]) -> list[Connected | Disconnected]:
        member = self.members[operator]
        alone = self.connected == [member]
        if alone and any(isinstance(event, Connected) for event in events):
            # Whoever comes later begins in the middle, as after a loss: a new beginning would disturb the others.
            self._encoder.reset()
            self._lowers = True
        requested, used = member.bandwidth, self.codec.bandwidth
        if self._follow and requested and member.peer and (requested > used or (alone and self._lowers)):
            self._lowers = False
            if requested != used:
                self._encoder.recode(self.codec.for_bandwidth(requested))
        return events

    def _is_taken(self, operator: int, fingerprint: str) -> bool:
        """Whether another member has the operator of this certificate: it was given under two addresses."""
        others = (member for number, member in enumerate(self.members) if number != operator)
        return any(member.session.claims(fingerprint) for member in others)

    def _log(self, operator: int, event: Event) -> None:
        """Pass on one connected operator's events, and when it leaves those of the next, as a connection of its own."""
        if isinstance(event, Connected):
            self._begun[operator] = event
            self._logged = operator if self._logged is None else self._logged
        if operator != self._logged:
            return
        self.tap(event)
        if isinstance(event, Disconnected):
            self._logged = next((number for number, member in enumerate(self.members) if member.peer is not None), None)
            if self._logged is not None:
                self.tap(self._begun[self._logged])


def _ignore(event: Event) -> None:
    """Log nothing."""
