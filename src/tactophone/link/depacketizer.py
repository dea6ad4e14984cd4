"""Sound arrives: packets become blocks in order, as soon as they can be had.

There is no playout delay here, because the oscillator runs on the operator's own clock. A packet waits for at most one
other: when it leaves a hole, for the next packet or for as long as that should take. The hole is then filled from
redundancy, else concealed and marked. What comes too late to be judged, after a stall, is still given, marked
``stale``: the detector wants it as history, so that it can judge the very next sound by a full window.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from tactophone.errors import PacketError
from tactophone.link.codec import Decoder, open_decoder
from tactophone.link.delay_estimator import MinDelayFilter, Skew
from tactophone.link.packet import CLOCK_RATE, Packet, Payload, Timeline
from tactophone.link.stats import Reception
from tactophone.types import AudioBlock, FloatArray

LONGEST_HOLE = 0.1
"""Seconds of lost sound that are concealed; a longer hole is skipped, as nothing guessed of it could be right."""

STALENESS = 0.06
"""Seconds by which sound may be later than the line's usual: the delay that is noticed in a texture (Okamoto 2009)."""


@dataclass(frozen=True, slots=True, eq=False)
class DecodedAudio:
    """A block, whether it is too old to be judged, and how long (s) its packet waited for one before it."""

    block: AudioBlock
    stale: bool = False
    waited: float = 0.0


@dataclass(frozen=True, slots=True)
class _Waiting:
    payload: Payload
    own: bool
    came: float


class Depacketizer:
    """Puts one stream back together.

    Parameters
    ----------
    reorder
        Packets that may wait for one that is missing: 0 or 1.
    """

    def __init__(self, *, reorder: int = 1) -> None:
        if reorder not in (0, 1):
            raise ValueError(f"a reorder window of {reorder} packets, but it is 0 or 1")
        self.reception = Reception()
        self._reorder = reorder
        self.skew = Skew()
        self._envelope = MinDelayFilter()
        self._decoder: Decoder | None = None
        self._timeline = Timeline()
        self._next = 0
        self._size = 0
        self._waiting: dict[int, _Waiting] = {}
        self._since = 0.0

    @property
    def origin(self) -> int:
        """The timestamp on the wire of the first sample given."""
        return self._timeline.origin

    def push(self, packets: Sequence[Packet], *, now: float) -> list[DecodedAudio]:
        """Take all packets that have come by ``now``; give the sound that can be had, oldest first."""
        for packet in packets:
            self._accept(packet, now)
        heard: list[DecodedAudio] = []
        self._drain(heard, now)
        while sum(waiting.own for waiting in self._waiting.values()) > self._reorder:
            self._fill(heard, now)
        return heard

    def poll(self, now: float) -> list[DecodedAudio]:
        """Give up on a missing packet when the next one should have come."""
        heard: list[DecodedAudio] = []
        if self._waiting and now - self._since >= self._size / CLOCK_RATE:
            self._fill(heard, now)
        return heard

    def _accept(self, packet: Packet, now: float) -> None:
        content = packet.payload.content
        if not self.reception.count(packet.sequence, packet.payload.timestamp, len(content), now=now):
            return
        position = self._timeline.position(packet.payload.timestamp)
        transit = now - position / CLOCK_RATE
        self._envelope.push(transit, now=now)
        self.skew.push(transit, now=now)
        if position < self._next:
            self.reception.stats.packets_late += 1
            return
        if not self._waiting:
            self._since = now
        for payload in packet.earlier:
            self._keep(self._timeline.position(payload.timestamp), _Waiting(payload, own=False, came=now))
        self._keep(position, _Waiting(packet.payload, own=True, came=now))

    def _keep(self, position: int, waiting: _Waiting) -> None:
        if position >= self._next and (waiting.own or position not in self._waiting):
            self._waiting[position] = waiting

    def _drain(self, heard: list[DecodedAudio], now: float) -> None:
        """Decode whatever follows without a hole."""
        while (waiting := self._waiting.pop(self._next, None)) is not None:
            try:
                samples = self._decoder_for(waiting.payload).decode(waiting.payload.content)
            except PacketError:
                self.reception.stats.packets_broken += 1
                continue
            self.reception.stats.packets_recovered += not waiting.own
            self._size = len(samples)
            heard.append(self._emit(samples, now, concealed=False, came=waiting.came))

    def _fill(self, heard: list[DecodedAudio], now: float) -> None:
        """Bridge the hole before the oldest that waits, and go on from there."""
        self._waiting = {start: waiting for start, waiting in self._waiting.items() if start >= self._next}
        position = min(self._waiting, default=self._next)
        stats, size = self.reception.stats, position - self._next
        if size > LONGEST_HOLE * CLOCK_RATE:
            stats.samples_skipped += size
            self._next = position
        elif size:
            heard += self._conceal(size, self._waiting[position].payload, now)
        self._drain(heard, now)

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
        yield self._emit(samples, now, concealed=True, came=now)

    def _emit(self, samples: FloatArray, now: float, *, concealed: bool, came: float) -> DecodedAudio:
        block = AudioBlock(samples, CLOCK_RATE, self._next, concealed)
        self._next = block.end
        stale = now - block.start / CLOCK_RATE - self._envelope.least > STALENESS
        self.reception.stats.samples_received += block.size
        self.reception.stats.packets_skipped += stale
        return DecodedAudio(block, stale, waited=now - came)

    def _decoder_for(self, payload: Payload) -> Decoder:
        if self._decoder is None or self._decoder.kind != payload.kind:
            self._decoder = open_decoder(payload.kind)
        return self._decoder
