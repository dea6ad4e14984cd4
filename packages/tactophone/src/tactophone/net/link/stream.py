"""Sound becomes packets, and packets become sound again, in order and as soon as they
can be decoded.

`BlockEncoder` cuts blocks of any length into packets of one length and encodes them;
`Packetizer` makes one stream of them, with as much redundancy as the loss requires.
`Depacketizer` is the other end. It has no playout delay, because the oscillator runs on
the operator's own clock. A packet that follows a gap waits for at most one other
packet, and no longer than one packet's duration. The gap is then filled from
redundancy, else concealed and marked. Sound that arrives too late for a prediction,
after a stall, is still returned, marked ``stale``: the detector needs it as history, so
that the next fresh packet completes a full window. Of a longer backlog only the newest
`PACKET_HISTORY` is decoded.
"""

import secrets
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from tactophone.core.errors import PacketError
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.net.link.codec import Codec, Decoder, open_decoder, open_encoder
from tactophone.net.link.packet import (
    CLOCK_RATE,
    MAX_EARLIER_OFFSET,
    MAX_EARLIER_SIZE,
    PAYLOAD_SPACE,
    Packet,
    Payload,
    PayloadType,
    TimestampUnwrapper,
)
from tactophone.net.link.rate_limit import RateLimit
from tactophone.net.link.rtcp import SenderReport
from tactophone.net.link.stats import MinDelayFilter, Reception, Skew


class EncodedSound(msgspec.Struct, frozen=True):
    """Sound of one packet: ``content`` of type ``kind`` at ``start`` samples;
    ``after_gap`` if sound before is lost."""

    kind: PayloadType
    start: int
    content: bytes
    after_gap: bool = False


class BlockEncoder:
    """Cuts and encodes sound, for one stream of packets or for several that carry the
    same.

    ``prompt``: whether the rest of a block longer than a packet is sent at once in
    shorter packets. Else it waits for the next block: with periods of 512 samples and
    packets of 480, for up to 10 ms.

    - ``faults``: ``invalid samples``: removed as no sound (`AudioBlock.invalid`), and
      sent as silence.
    - ``origin``: the RTP timestamp of the source's first sample, in all streams.
    - ``position``: the first sample of the next block; ``None`` before the first.
    - ``moving``: whether the robot moves, as each packet says.
    """

    def __init__(self, codec: Codec, *, prompt: bool = False) -> None:
        self.faults: Counter[str] = Counter()
        self._prompt = prompt
        self.origin = secrets.randbits(32)
        self.position: int | None = None
        self.moving = False
        self.codec = codec
        self._encoder = open_encoder(codec)
        self._buffer = np.zeros((codec.packet_size, codec.channels), np.float32)
        self._filled = 0
        self._after_gap = True

    @property
    def missing(self) -> int:
        """Samples until the next packet is complete."""
        return self.codec.packet_size - self._filled

    def push(self, block: AudioBlock) -> list[EncodedSound]:
        """Take sound; return what it completes, oldest first."""
        if block.sample_rate != CLOCK_RATE or block.channels != self.codec.channels:
            raise ValueError(
                f"a block of {block.channels} channels at {block.sample_rate} Hz, but "
                "this stream carries "
                f"{self.codec.channels} at {CLOCK_RATE} Hz; convert the sound or "
                "choose another codec"
            )
        if block.start != self.position:
            # The source lost sound: the incomplete packet is dropped.
            self._filled = 0
            self._after_gap = True
        self.position = block.end
        if block.invalid is not None:
            self.faults["invalid samples"] += int(block.invalid.sum())
        encoded = list(self._cut(block.samples, block.start))
        if self._prompt and block.size > self.codec.packet_size:
            # The rest goes in shorter packets, down to the shortest that the codec has.
            while size := self.codec.largest_packet(self._filled):
                encoded.append(
                    self._code(block.end - self._filled, self._buffer[:size])
                )
                self._buffer[: self._filled - size] = self._buffer[
                    size : self._filled
                ].copy()
                self._filled -= size
        return encoded

    def adapt(self, codec: Codec) -> None:
        """Use another band and bitrate from the next packet on; all else must stay the
        same.

        Nobody hears the change: what a decoder returns differs by no more than the
        codec's own error.
        """
        self.codec = codec
        self._encoder.adapt(bandwidth=codec.bandwidth, bitrate_bps=codec.bitrate_bps)

    def reset(self) -> None:
        """Begin anew: a receiver that has missed all before decodes what follows as it
        was encoded."""
        self._encoder = open_encoder(self.codec)
        self.position = None
        self._filled = 0
        self._after_gap = True

    def _cut(self, samples: FloatArray, start: int) -> Iterator[EncodedSound]:
        if not self._filled and len(samples) == self.codec.packet_size:
            yield self._code(start, samples)
            return
        taken = 0
        while taken < len(samples):
            step = min(self.codec.packet_size - self._filled, len(samples) - taken)
            self._buffer[self._filled : self._filled + step] = samples[
                taken : taken + step
            ]
            self._filled += step
            taken += step
            if self._filled == self.codec.packet_size:
                self._filled = 0
                yield self._code(start + taken - self.codec.packet_size, self._buffer)

    def _code(self, start: int, samples: FloatArray) -> EncodedSound:
        encoded = EncodedSound(
            self.codec.kind, start, self._encoder.encode(samples), self._after_gap
        )
        self._after_gap = False
        return encoded


