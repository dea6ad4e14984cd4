"""The robot's end of the link: one encoder, and a session with each of one or more
operators. No socket, no clock."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TypeAlias

from tactophone.core.errors import PacketError
from tactophone.core.types import MOST_OPERATORS, AudioBlock, Prediction, ignore
from tactophone.net.link.codec import NARROW_BAND, Codec, band_of
from tactophone.net.link.events import (
    Connected,
    Disconnected,
    Event,
    PacketReceived,
    Renewed,
)
from tactophone.net.link.packet import CLOCK_RATE, Address, Packet, write_predictions
from tactophone.net.link.rtcp import (
    ReceiverReport,
    ReceiverRequest,
    parse_report,
    round_trip_time,
)
from tactophone.net.link.session import Session
from tactophone.net.link.stream import (
    BlockEncoder,
    Packetizer,
    Redundancy,
    RedundancyRule,
)

REPORT_INTERVAL = 0.2
"""Seconds between reports, both ways: a fifth of the time after which a silent operator
is called again."""

WIDENING_PAUSE = 10.0
"""Seconds after a widening of the band in which only an operator that has just come in
may widen it further."""

Datagrams: TypeAlias = Iterable[tuple[bytes, Address]]


class Member:
    """One operator of a group: its session and stream, and what its reports say.

    - ``stream``: makes the packets of the connection; ``None`` without a connection.
    - ``counters``: in telemetry's names: ``packets_sent``, ``handshakes``,
      ``link_losses``, ``packets_broken``.
    - ``bandwidth``: what the operator has requested, in Hz; 0 before its first request.
    - ``new``: whether no request of this connection has widened the band yet.
    - ``round_trip``: round-trip time in s, by the newest report; ``None`` before the
      first.
    - ``loss``: share of packets lost, by the newest report.
    """

    def __init__(self, session: Session, rule: RedundancyRule) -> None:
        self.session = session
        self.stream: Packetizer | None = None
        self.redundancy = Redundancy(rule)
        self.counters: Counter[str] = Counter()
        self.bandwidth = self.loss = 0.0
        self.new = True
        self.round_trip: float | None = None
        self.next_report = 0.0
        self.begun: Connected | None = None


class SendGroup:
    """Sends the same sound or predictions to 1 to `MOST_OPERATORS` operators.

    The sound is encoded once. Everything else is each operator's own: handshake, keys,
    packet numbers, redundancy, reports, faults. So what one operator sends, loses or
    leaves out changes nothing for the others, with one exception: with ``follow`` the
    band follows the operators' requests. It changes without a step in anybody's sound,
    and while several listen it only widens, which Opus permits three times. Each
    session calls another address; ``prompt`` means the same as for `BlockEncoder`.

    - ``members``: one for each session, in the order given. Whoever owns the operators'
      sockets passes what arrives to `receive`, calls `poll`, and sends what each
      session has to send.
    - ``tap``: called with what a log of this end needs: each connection made or lost,
      and each packet before it is encrypted. It follows one operator, the first that
      is connected.
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
            raise ValueError(
                f"{len(sessions)} operators, but a robot has 1 to {MOST_OPERATORS}"
            )
        self.encoder = BlockEncoder(codec, prompt=prompt)
        self._follow = follow
        self.members = [
            Member(session, rule or RedundancyRule()) for session in sessions
        ]
        self.tap: Callable[[Event], None] = ignore
        self._sound_faults = 0
        self._lowers = True
        self._next_widening = -math.inf
        self._logged: Member | None = None
        for member in self.members:
            # An operator that was given under two addresses belongs to one member
            # alone.
            member.session.leave_to_others(
                [other.session for other in self.members if other is not member]
            )

    @property
    def connected(self) -> list[Member]:
        return [member for member in self.members if member.stream]

    @property
    def peers(self) -> list[str]:
        return [
            member.session.peer
            for member in self.members
            if member.session.peer is not None
        ]

    @property
    def counters(self) -> Counter[str]:
        """Totals of all operators, in telemetry's names."""
        totals = Counter(sound_faults=self._sound_faults)
        for member in self.members:
            totals.update(member.counters)
        return totals

    @property
    def round_trip(self) -> float | None:
        """The longest round-trip time of all connected operators in s; ``None`` before
        the first report."""
        return max(
            (
                member.round_trip
                for member in self.connected
                if member.round_trip is not None
            ),
            default=None,
        )

    @property
    def loss(self) -> float:
        """The greatest share of packets lost of all connected operators, by their
        newest reports."""
        return max((member.loss for member in self.connected), default=0.0)

    @property
    def narrowed(self) -> str:
        """Which band is sent where an operator's model hears a wider one that fits no
        datagram; one line for the user, empty if none does."""
        if not self._follow:
            return ""
        codec = self.encoder.codec
        wanted = max((band_of(each.bandwidth) for each in self.connected), default=0)
        fitting = codec.for_bandwidth(wanted).bandwidth
        if codec.name == "pcm16" or fitting >= wanted:
            return ""
        duration = 1000 * codec.packet_size / CLOCK_RATE
        return (
            f"sound up to {fitting / 1000:g} kHz is sent, but an operator's model "
            f"hears up to {wanted / 1000:g} kHz, which packets of {duration:g} ms "
            f"cannot hold with {codec.channels} channels; choose a shorter "
            "--packet-duration"
        )

    @property
    def origin(self) -> int | None:
        """The RTP timestamp of the source's first sample, at every operator; ``None``
        while nobody is connected."""
        return self.encoder.origin if self.connected else None

    def push(self, block: AudioBlock) -> None:
        """Encode sound, and send it to all connected operators; with none it is
        dropped: later it is stale."""
        if not self.connected:
            return
        encoded = self.encoder.push(block)
        for member in self.members:
            if member.stream:
                self._send(member, list(map(member.stream.packet, encoded)))
        self._sound_faults += bool(self.encoder.faults)
        self.encoder.faults.clear()

    def send_predictions(
        self, predictions: Mapping[int, Prediction], *, fingers: int = 1
    ) -> None:
        """Send predictions by finger, of windows that end together, instead of
        sound."""
        end = round(next(iter(predictions.values())).end * CLOCK_RATE)
        kind, content = write_predictions(predictions, fingers=fingers)
        for member in self.members:
            if member.stream:
                self._send(member, [member.stream.wrap(kind, end, content)])

    def receive(
        self, datagrams: Datagrams, *, now: float, operator: int = 0
    ) -> list[Connected | Disconnected]:
        """Process what arrived at one operator's socket by ``now`` (s)."""
        member = self.members[operator]
        received = [
            member.session.receive(data, source=source, now=now)
            for data, source in datagrams
        ]
        return self._handle_safely(
            member, [event for events in received for event in events], now
        )

    def poll(self, now: float, *, operator: int = 0) -> list[Connected | Disconnected]:
        """Let time pass for one operator; call it about twenty times a second for
        each."""
        member = self.members[operator]
        if member.stream and now >= member.next_report:
            member.next_report = now + REPORT_INTERVAL
            member.session.send(bytes(member.stream.report(now)))
        return self._handle_safely(member, member.session.poll(now), now)

    def hang_up(self) -> None:
        for member in self.members:
            member.session.hang_up()

    def _send(self, member: Member, packets: list[Packet]) -> None:
        member.counters["packets_sent"] += len(packets)
        for packet in map(bytes, packets):
            if member is self._logged:
                self.tap(PacketReceived(packet, report=False))
            member.session.send(packet)

    def _handle_safely(
        self, member: Member, events: list[Event], now: float
    ) -> list[Connected | Disconnected]:
        try:
            return self._handle(member, events, now)
        except Exception as error:
            # Nothing that one operator sends ends the robot of the others: whatever an
            # authentic packet made our code raise ends the session of its sender.
            return self._handle(member, member.session.contain(error, now=now), now)

    def _handle(
        self, member: Member, events: list[Event], now: float
    ) -> list[Connected | Disconnected]:
        for event in events:
            match event:
                case PacketReceived(packet, report):
                    if report:
                        self._handle_report(member, packet, now)
                    continue
                case Connected():
                    member.begun = event
                    member.bandwidth = 0.0
                    member.new = True
                    member.stream = Packetizer(
                        self.encoder,
                        ssrc=event.local_ssrc,
                        redundancy=member.redundancy,
                    )
                    member.counters["handshakes"] += 1
                    if self.connected == [member]:
                        # Whoever comes later begins in the middle, as after a loss: a
                        # restart would disturb the others.
                        self.encoder.reset()
                        self._lowers = True
                case Disconnected():
                    member.stream = None
                    member.counters["link_losses"] += 1
                case Renewed():
                    # The stream runs on under another SSRC: sequence numbers and
                    # timestamps continue.
                    member.counters["handshakes"] += 1
                    if member.stream:
                        member.stream.ssrc = event.local_ssrc
            self._log(member, event)
        self._follow_request(member, now)
        return [
            event for event in events if isinstance(event, Connected | Disconnected)
        ]

    def _handle_report(self, member: Member, packet: bytes, now: float) -> None:
        try:
            report = parse_report(packet)
        except PacketError:
            member.counters["packets_broken"] += 1
            return
        if isinstance(report, ReceiverRequest):
            member.bandwidth = max(report.bandwidth, NARROW_BAND)
        elif isinstance(report, ReceiverReport):
            member.loss = report.fraction_lost
            member.redundancy.update(report.fraction_lost)
            member.round_trip = round_trip_time(report, now=now)

    def _follow_request(self, member: Member, now: float) -> None:
        """Encode with the band that an operator requests, as far as others permit."""
        if not (self._follow and member.bandwidth and member.stream):
            return
        codec = self.encoder.codec.for_bandwidth(member.bandwidth)
        used = band_of(self.encoder.codec.bandwidth)
        if codec.bandwidth > used and (member.new or now >= self._next_widening):
            # Whoever has just come in need not wait for an earlier widening.
            self.encoder.adapt(codec)
            self._next_widening = now + WIDENING_PAUSE
            member.new = self._lowers = False
        elif self._lowers and self.connected == [member]:
            # To a narrower band only once, and for an operator that is alone: others
            # may need what it does not.
            self._lowers = False
            if codec.bandwidth < used:
                self.encoder.adapt(codec)

    def _log(self, member: Member, event: Event) -> None:
        """Pass on one connected operator's events; when it leaves, pass on the next
        one's, as a connection of its own."""
        # One operator is followed at a time: a log is one session, which can be
        # repeated.
        if isinstance(event, Connected) and self._logged is None:
            self._logged = member
        if member is not self._logged:
            return
        self.tap(event)
        if isinstance(event, Disconnected):
            self._logged = next(iter(self.connected), None)
            if self._logged and self._logged.begun:
                self.tap(self._logged.begun)
