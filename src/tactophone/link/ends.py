"""The two ends of the line, whole: sealed session, stream and reports together, still without socket or clock."""

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

from tactophone.errors import PacketError
from tactophone.link.arrival import STALENESS, Arrival, Heard
from tactophone.link.belief import read_belief, write_belief
from tactophone.link.codec import Codec
from tactophone.link.departure import Departure, Redundancy, RedundancyRule
from tactophone.link.handshake import Address
from tactophone.link.packet import CLOCK_RATE, Packet, PayloadType, ahead, parse
from tactophone.link.report import ReceiverReport, SenderReport, parse_report, round_trip
from tactophone.link.session import Arrived, Connected, Disconnected, Event, Session
from tactophone.link.stats import StreamStats
from tactophone.link.transit import Envelope
from tactophone.types import AudioBlock, Prediction

REPORT_INTERVAL = 0.2
"""Seconds between reports: a fifth of the time after which a silent operator is called again."""

DATAGRAM_OVERHEAD = 28
"""Bytes that IPv4 and UDP add to each datagram."""

Datagrams: TypeAlias = Iterable[tuple[bytes, Address]]


@dataclass(frozen=True, slots=True)
class Believed:
    """A prediction that the robot made, and whether it is too old to be felt."""

    prediction: Prediction
    stale: bool = False


class SendingEnd:
    """The robot's end: takes sound or belief, and the operator's reports.

    Attributes
    ----------
    counters
        In telemetry's names: ``packets_sent``, ``handshakes``, ``link_losses``, ``sound_faults``.
    round_trip
        Seconds there and back by the newest report; ``None`` before the first.
    """

    def __init__(self, session: Session, codec: Codec, *, rule: RedundancyRule | None = None) -> None:
        self.session, self.codec = session, codec
        self.redundancy = Redundancy(rule or RedundancyRule())
        self.counters: Counter[str] = Counter()
        self.round_trip: float | None = None
        self.loss = 0.0
        self._departure: Departure | None = None
        self._next_report = 0.0

    @property
    def latency(self) -> float:
        """Seconds that coding adds at worst: a packet's length and the codec's look-ahead."""
        return self.codec.latency

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
            self._send([self._departure.wrap(PayloadType.BELIEF, end, write_belief(prediction))])

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
                    self._departure = Departure(self.codec, ssrc=event.local_ssrc, redundancy=self.redundancy)
                    self.counters["handshakes"] += 1
                case Disconnected():
                    self._departure = None
                    self.counters["link_losses"] += 1
                case Arrived(packet, report=True):
                    self._hear(packet, now)
        return [event for event in events if not isinstance(event, Arrived)]

    def _hear(self, packet: bytes, now: float) -> None:
        try:
            report = parse_report(packet)
        except PacketError:
            self.counters["packets_broken"] += 1
            return
        if isinstance(report, ReceiverReport):
            self.loss = report.fraction_lost
            self.redundancy.hear(report.fraction_lost)
            self.round_trip = round_trip(report, now=now)


