"""The operator's end of the link: session, stream and reports together, without socket
or clock."""

from collections import Counter, deque
from collections.abc import Callable
from typing import Protocol, TypeAlias

import msgspec

from tactophone.core.errors import PacketError
from tactophone.core.types import FloatArray, Prediction
from tactophone.net.link.events import (
    Connected,
    Disconnected,
    Event,
    PacketReceived,
    Renewed,
)
from tactophone.net.link.packet import (
    CLOCK_RATE,
    Address,
    Packet,
    Payload,
    PayloadType,
    TimestampUnwrapper,
    parse_packet,
    read_predictions,
)
from tactophone.net.link.playout import Playout
from tactophone.net.link.rate_limit import RateLimit
from tactophone.net.link.rtcp import ReceiverRequest, SenderReport, parse_report
from tactophone.net.link.send import REPORT_INTERVAL, Datagrams
from tactophone.net.link.stats import MinDelayFilter, StreamStats
from tactophone.net.link.stream import (
    FRESH_AT_ONCE,
    SOUND_AT_ONCE,
    SOUND_PACE,
    SOUND_STALE_AFTER,
    DecodedAudio,
    Depacketizer,
)

DATAGRAM_OVERHEAD = 28
"""Bytes that IPv4 and UDP add to each datagram."""

_STREAM_COUNTERS = (
    "packets_received",
    "packets_late",
    "packets_duplicated",
    "packets_reordered",
    "packets_recovered",
    "packets_concealed",
    "packets_skipped",
    "packets_broken",
    "samples_received",
    "samples_concealed",
)
"""Fields of `StreamStats` that telemetry counts under the same names."""

_PREDICTIONS = (PayloadType.PREDICTION, PayloadType.HAND_PREDICTION)
"""Payload types that hold predictions made on the robot, in place of sound."""

SHORTEST_HOP = 0.001
"""Seconds for which a prediction counts at least; a robot makes one with each packet of
2.5 ms at most."""

LONGEST_HOP = 0.01
"""Seconds for which a prediction counts at most: the time between two windows. A pause
between two predictions costs nothing."""


class PredictionReceived(msgspec.Struct, frozen=True):
    """A prediction made on the robot: whether it is too old to be rendered, which
    finger it is about, and how many fingers the hand has."""

    prediction: Prediction
    stale: bool = False
    finger: int = 0
    fingers: int = 1


ReceiveEvent: TypeAlias = DecodedAudio | PredictionReceived | Connected | Disconnected


class EventSession(Protocol):
    """A session as far as its receiver needs it: datagrams and the time go in, events
    come out. It is a `Session`, or a `LoggedSession`, which repeats one."""

    @property
    def peer(self) -> str | None:
        """Name of the connected peer; ``None`` without a connection."""

    @property
    def refused(self) -> int:
        """Number of datagrams that belong to no session."""

    def receive(self, datagram: bytes, *, source: Address, now: float) -> list[Event]:
        """Take a datagram; return the events that it leads to."""

    def poll(self, now: float) -> list[Event]:
        """Let time pass; return the events that it leads to."""

    def send(self, packet: bytes) -> None:
        """Send a packet to the peer."""

    def contain(self, error: Exception, *, now: float) -> list[Event]:
        """End the session with a peer whose authentic packets made something raise;
        return the events that this leads to."""


