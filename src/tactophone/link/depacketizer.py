"""Packets become blocks of sound in order, as soon as they can be decoded.

There is no playout delay, because the oscillator runs on the operator's own clock. A packet that follows a gap waits
for at most one other packet, and no longer than one packet's duration. The gap is then filled from redundancy, else
concealed and marked. Sound that arrives too late for a prediction, after a stall, is still returned, marked ``stale``:
the detector needs it as history, so that the next fresh packet completes a full window. Of a longer backlog only the
newest `HISTORY` is decoded.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from tactophone.errors import PacketError
from tactophone.link.codec import Decoder, open_decoder
from tactophone.link.delay_estimator import MinDelayFilter, Skew
from tactophone.link.packet import CLOCK_RATE, Packet, Payload, TimestampUnwrapper
from tactophone.link.stats import Reception
from tactophone.types import AudioBlock, FloatArray

MAX_CONCEALED_GAP = 0.1
"""Seconds of lost sound that are concealed; a longer gap is skipped, as no extrapolation of it would be right."""

STALENESS = 0.06
"""Seconds above the minimum delay from which sound is stale: the delay noticed in a texture (Okamoto 2009)."""


HISTORY = 0.256 + STALENESS
"""Seconds of a backlog that are decoded, counted from its newest packet: a window of the detector, and what is fresh.
What is older can no longer change a prediction, and decoding it would only delay what is fresh."""


@dataclass(frozen=True, slots=True, eq=False)
class DecodedAudio:
    """A block of sound."""

    block: AudioBlock
    stale: bool = False
    """Whether it is too old for a prediction."""
    waited: float = 0.0
    """Seconds that its packet waited for an earlier one."""


@dataclass(frozen=True, slots=True)
class _Waiting:
    payload: Payload
    primary: bool
    """Whether it is its packet's own payload, not a redundant copy in a later packet."""
    arrival: float


