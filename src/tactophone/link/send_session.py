"""The robot's end of the link: session, stream and reports together, without socket or clock."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from typing import TypeAlias

from tactophone.errors import PacketError
from tactophone.link.block_encoder import BlockEncoder, EncodedSound
from tactophone.link.codec import NARROW_BAND
from tactophone.link.events import Connected, Disconnected, Event, PacketReceived, Renewed
from tactophone.link.handshake import Address
from tactophone.link.packet import CLOCK_RATE, Packet, PayloadType
from tactophone.link.packetizer import Packetizer, Redundancy, RedundancyRule
from tactophone.link.prediction_payload import write_hand, write_prediction
from tactophone.link.rtcp import ReceiverReport, ReceiverRequest, parse_report, round_trip
from tactophone.link.session import Session
from tactophone.types import AudioBlock, Prediction

REPORT_INTERVAL = 0.2
"""Seconds between reports, both ways: a fifth of the time after which a silent operator is called again."""

Datagrams: TypeAlias = Iterable[tuple[bytes, Address]]


class SendSession:
    """Sends sound or predictions, and evaluates the operator's reports.

    The encoder is of this session's sound; where others carry the same, their one encoder, which a `SendGroup` feeds.

    Attributes
    ----------
    counters
        In telemetry's names: ``packets_sent``, ``handshakes``, ``link_losses``, ``sound_faults``.
    bandwidth
        That the operator has requested, in Hz; 0 before it has.
    round_trip
        Round-trip time in s, by the newest report; ``None`` before the first.
    tap
        Called with each connection made or lost, and with each packet before it is encrypted, for a log.
    """

    def __init__(self, session: Session, encoder: BlockEncoder, *, rule: RedundancyRule | None = None) -> None:
        self.session, self._encoder = session, encoder
        self.bandwidth = 0.0
        self.redundancy = Redundancy(rule or RedundancyRule())
        self.counters: Counter[str] = Counter()
        self.round_trip: float | None = None
        self.loss = 0.0
        self.tap: Callable[[Event], None] = _ignore
        self._packetizer: Packetizer | None = None
        self._next_report = 0.0

    @property
    def peer(self) -> str | None:
        """Name of the connected operator; ``None`` while there is none."""
        return self.session.peer

    @property
    def origin(self) -> int | None:
        """The RTP timestamp of the source's first sample; ``None`` while nobody is connected."""
        return self._packetizer.origin if self._packetizer else None

    def push(self, block: AudioBlock) -> None:
        """Send sound; it is dropped while nobody is connected, as it would be stale later."""
        if self._packetizer:
            self._send(self._packetizer.push(block))
            self.counters["sound_faults"] += bool(self._encoder.faults)
            self._encoder.faults.clear()

    def send_encoded(self, encoded: Iterable[EncodedSound]) -> None:
        """Send what the encoder of several sessions has returned; it is dropped while nobody is connected."""
        if self._packetizer:
            self._send(list(map(self._packetizer.packet, encoded)))

    def send_prediction(self, prediction: Prediction) -> None:
        """Send a prediction instead of sound."""
        if self._packetizer:
            end = round(prediction.end * CLOCK_RATE)
            self._send([self._packetizer.wrap(PayloadType.PREDICTION, end, write_prediction(prediction))])

    def send_hand(self, predictions: Mapping[int, Prediction], *, fingers: int) -> None:
        """Send predictions by finger, of windows that end together, instead of a hand's sound."""
        if self._packetizer:
            end = round(next(iter(predictions.values())).end * CLOCK_RATE)
            content = write_hand(predictions, fingers=fingers)
            self._send([self._packetizer.wrap(PayloadType.HAND_PREDICTION, end, content)])

    def receive(self, datagrams: Datagrams, *, now: float) -> list[Connected | Disconnected]:
        """Process what arrived from the network by ``now`` (s)."""
        received = (self.session.receive(data, source=source, now=now) for data, source in datagrams)
        return self._handle([event for events in received for event in events], now)

    def poll(self, now: float) -> list[Connected | Disconnected]:
        """Let time pass; call it about twenty times a second."""
        if self._packetizer and now >= self._next_report:
            self._next_report = now + REPORT_INTERVAL
            self.session.send(bytes(self._packetizer.report(now)))
        return self._handle(self.session.poll(now), now)

    def outgoing(self) -> list[tuple[bytes, Address]]:
        """Return the datagrams to send, each with its address."""
        return self.session.outgoing()

    def _send(self, packets: list[Packet]) -> None:
        self.counters["packets_sent"] += len(packets)
        for packet in map(bytes, packets):
            self.tap(PacketReceived(packet, report=False))
            self.session.send(packet)

    def _handle(self, events: list[Event], now: float) -> list[Connected | Disconnected]:
        for event in events:
            if not isinstance(event, PacketReceived):
                self.tap(event)
            match event:
                case Connected():
                    self._packetizer = Packetizer(self._encoder, ssrc=event.local_ssrc, redundancy=self.redundancy)
                    self.bandwidth = 0.0
                    self.counters["handshakes"] += 1
                case Disconnected():
                    self._packetizer = None
                    self.counters["link_losses"] += 1
                case Renewed():
                    # The stream runs on under another SSRC: sequence numbers and timestamps continue.
                    self.counters["handshakes"] += 1
                    if self._packetizer:
                        self._packetizer.ssrc = event.local_ssrc
                case PacketReceived(packet, report=True):
                    self._handle_report(packet, now)
        return [event for event in events if isinstance(event, Connected | Disconnected)]

    def _handle_report(self, packet: bytes, now: float) -> None:
        try:
            report = parse_report(packet)
        except PacketError:
            self.counters["packets_broken"] += 1
            return
        if isinstance(report, ReceiverRequest):
            self.bandwidth = max(report.bandwidth, NARROW_BAND)
        elif isinstance(report, ReceiverReport):
            self.loss = report.fraction_lost
            self.redundancy.update(report.fraction_lost)
            self.round_trip = round_trip(report, now=now)


def _ignore(event: Event) -> None:
    """Log nothing."""