_EARLIER_HEADER = 4
"""Bytes that RFC 2198 adds for each earlier payload."""


@dataclass(frozen=True, slots=True)
class RedundancyRule:
    """How many earlier payloads a packet carries: between ``least`` and ``most``, by
    the reported loss.

    Any loss requires one; a loss above ``heavy`` requires two, as two packets in a row
    are then lost too often. After ``patience`` reports without loss (ten seconds of
    them) the number is reduced by one.
    """

    least: int = 0
    most: int = 2
    heavy: float = 0.03
    patience: int = 50

    def __post_init__(self) -> None:
        if not 0 <= self.least <= self.most <= 2:
            raise ValueError(
                f"redundancy from {self.least} to {self.most}, but it lies between 0 "
                "and 2"
            )


class Redundancy:
    """Applies a `RedundancyRule`; starts with one earlier payload and drops it once the
    link has proved free of loss.

    >>> redundancy = Redundancy(RedundancyRule())
    >>> redundancy.update(0.05)
    >>> redundancy.depth
    2
    """

    def __init__(self, rule: RedundancyRule) -> None:
        self._rule = rule
        self._clean = 0
        self.depth = self._bounded(1)

    def update(self, fraction_lost: float) -> None:
        """Adapt the depth to the loss in the newest report, 0 to 1."""
        if fraction_lost > 0:
            self._clean = 0
            self.depth = self._bounded(
                2 if fraction_lost > self._rule.heavy else max(1, self.depth)
            )
            return
        self._clean += 1
        if self._clean >= self._rule.patience:
            self._clean = 0
            self.depth = self._bounded(self.depth - 1)

    def _bounded(self, depth: int) -> int:
        return max(self._rule.least, min(depth, self._rule.most))


class Packetizer:
    """Makes one stream of packets, not yet encrypted.

    The encoder serves this stream alone, or all streams that carry the same sound.
    """

    def __init__(
        self, encoder: BlockEncoder, *, ssrc: int, redundancy: Redundancy
    ) -> None:
        self.encoder = encoder
        self.packets = self.octets = 0
        self.ssrc = ssrc
        self._redundancy = redundancy
        # Below 2**15, as RFC 3711 section 3.3.1 recommends: the loss of the first
        # packets cannot then cause a wrong roll-over count.
        self._sequence = secrets.randbelow(1 << 15)
        self._marker = True
        self._past: deque[Payload] = deque(maxlen=2)

    def packet(self, encoded: EncodedSound) -> Packet:
        # A gap in the sound is announced by the marker.
        self._marker |= encoded.after_gap
        packet = self.wrap(encoded.kind, encoded.start, encoded.content)
        self._past.append(packet.payload)
        return packet

    def wrap(self, kind: PayloadType, position: int, content: bytes) -> Packet:
        """Make the stream's next packet from a payload at ``position`` samples since
        the start of the stream."""
        payload = Payload(kind, (self.encoder.origin + position) % (1 << 32), content)
        earlier = self._earlier(payload)
        moving = self.encoder.moving
        packet = Packet(
            self._sequence, self.ssrc, payload, earlier, self._marker, moving
        )
        self._sequence = (self._sequence + 1) % (1 << 16)
        self._marker = False
        self.packets += 1
        self.octets += len(content)
        return packet

    def report(self, now: float) -> SenderReport:
        """Make the sender report; ``now`` may come from any clock, but from the same
        one that evaluates the receiver's report."""
        timestamp = self.encoder.origin + (self.encoder.position or 0)
        return SenderReport(
            self.ssrc, now, timestamp % (1 << 32), self.packets, self.octets
        )

    def _earlier(self, payload: Payload) -> tuple[Payload, ...]:
        """Return the newest past payloads that fit, oldest first."""
        chosen: list[Payload] = []
        # The packet's own payload has a header of one byte (RFC 2198 section 3).
        space = PAYLOAD_SPACE - 1 - len(payload.content)
        for past in list(reversed(self._past))[: self._redundancy.depth]:
            space -= _EARLIER_HEADER + len(past.content)
            behind = (payload.timestamp - past.timestamp) % (1 << 32)
            if (
                space < 0
                or len(past.content) > MAX_EARLIER_SIZE
                or behind > MAX_EARLIER_OFFSET
            ):
                break
            chosen.insert(0, past)
        return tuple(chosen)