class Depacketizer:
    """Decodes one stream of packets.

    ``reorder`` is how many packets may wait for a missing one, 0 or 1; ``start`` is the position of the first sample.
    """

    def __init__(self, *, reorder: int = 1, start: int = 0) -> None:
        if reorder not in (0, 1):
            raise ValueError(f"a reorder window of {reorder} packets, but it is 0 or 1")
        self.reception = Reception()
        self._reorder = reorder
        self.skew = Skew()
        self._delay = MinDelayFilter()
        self._decoder: Decoder | None = None
        self._timestamps = TimestampUnwrapper(start)
        self._next = start
        self._size = 0
        self._waiting: dict[int, _Waiting] = {}
        self._waiting_since = 0.0

    @property
    def origin(self) -> int:
        """The RTP timestamp at position 0."""
        return self._timestamps.origin

    @property
    def waiting(self) -> bool:
        """Whether a packet waits for an earlier one, so that `poll` may return sound."""
        return bool(self._waiting)

    def push(self, packets: Sequence[Packet], *, now: float) -> list[DecodedAudio]:
        """Take all packets that have arrived by ``now`` (s); return the sound that can be decoded, oldest first."""
        if len(packets) == 1 and not self._waiting:
            return self._push_alone(packets[0], now)
        for packet in packets:
            if (position := self._count(packet, now)) is not None:
                self._accept(packet, position, now)
        return self._decode_waiting(now)

    def _push_alone(self, packet: Packet, now: float) -> list[DecodedAudio]:
        """Take the only packet there is; one that is the next in order need not be kept."""
        position = self._count(packet, now)
        if position is None:
            return []
        if position != self._next:
            self._accept(packet, position, now)
            return self._decode_waiting(now)
        decoded: list[DecodedAudio] = []
        self._decode(decoded, packet.payload, now, arrival=now)
        return decoded

    def _decode_waiting(self, now: float) -> list[DecodedAudio]:
        """Return what waited and can be decoded now, oldest first."""
        self._skip_old()
        decoded: list[DecodedAudio] = []
        self._decode_contiguous(decoded, now)
        # Redundant copies do not count: they say nothing about the order of the packets.
        while sum(waiting.primary for waiting in self._waiting.values()) > self._reorder:
            self._fill_gap(decoded, now)
        return decoded

    def poll(self, now: float) -> list[DecodedAudio]:
        """Give up on a missing packet once the next one is due."""
        decoded: list[DecodedAudio] = []
        if self._waiting and now - self._waiting_since >= self._size / CLOCK_RATE:
            self._fill_gap(decoded, now)
        return decoded

    def _count(self, packet: Packet, now: float) -> int | None:
        """Count a packet; return its position in samples, ``None`` if it is of no use."""
        timestamp = packet.payload.timestamp
        if not self.reception.count(packet.sequence, timestamp, len(packet.payload.content), now=now):
            return None
        position = self._timestamps.position(timestamp)
        transit = now - position / CLOCK_RATE
        self._delay.push(transit, now=now)
        self.skew.push(transit, now=now)
        if position < self._next:
            self.reception.stats.packets_late += 1
            return None
        return position

    def _accept(self, packet: Packet, position: int, now: float) -> None:
        """Keep a packet's payloads until their turn."""
        if not self._waiting:
            self._waiting_since = now
        for payload in packet.earlier:
            self._keep(self._timestamps.position(payload.timestamp), _Waiting(payload, primary=False, arrival=now))
        self._keep(position, _Waiting(packet.payload, primary=True, arrival=now))

    def _keep(self, position: int, waiting: _Waiting) -> None:
        if position >= self._next and (waiting.primary or position not in self._waiting):
            self._waiting[position] = waiting

    def _skip_old(self) -> None:
        """Drop what is too old to matter, when much more than a window has arrived at once after a stall."""
        oldest = max(self._waiting, default=0) - round(HISTORY * CLOCK_RATE)
        old = [position for position in self._waiting if position < oldest]
        if not old:
            return
        for position in old:
            self.reception.stats.packets_skipped += self._waiting.pop(position).primary
        following = min(self._waiting)
        self.reception.stats.samples_skipped += following - self._next
        self._next = following

    def _decode_contiguous(self, decoded: list[DecodedAudio], now: float) -> None:
        """Decode the payloads that follow without a gap."""
        while (waiting := self._waiting.pop(self._next, None)) is not None:
            if self._decode(decoded, waiting.payload, now, arrival=waiting.arrival):
                self.reception.stats.packets_recovered += not waiting.primary

    def _decode(self, decoded: list[DecodedAudio], payload: Payload, now: float, *, arrival: float) -> bool:
        """Decode the next payload; false, and counted, if it is malformed."""
        decoder = self._decoder
        try:
            if decoder is None or decoder.kind != payload.kind:
                decoder = self._decoder_for(payload)
            samples = decoder.decode(payload.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            return False
        self._size = len(samples)
        decoded.append(self._emit(samples, now, concealed=False, arrival=arrival))
        return True

    def _fill_gap(self, decoded: list[DecodedAudio], now: float) -> None:
        """Conceal or skip the gap before the oldest waiting payload, and decode from there."""
        self._waiting = {start: waiting for start, waiting in self._waiting.items() if start >= self._next}
        position = min(self._waiting, default=self._next)
        stats, size = self.reception.stats, position - self._next
        if size > MAX_CONCEALED_GAP * CLOCK_RATE:
            stats.samples_skipped += size
            self._next = position
        elif size:
            decoded += self._conceal(size, self._waiting[position].payload, now)
        self._decode_contiguous(decoded, now)

    def _conceal(self, size: int, following: Payload, now: float) -> Iterator[DecodedAudio]:
        try:
            samples = self._decoder_for(following).conceal(size, following.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            self._next += size
            return
        self.reception.stats.samples_concealed += size
        self.reception.stats.packets_concealed += max(1, round(size / self._size)) if self._size else 1
        self.reception.stats.concealment_events += 1
        yield self._emit(samples, now, concealed=True, arrival=now)

    def _emit(self, samples: FloatArray, now: float, *, concealed: bool, arrival: float) -> DecodedAudio:
        block, size, stats = AudioBlock(samples, CLOCK_RATE, self._next, concealed), len(samples), self.reception.stats
        self._next += size
        stale = now - block.start / CLOCK_RATE - self._delay.minimum > STALENESS
        stats.samples_received += size
        stats.packets_skipped += stale
        return DecodedAudio(block, stale, waited=now - arrival)

    def _decoder_for(self, payload: Payload) -> Decoder:
        """Return the decoder of the stream: its first payload decides codec and channels until the next handshake."""
        if self._decoder is None:
            self._decoder = open_decoder(payload.kind)
        if self._decoder.kind != payload.kind:
            raise PacketError(f"a payload of {payload.kind.name} in a stream of {self._decoder.kind.name}")
        return self._decoder