class ReceiveSession:
    """Receives sound or predictions, oldest first, and reports on the stream.

    ``reorder`` is how many packets may wait for a missing one, 0 or 1.

    - ``bandwidth``: the highest frequency in Hz that the model uses, to be requested
      from the robot; 0: no request.
    - ``playout``: the clocked buffer of the current session; ``None`` until the first
      `pull`.
    - ``moving``: whether the robot moves, by the newest packet.
    - ``tap``: called with the time and the session's events before they are processed,
      and with whether they came by `poll`: all that a log needs to repeat this end
      (`tactophone.net.link.events`).
    """

    def __init__(self, session: EventSession, *, reorder: int = 1) -> None:
        self.session = session
        self.tap: Callable[[float, list[Event], bool], None] = (
            lambda now, events, polled: None
        )
        self._reorder = reorder
        self.playout: Playout | None = None
        self.bandwidth = 0
        self.moving = False
        self._ssrcs = (0, 0)
        self._next_report = 0.0
        self._zero: float | None = None
        self._begin(Counter(handshakes=0, link_losses=0, packets_broken=0))

    @property
    def peer(self) -> str | None:
        """Name of the connected robot; ``None`` without a connection."""
        return self.session.peer

    @property
    def stats(self) -> StreamStats:
        return self._depacketizer.reception.stats

    @property
    def counters(self) -> Counter[str]:
        """Totals over all sessions, in telemetry's names; may be read from another
        thread."""
        past, depacketizer = self._totals
        return (
            past
            + _stream_counters(depacketizer.reception.stats)
            + Counter(packets_rejected=self.session.refused)
        )

    @property
    def gauges(self) -> dict[str, float]:
        """The current state of the stream, in telemetry's names."""
        return {
            "jitter": self.stats.jitter,
            "clock_skew_ppm": self._depacketizer.skew.ppm,
            "redundancy": float(self._depth),
            "loss_ratio": self._loss,
            "bitrate_bps": self._meter.bitrate_bps,
            "playout_delay": self.playout.controller.margin if self.playout else 0.0,
        }

    @property
    def waiting(self) -> bool:
        """Whether a packet waits for an earlier one, so that `poll` may return
        sound."""
        return self._depacketizer.waiting

    @property
    def origin(self) -> int:
        """The RTP timestamp at time 0."""
        return (
            self._predictions.timestamps.origin
            if self._predictions.newest
            else self._depacketizer.origin
        )

    def receive(self, datagrams: Datagrams, *, now: float) -> list[ReceiveEvent]:
        """Process everything that arrived by ``now`` (s); return what it contains,
        oldest first."""
        events: list[Event] = []
        for datagram, source in datagrams:
            opened = self.session.receive(datagram, source=source, now=now)
            if opened:
                self._meter.count(len(datagram) + DATAGRAM_OVERHEAD, now=now)
            events += opened
        if events:
            self.tap(now, events, False)
        return self._handle_safely(events, now)

    def pull(self, size: int, *, now: float) -> FloatArray:
        """Return the samples due at ``now``, shape ``(size, 2)``, for profiles that
        render the sound of one finger.

        May be called from the actuator's thread; all other methods belong to the
        network thread.
        """
        playout = self.playout
        if playout is None or playout.block_size != size:
            self.playout = playout = Playout(block_size=size)
        return playout.pull(now=now)

    def poll(self, now: float) -> list[ReceiveEvent]:
        """Let time pass; call it when nothing arrived for a packet's length, and at
        least twenty times a second."""
        if self.session.peer and now >= self._next_report:
            self._next_report = now + REPORT_INTERVAL
            local, remote = self._ssrcs
            report = self._depacketizer.reception.report(ssrc=local, of=remote, now=now)
            self._loss = report.fraction_lost
            self.session.send(bytes(report))
            if self.bandwidth:
                self.session.send(bytes(ReceiverRequest(local, self.bandwidth)))
        events = self.session.poll(now)
        if events or self._depacketizer.waiting:
            self.tap(now, events, True)
        return self._handle_safely(events, now, polled=True)

    def _begin(self, past: Counter[str], *, start: int = 0) -> None:
        # One assignment, so that a thread that reads `counters` meanwhile counts the
        # old stream exactly once.
        self._totals = past, Depacketizer(reorder=self._reorder, start=start)
        self._past, self._depacketizer = self._totals
        self.playout = None
        self._predictions = _PredictionStream(start)
        self._meter = _Meter()
        self._depth = 0
        self._loss = 0.0

    def _handle_safely(
        self, events: list[Event], now: float, *, polled: bool = False
    ) -> list[ReceiveEvent]:
        try:
            received = self._handle(events, now)
            return [*received, *self._depacketizer.poll(now)] if polled else received
        except Exception as error:
            # Whatever an authentic packet made our code raise ends the robot's session,
            # not the operator's side: without a session the fingertip is quiet.
            ended = self.session.contain(error, now=now)
            self.tap(now, ended, polled)
            return self._handle(ended, now)

    def _handle(self, events: list[Event], now: float) -> list[ReceiveEvent]:
        received: list[ReceiveEvent] = []
        # Packets of sound are collected, because those that arrived together are put in
        # order together.
        packets: list[Packet] = []
        for event in events:
            if isinstance(event, PacketReceived):
                try:
                    if packet := self._open(event, received, now):
                        packets.append(packet)
                except PacketError:
                    self._past["packets_broken"] += 1
            elif isinstance(event, Renewed):
                # The stream runs on, so that nothing is lost at the finger; only the
                # SSRCs in reports change.
                self._ssrcs = (event.local_ssrc, event.remote_ssrc)
                self._past["handshakes"] += 1
            else:
                received += self._depacketizer.push(packets, now=now)
                packets = []
                self._handle_connection(event, now)
                received.append(event)
        return received + self._depacketizer.push(packets, now=now)

    def _open(
        self, event: PacketReceived, received: list[ReceiveEvent], now: float
    ) -> Packet | None:
        """Take a report, or add predictions to ``received``; return a packet of sound,
        which is still to be ordered."""
        if event.report:
            report = parse_report(event.packet)
            if isinstance(report, SenderReport):
                self._depacketizer.reception.note_sender_report(report, now=now)
            return None
        packet = parse_packet(event.packet)
        payload = packet.payload
        self._depth = len(packet.earlier)
        self.moving = packet.moving
        if payload.kind not in _PREDICTIONS:
            if self.playout:
                self.playout.push(packet, now=now)
            return packet
        reception = self._depacketizer.reception
        if reception.count(packet.sequence, payload.timestamp, now=now):
            skipped = self._predictions.skipped
            received += self._predictions.push(payload, now=now)
            reception.stats.packets_skipped += self._predictions.skipped - skipped
        return None

    def _handle_connection(self, event: Connected | Disconnected, now: float) -> None:
        if isinstance(event, Disconnected):
            self._past["link_losses"] += 1
            return
        self._ssrcs = (event.local_ssrc, event.remote_ssrc)
        totals = _stream_counters(self.stats)
        totals.update(self._past)
        totals["handshakes"] += 1
        # The times of a later stream go on by this end's clock: in a log they would
        # otherwise begin at 0 again.
        self._zero = now if self._zero is None else self._zero
        self._begin(totals, start=round((now - self._zero) * CLOCK_RATE))