MAX_CONCEALED_GAP = 0.1
"""Seconds of lost sound that are concealed; a longer gap is skipped, as no
extrapolation of it would be right."""

SOUND_STALE_AFTER = 0.06
"""Seconds above the minimum delay from which sound is stale: the delay noticed in a
texture (Okamoto 2009)."""

PACKET_HISTORY = 0.256 + SOUND_STALE_AFTER
"""Seconds of a backlog that are decoded, counted from its newest packet: a window of
the detector, and what is fresh. What is older can no longer change a prediction, and
decoding it would only delay what is fresh."""


SOUND_PACE = 1.01
"""Seconds of sound that may come in a second: no sound card is 1 % too fast.

Sound beyond this bound, or `CONCEALED_PACE`, comes from a robot gone wrong, whose
timestamps run ahead of the clock. It is skipped: the detector would need longer for it
than it lasts, and the fingertip would still vibrate when the robot is long silent."""

FRESH_AT_ONCE = PACKET_HISTORY + MAX_CONCEALED_GAP
"""Seconds of fresh sound that may come at once, as after a path has become shorter."""

SOUND_AT_ONCE = 5.0
"""Seconds of sound that may come at once after a stall, nearly all of it stale; after a
longer stall the robot has to call again."""

CONCEALED_PACE = 0.5
"""Seconds that may be concealed in a second: with more than half of the sound missing,
nothing is felt rightly."""

CONCEALED_AT_ONCE = 3 * MAX_CONCEALED_GAP
"""Seconds that may be concealed in gaps that follow one another."""


class DecodedAudio(msgspec.Struct, frozen=True, eq=False):
    """A block of sound."""

    block: AudioBlock
    stale: bool = False
    """Whether it is too old for a prediction."""
    waited: float = 0.0
    """Seconds that its packet waited for an earlier one."""


class _Waiting(msgspec.Struct, frozen=True):
    payload: Payload
    primary: bool
    """Whether it is its packet's own payload, not a redundant copy in a later
    packet."""
    arrival: float