class ReceivingEnd:
    """The operator's end: gives sound or belief, oldest first, and reports on the stream.

    Parameters
    ----------
    reorder
        Packets that may wait for one that is missing: 0 or 1.
    """

    def __init__(self, session: Session, *, reorder: int = 1) -> None:
        self.session = session
        self._reorder = reorder
        self._past: Counter[str] = Counter()
        self._ssrcs = (0, 0)
        self._next_report = 0.0
        self._begin()

    @property
    def stats(self) -> StreamStats:
        """Of the stream at hand."""
        return self._arrival.reception.stats

    @property
    def counters(self) -> Counter[str]:
        """Totals over all sessions, in telemetry's names."""
        return self._past + _counted(self.stats) + Counter(packets_rejected=self.session.faults["rejected"])

    @property
    def gauges(self) -> dict[str, float]:
        """How the stream is now, in telemetry's names."""
        return {
            "jitter": self.stats.jitter,
            "clock_skew_ppm": self._arrival.skew.ppm,
            "redundancy": float(self._depth),
            "loss_ratio": self._loss,
            "bitrate_bps": self._meter.bitrate_bps,
        }

    def receive(self, datagrams: Datagrams, *, now: float) -> list[Heard | Believed | Connected | Disconnected]:
        """Take everything that has come by now, and give what can be had of it."""
        events: list[Event] = []
        for datagram, source in datagrams:
            self._meter.count(len(datagram) + DATAGRAM_OVERHEAD, now=now)
            events += self.session.receive(datagram, source=source, now=now)
        return self._sort(events, now)

    def poll(self, now: float) -> list[Heard | Believed | Connected | Disconnected]:
        """Let time pass; call it when nothing came for a packet's length, and twenty times a second at least."""
        if self.session.peer and now >= self._next_report:
            self._next_report = now + REPORT_INTERVAL
            local, remote = self._ssrcs
            report = self._arrival.reception.report(ssrc=local, of=remote, now=now)
            self._loss = report.fraction_lost
            self.session.send(bytes(report))
        return [*self._sort(self.session.poll(now), now), *self._arrival.poll(now)]

    def outgoing(self) -> list[tuple[bytes, Address]]:
        """Hand over the datagrams to send, and where to."""
        return self.session.outgoing()

    def _begin(self) -> None:
        self._arrival = Arrival(reorder=self._reorder)
        self._beliefs = _Beliefs()
        self._meter = _Meter()
        self._depth, self._loss = 0, 0.0

    def _sort(self, events: list[Event], now: float) -> list[Heard | Believed | Connected | Disconnected]:
        """Tell sound from belief and news; what was open together is put in order together."""
        given: list[Heard | Believed | Connected | Disconnected] = []
        packets: list[Packet] = []
        for event in events:
            if not isinstance(event, Arrived):
                given += self._arrival.push(packets, now=now)
                packets = []
                self._note(event)
                given.append(event)
            elif event.report:
                self._hear(event.packet, now)
            elif (packet := self._parse(event.packet)) is not None:
                if packet.payload.kind == PayloadType.BELIEF:
                    given += self._believe(packet, now)
                else:
                    packets.append(packet)
        return given + self._arrival.push(packets, now=now)

    def _parse(self, datagram: bytes) -> Packet | None:
        try:
            packet = parse(datagram)
        except PacketError:
            self._past["packets_broken"] += 1
            return None
        self._depth = len(packet.earlier)
        return packet

    def _believe(self, packet: Packet, now: float) -> list[Believed]:
        payload = packet.payload
        if not self._arrival.reception.count(packet.sequence, payload.timestamp, len(payload.content), now=now):
            return []
        try:
            return self._beliefs.push(payload.timestamp, payload.content, now=now)
        except PacketError:
            self._past["packets_broken"] += 1
            return []

    def _note(self, event: Connected | Disconnected) -> None:
        if isinstance(event, Disconnected):
            self._past["link_losses"] += 1
            return
        self._past += _counted(self.stats)
        self._past["handshakes"] += 1
        self._ssrcs = (event.local_ssrc, event.remote_ssrc)
        self._begin()

    def _hear(self, packet: bytes, now: float) -> None:
        try:
            report = parse_report(packet)
        except PacketError:
            self._past["packets_broken"] += 1
            return
        if isinstance(report, SenderReport):
            self._arrival.reception.hear(report, now=now)


class _Beliefs:
    """Beliefs by their own time: an older one than the newest is of no use to anybody."""

    def __init__(self) -> None:
        self._first: int | None = None
        self._newest = -1
        self._envelope = Envelope()

    def push(self, timestamp: int, content: bytes, *, now: float) -> list[Believed]:
        if self._first is None:
            self._first = timestamp
        samples = ahead(timestamp, self._first, bits=32)
        prediction = read_belief(content, end=samples / CLOCK_RATE)
        if samples <= self._newest:
            return []
        self._newest = samples
        transit = now - prediction.end
        self._envelope.push(transit, now=now)
        return [Believed(prediction, stale=transit - self._envelope.least > STALENESS)]


class _Meter:
    """Bits a second over the newest second."""

    def __init__(self) -> None:
        self._sizes: deque[tuple[float, int]] = deque()
        self._octets = 0

    @property
    def bitrate_bps(self) -> float:
        return 8.0 * self._octets

    def count(self, octets: int, *, now: float) -> None:
        self._sizes.append((now, octets))
        self._octets += octets
        while now - self._sizes[0][0] > 1.0:
            self._octets -= self._sizes.popleft()[1]


def _counted(stats: StreamStats) -> Counter[str]:
    """Name what only grows."""
    names = (
        "packets_received packets_lost packets_late packets_duplicated packets_reordered packets_recovered "
        "packets_concealed packets_skipped packets_broken samples_received samples_concealed"
    )
    return Counter({name: getattr(stats, name) for name in names.split()})