class _PredictionStream:
    """Orders predictions by the end of their windows; one that is older than its
    finger's newest is dropped.

    As with sound (`stream.SOUND_PACE`), predictions may not come faster than they last.

    - ``newest``: position of each finger's newest prediction, in samples.
    - ``skipped``: packets of predictions beyond that pace.
    """

    def __init__(self, start: int = 0) -> None:
        self.timestamps = TimestampUnwrapper(start)
        self.newest: dict[int, int] = {}
        self.skipped = 0
        self._delay = MinDelayFilter()
        self._fresh = RateLimit(SOUND_PACE, burst=FRESH_AT_ONCE)
        self._all = RateLimit(SOUND_PACE, burst=SOUND_AT_ONCE)

    def push(self, payload: Payload, *, now: float) -> list[PredictionReceived]:
        samples = self.timestamps.position(payload.timestamp)
        end = samples / CLOCK_RATE
        found, fingers = read_predictions(payload, end=end)
        fresh = {
            finger: each
            for finger, each in found.items()
            if samples > self.newest.get(finger, -1)
        }
        if not fresh:
            return []
        advance = (samples - max(self.newest.values(), default=samples)) / CLOCK_RATE
        self.newest |= dict.fromkeys(fresh, samples)
        transit = now - end
        self._delay.push(transit, now=now)
        stale = transit - self._delay.minimum > SOUND_STALE_AFTER
        if not self._keeps_pace(advance, now, stale=stale):
            self.skipped += 1
            return []
        return [
            PredictionReceived(prediction, stale, finger, fingers)
            for finger, prediction in fresh.items()
        ]

    def _keeps_pace(self, advance: float, now: float, *, stale: bool) -> bool:
        """Whether a prediction that ends ``advance`` s after the newest may still be
        computed."""
        lasts = min(max(advance, SHORTEST_HOP), LONGEST_HOP)
        if not stale and not self._fresh.take(now, lasts):
            return False
        return self._all.take(now, lasts)


class _Meter:
    """Bits per second over the newest second."""

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


def _stream_counters(stats: StreamStats) -> Counter[str]:
    """Return the statistics that only grow, by telemetry's names."""
    counters: dict[str, int] = {name: getattr(stats, name) for name in _STREAM_COUNTERS}
    return Counter(counters | {"packets_lost": stats.most_lost})