class Depacketizer:
    """Decodes one stream of packets.

    ``reorder`` is how many packets may wait for a missing one, 0 or 1; ``start`` is the
    position of the first sample.
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
        # The window: everything before `_next` has been returned or given up, and what
        # waits lies after it.
        self._next = self._newest = start
        self._moving = False
        self._size = 0
        self._waiting: dict[int, _Waiting] = {}
        self._waiting_since = 0.0
        self._fresh = RateLimit(
            SOUND_PACE * CLOCK_RATE, burst=FRESH_AT_ONCE * CLOCK_RATE
        )
        self._sound = RateLimit(
            SOUND_PACE * CLOCK_RATE, burst=SOUND_AT_ONCE * CLOCK_RATE
        )
        self._concealed = RateLimit(
            CONCEALED_PACE * CLOCK_RATE, burst=CONCEALED_AT_ONCE * CLOCK_RATE
        )

    @property
    def origin(self) -> int:
        """The RTP timestamp at position 0."""
        return self._timestamps.origin

    @property
    def waiting(self) -> bool:
        """Whether a packet waits for an earlier one, so that `poll` may return
        sound."""
        return bool(self._waiting)

    def push(self, packets: Sequence[Packet], *, now: float) -> list[DecodedAudio]:
        """Take all packets that have arrived by ``now`` (s); return the sound that can
        be decoded, oldest first."""
        decoded: list[DecodedAudio] = []
        alone = len(packets) == 1 and not self._waiting
        for packet in packets:
            position = self._count(packet, now)
            if position is None:
                continue
            if alone and position == self._next:
                # Nearly always: the next packet in order, which need not be kept.
                self._decode(decoded, packet.payload, now, arrival=now)
            else:
                self._accept(packet, position, now)
        if self._waiting:
            self._skip_old()
            self._decode_contiguous(decoded, now)
            # More packets wait than may: the one before them is lost. Redundant copies
            # do not count, because they say nothing about the order of the packets.
            while self._waiting_packets() > self._reorder:
                self._fill_gap(decoded, now)
        return decoded

    def poll(self, now: float) -> list[DecodedAudio]:
        """Give up on a missing packet once the next one is due."""
        decoded: list[DecodedAudio] = []
        if self._waiting and now - self._waiting_since >= self._size / CLOCK_RATE:
            self._fill_gap(decoded, now)
        return decoded

    def _waiting_packets(self) -> int:
        return sum(waiting.primary for waiting in self._waiting.values())

    def _count(self, packet: Packet, now: float) -> int | None:
        """Count a packet; return its position in samples, or ``None`` for one that
        comes twice or too late to be used."""
        timestamp = packet.payload.timestamp
        if not self.reception.count(packet.sequence, timestamp, now=now):
            return None
        position = self._timestamps.position(timestamp)
        if position >= self._newest:  # an older packet says how it was
            self._newest = position
            self._moving = packet.moving
        transit = now - position / CLOCK_RATE
        self._delay.push(transit, now=now)
        self.skew.push(transit, now=now)
        # The place of a late one has been filled, from a copy or by concealment:
        # `_next` never moves back.
        return None if self.reception.came_late(position, self._next) else position

    def _accept(self, packet: Packet, position: int, now: float) -> None:
        """Keep a packet's payloads until their turn."""
        if not self._waiting:
            self._waiting_since = now
        for payload in packet.earlier:
            self._keep(
                self._timestamps.position(payload.timestamp),
                _Waiting(payload, primary=False, arrival=now),
            )
        self._keep(position, _Waiting(packet.payload, primary=True, arrival=now))

    def _keep(self, position: int, waiting: _Waiting) -> None:
        if position >= self._next and (
            waiting.primary or position not in self._waiting
        ):
            self._waiting[position] = waiting

    def _skip_old(self) -> None:
        """Drop what is too old to matter, when much more than a window has arrived at
        once after a stall."""
        oldest = max(self._waiting, default=0) - round(PACKET_HISTORY * CLOCK_RATE)
        old = [position for position in self._waiting if position < oldest]
        if not old:
            return
        for position in old:
            self.reception.stats.packets_skipped += self._waiting.pop(position).primary
        # The window moves to the oldest payload that is kept, without concealment: the
        # gap is no loss of the network.
        following = min(self._waiting)
        self.reception.stats.samples_skipped += following - self._next
        self._next = following

    def _decode_contiguous(self, decoded: list[DecodedAudio], now: float) -> None:
        while (waiting := self._waiting.pop(self._next, None)) is not None:
            if self._decode(decoded, waiting.payload, now, arrival=waiting.arrival):
                self.reception.stats.packets_recovered += not waiting.primary

    def _decode(
        self,
        decoded: list[DecodedAudio],
        payload: Payload,
        now: float,
        *,
        arrival: float,
    ) -> bool:
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
        self._emit(decoded, samples, now, concealed=False, arrival=arrival)
        return True

    def _fill_gap(self, decoded: list[DecodedAudio], now: float) -> None:
        """Conceal or skip the gap before the oldest waiting payload, and decode from
        there."""
        # A copy may still wait for a place that its packet has filled meanwhile.
        self._waiting = {
            start: waiting
            for start, waiting in self._waiting.items()
            if start >= self._next
        }
        position = min(self._waiting, default=self._next)
        stats = self.reception.stats
        size = position - self._next
        if size > MAX_CONCEALED_GAP * CLOCK_RATE or not self._concealed.take(now, size):
            stats.samples_skipped += size
            self._next = position
        elif size:
            following = self._waiting[position].payload
            try:
                samples = self._decoder_for(following).conceal(size, following.content)
            except PacketError:
                stats.packets_broken += 1
                self._next = position
            else:
                stats.samples_concealed += size
                stats.packets_concealed += (
                    max(1, round(size / self._size)) if self._size else 1
                )
                self._emit(decoded, samples, now, concealed=True, arrival=now)
        self._decode_contiguous(decoded, now)

    def _keeps_pace(self, size: int, now: float, *, stale: bool) -> bool:
        if not stale and not self._fresh.take(now, size):
            return False
        return self._sound.take(now, size)

    def _emit(
        self,
        decoded: list[DecodedAudio],
        samples: FloatArray,
        now: float,
        *,
        concealed: bool,
        arrival: float,
    ) -> None:
        """Append the sound that comes next to ``decoded``, unless it comes faster than
        any robot records it."""
        block = AudioBlock(samples, CLOCK_RATE, self._next, concealed, self._moving)
        size = len(samples)
        stats = self.reception.stats
        self._next += size
        stale = now - block.start / CLOCK_RATE - self._delay.minimum > SOUND_STALE_AFTER
        if not concealed and not self._keeps_pace(size, now, stale=stale):
            stats.samples_skipped += size
            return
        stats.samples_received += size
        stats.packets_skipped += stale
        decoded.append(DecodedAudio(block, stale, waited=now - arrival))

    def _decoder_for(self, payload: Payload) -> Decoder:
        """Return the decoder of the stream: its first payload decides codec and
        channels until the next handshake."""
        if self._decoder is None:
            self._decoder = open_decoder(payload.kind)
        if self._decoder.kind != payload.kind:
            raise PacketError(
                f"a payload of {payload.kind.name} in a stream of "
                f"{self._decoder.kind.name}"
            )
        return self._decoder
