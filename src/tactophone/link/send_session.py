"""The robot's end of the line, whole: session, stream and reports together, still without socket or clock."""

from collections import Counter
from collections.abc import Iterable
from typing import TypeAlias

from tactophone.errors import PacketError
from tactophone.link.codec import NARROW_BAND, Codec
from tactophone.link.handshake import Address
from tactophone.link.packet import CLOCK_RATE, Packet, PayloadType
from tactophone.link.packetizer import Packetizer, Redundancy, RedundancyRule
from tactophone.link.prediction_payload import write_prediction
from tactophone.link.rtcp import ReceiverReport, ReceiverRequest, parse_report, round_trip
from tactophone.link.session import Connected, Disconnected, Event, PacketReceived, Session
from tactophone.types import AudioBlock, Prediction

REPORT_INTERVAL = 0.2
"""Seconds between reports, both ways: a fifth of the time after which a silent operator is called again."""

Datagrams: TypeAlias = Iterable[tuple[bytes, Address]]


class SendSession:
    """The robot's end: takes sound or belief, and the operator's reports.

    Parameters
    ----------
    rule
        Of redundancy.
    follow
        Whether the bandwidth follows what the operator's model makes use of.

    Attributes
    ----------
    counters
        In telemetry's names: ``packets_sent``, ``handshakes``, ``link_losses``, ``sound_faults``.
    round_trip
        Seconds there and back by the newest report; ``None`` before the first.
    """

    def __init__(
        self, session: Session, codec: Codec, *, rule: RedundancyRule | None = None, follow: bool = False
    ) -> None:
        self.session, self.codec, self._follow = session, codec, follow
        self.redundancy = Redundancy(rule or RedundancyRule())
        self.counters: Counter[str] = Counter()
        self.round_trip: float | None = None
        self.loss = 0.0
        self._departure: Packetizer | None = None
        self._next_report = 0.0

    @property
    def latency(self) -> float:
        """Seconds that coding adds at worst: a packet's length and the codec's look-ahead."""
        return self.codec.latency

    @property
    def origin(self) -> int | None:
        """The timestamp on the wire of the source's first sample; ``None`` while nobody is connected."""
        return self._departure.origin if self._departure else None

    def push(self, block: AudioBlock) -> None:
        """Send sound; while nobody is connected it is dropped, as it would be stale by then."""
        if self._departure:
            self._send(self._departure.push(block))
            self.counters["sound_faults"] += bool(self._departure.faults)
            self._departure.faults.clear()

    def tell(self, prediction: Prediction) -> None:
        """Send a belief in place of the sound."""
        if self._departure:
            end = round(prediction.end * CLOCK_RATE)
            self._send([self._departure.wrap(PayloadType.BELIEF, end, write_prediction(prediction))])

    def receive(self, datagrams: Datagrams, *, now: float) -> list[Connected | Disconnected]:
        """Take what came from the network."""
        return self._note([event for datagram, source in datagrams for event in self._open(datagram, source, now)], now)

    def poll(self, now: float) -> list[Connected | Disconnected]:
        """Let time pass; call it some twenty times a second."""
        if self._departure and now >= self._next_report:
            self._next_report = now + REPORT_INTERVAL
            self.session.send(bytes(self._departure.report(now)))
        return self._note(self.session.poll(now), now)

    def outgoing(self) -> list[tuple[bytes, Address]]:
        """Hand over the datagrams to send, and where to."""
        return self.session.outgoing()

    def _open(self, datagram: bytes, source: Address, now: float) -> list[Event]:
        return self.session.receive(datagram, source=source, now=now)

    def _send(self, packets: list[Packet]) -> None:
        self.counters["packets_sent"] += len(packets)
        for packet in packets:
            self.session.send(bytes(packet))

    def _note(self, events: list[Event], now: float) -> list[Connected | Disconnected]:
        for event in events:
            match event:
                case Connected():
                    self._departure = Packetizer(self.codec, ssrc=event.local_ssrc, redundancy=self.redundancy)
                    self.counters["handshakes"] += 1
                case Disconnected():
                    self._departure = None
                    self.counters["link_losses"] += 1
                case PacketReceived(packet, report=True):
                    self._hear(packet, now)
        return [event for event in events if not isinstance(event, PacketReceived)]

    def _hear(self, packet: bytes, now: float) -> None:
        try:
            report = parse_report(packet)
        except PacketError:
            self.counters["packets_broken"] += 1
            return
        if isinstance(report, ReceiverRequest):
            self._fulfil(report)
        elif isinstance(report, ReceiverReport):
            self.loss = report.fraction_lost
            self.redundancy.hear(report.fraction_lost)
            self.round_trip = round_trip(report, now=now)

    def _fulfil(self, wish: ReceiverRequest) -> None:
        bandwidth = max(wish.bandwidth, NARROW_BAND)
        if self._follow and self._departure and bandwidth != self.codec.bandwidth:
            self.codec = self.codec.for_bandwidth(bandwidth)
            self._departure.recode(self.codec)
