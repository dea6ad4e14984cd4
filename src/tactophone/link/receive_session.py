"""The operator's end of the line, whole: session, stream and reports together, still without socket or clock."""

from collections import Counter, deque
from dataclasses import dataclass
from typing import TypeAlias

from tactophone.errors import PacketError
from tactophone.link.delay_estimator import MinDelayFilter
from tactophone.link.depacketizer import STALENESS, DecodedAudio, Depacketizer
from tactophone.link.handshake import Address
from tactophone.link.packet import CLOCK_RATE, Packet, PayloadType, Timeline, parse
from tactophone.link.playout import Playout
from tactophone.link.prediction_payload import read_prediction
from tactophone.link.rtcp import ReceiverRequest, SenderReport, parse_report
from tactophone.link.send_session import REPORT_INTERVAL, Datagrams
from tactophone.link.session import Connected, Disconnected, Event, PacketReceived, Session
from tactophone.link.stats import StreamStats
from tactophone.types import FloatArray, Prediction

DATAGRAM_OVERHEAD = 28
"""Bytes that IPv4 and UDP add to each datagram."""


@dataclass(frozen=True, slots=True)
class PredictionReceived:
    """A prediction that the robot made, and whether it is too old to be felt."""

    prediction: Prediction
    stale: bool = False


ReceiveEvent: TypeAlias = DecodedAudio | PredictionReceived | Connected | Disconnected
"""What an operator's end gives."""


class ReceiveSession:
    """The operator's end: gives sound or belief, oldest first, and reports on the stream.

    Parameters
    ----------
    reorder
        Packets that may wait for one that is missing: 0 or 1.

    Attributes
    ----------
    bandwidth
        The highest frequency in Hz that the model makes use of, for the robot to know; 0: nothing is said of it.
    playout
        The clocked buffer of the session at hand; ``None`` until somebody pulls.
    """

    def __init__(self, session: Session, *, reorder: int = 1) -> None:
        self.session = session
        self._reorder = reorder
        self.playout: Playout | None = None
        self.bandwidth = 0
        self._ssrcs = (0, 0)
        self._next_report = 0.0
        self._begin(Counter(handshakes=0, link_losses=0, packets_broken=0))

    @property
    def stats(self) -> StreamStats:
        """Of the stream at hand."""
        return self._arrival.reception.stats

    @property
    def counters(self) -> Counter[str]:
        """Totals over all sessions, in telemetry's names; may be read from another thread."""
        past, arrival = self._books
        return past + _counted(arrival.reception.stats) + Counter(packets_rejected=self.session.refused)

    @property
    def gauges(self) -> dict[str, float]:
        """How the stream is now, in telemetry's names."""
        return {
            "jitter": self.stats.jitter,
            "clock_skew_ppm": self._arrival.skew.ppm,
            "redundancy": float(self._depth),
            "loss_ratio": self._loss,
            "bitrate_bps": self._meter.bitrate_bps,
            "playout_delay": self.playout.pace.margin if self.playout else 0.0,
        }

    @property
    def origin(self) -> int:
        """The timestamp on the wire of the first sample given in this session."""
        return self._beliefs.origin if self._beliefs.begun else self._arrival.origin

    def receive(self, datagrams: Datagrams, *, now: float) -> list[ReceiveEvent]:
        """Take everything that has come by now, and give what can be had of it."""
        events: list[Event] = []
        for datagram, source in datagrams:
            opened = self.session.receive(datagram, source=source, now=now)
            if opened:
                self._meter.count(len(datagram) + DATAGRAM_OVERHEAD, now=now)
            events += opened
        return self._sort(events, now)

    def pull(self, size: int, *, now: float) -> FloatArray:
        """Give the next samples in step with the actuator, shape ``(size, 2)``, for profiles that render sound itself.

        May be called from the actuator's thread; whatever else is done here belongs to the network's.
        """
        playout = self.playout
        if playout is None or playout.block_size != size:
            self.playout = playout = Playout(block_size=size)
        return playout.pull(now=now)

    def poll(self, now: float) -> list[ReceiveEvent]:
        """Let time pass; call it when nothing came for a packet's length, and twenty times a second at least."""
        if self.session.peer and now >= self._next_report:
            self._next_report = now + REPORT_INTERVAL
            local, remote = self._ssrcs
            report = self._arrival.reception.report(ssrc=local, of=remote, now=now)
            self._loss = report.fraction_lost
            self.session.send(bytes(report))
            if self.bandwidth:
                self.session.send(bytes(ReceiverRequest(local, self.bandwidth)))
        return [*self._sort(self.session.poll(now), now), *self._arrival.poll(now)]

    def outgoing(self) -> list[tuple[bytes, Address]]:
        """Hand over the datagrams to send, and where to."""
        return self.session.outgoing()

    def _begin(self, past: Counter[str]) -> None:
        # One assignment, so that who counts meanwhile sees the old stream either as present or as past.
        self._books = past, Depacketizer(reorder=self._reorder)
        self._past, self._arrival = self._books
        self.playout = None
        self._beliefs = _PredictionStream()
        self._meter = _Meter()
        self._depth, self._loss = 0, 0.0

    def _sort(self, events: list[Event], now: float) -> list[ReceiveEvent]:
        """Tell sound from belief and news; what was open together is put in order together."""
        given: list[ReceiveEvent] = []
        packets: list[Packet] = []
        for event in events:
            if not isinstance(event, PacketReceived):
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
                    if self.playout:
                        self.playout.push(packet, now=now)
        return given + self._arrival.push(packets, now=now)

    def _parse(self, datagram: bytes) -> Packet | None:
        try:
            packet = parse(datagram)
        except PacketError:
            self._past["packets_broken"] += 1
            return None
        self._depth = len(packet.earlier)
        return packet

    def _believe(self, packet: Packet, now: float) -> list[PredictionReceived]:
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
        self._ssrcs = (event.local_ssrc, event.remote_ssrc)
        totals = _counted(self.stats)
        totals.update(self._past)
        totals["handshakes"] += 1
        self._begin(totals)

    def _hear(self, packet: bytes, now: float) -> None:
        try:
            report = parse_report(packet)
        except PacketError:
            self._past["packets_broken"] += 1
            return
        if isinstance(report, SenderReport):
            self._arrival.reception.hear(report, now=now)


class _PredictionStream:
    """Beliefs by their own time: an older one than the newest is of no use to anybody."""

    def __init__(self) -> None:
        self._timeline = Timeline()
        self._newest = -1
        self._envelope = MinDelayFilter()

    @property
    def begun(self) -> bool:
        """Whether any belief has come."""
        return self._newest >= 0

    @property
    def origin(self) -> int:
        """The timestamp on the wire from which beliefs' times are counted."""
        return self._timeline.origin

    def push(self, timestamp: int, content: bytes, *, now: float) -> list[PredictionReceived]:
        samples = self._timeline.position(timestamp)
        prediction = read_prediction(content, end=samples / CLOCK_RATE)
        if samples <= self._newest:
            return []
        self._newest = samples
        transit = now - prediction.end
        self._envelope.push(transit, now=now)
        return [PredictionReceived(prediction, stale=transit - self._envelope.least > STALENESS)]


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
        "packets_received packets_late packets_duplicated packets_reordered packets_recovered "
        "packets_concealed packets_skipped packets_broken samples_received samples_concealed"
    )
    grown: dict[str, int] = {name: getattr(stats, name) for name in names.split()}
    return Counter(grown | {"packets_lost": stats.most_lost})
