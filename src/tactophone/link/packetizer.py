"""Blocks of any length become packets of one length, each with as much redundancy as the loss requires."""

import math
import secrets
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactophone.link.codec import Codec, open_encoder
from tactophone.link.packet import (
    CLOCK_RATE,
    MAX_EARLIER_OFFSET,
    MAX_EARLIER_SIZE,
    PAYLOAD_SPACE,
    Packet,
    Payload,
    PayloadType,
)
from tactophone.link.rtcp import SenderReport
from tactophone.types import AudioBlock

_EARLIER_HEADER = 4


@dataclass(frozen=True, slots=True)
class RedundancyRule:
    """How many earlier payloads a packet carries: between ``least`` and ``most``, by the reported loss.

    Any loss requires one; a loss above ``heavy`` requires two, as two packets in a row are then lost too often. After
    ``patience`` reports without loss (ten seconds of them) the number is reduced by one.
    """

    least: int = 0
    most: int = 2
    heavy: float = 0.03
    patience: int = 50

    def __post_init__(self) -> None:
        if not 0 <= self.least <= self.most <= 2:
            raise ValueError(f"redundancy from {self.least} to {self.most}, but it lies between 0 and 2")


class Redundancy:
    """Applies a `RedundancyRule`; starts with one earlier payload and drops it once the link has proved free of loss.

    Examples
    --------
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
            self.depth = self._bounded(2 if fraction_lost > self._rule.heavy else max(1, self.depth))
            return
        self._clean += 1
        if self._clean >= self._rule.patience:
            self._clean = 0
            self.depth = self._bounded(self.depth - 1)

    def _bounded(self, depth: int) -> int:
        return max(self._rule.least, min(depth, self._rule.most))


class Packetizer:
    """Makes one stream of packets, not yet encrypted.

    Parameters
    ----------
    prompt
        Whether the rest of a block longer than a packet is sent at once in shorter packets. Else it waits for the next
        block: with periods of 512 samples and packets of 480, for up to 10 ms.

    Attributes
    ----------
    faults
        ``non-finite samples``: NaN and infinities, sent as silence, because they would corrupt the state of the codec.
    """

    def __init__(self, codec: Codec, *, ssrc: int, redundancy: Redundancy, prompt: bool = False) -> None:
        self.codec = codec
        self.faults: Counter[str] = Counter()
        self.packets = self.octets = 0
        self.ssrc, self._redundancy, self._prompt = ssrc, redundancy, prompt
        # Below 2**15, as RFC 3711 section 3.3.1 recommends: the loss of the first packets cannot then cause a wrong
        # roll-over count.
        self._sequence = secrets.randbelow(1 << 15)
        self._offset = secrets.randbits(32)
        self._encoder = open_encoder(codec)
        self._buffer = np.zeros((codec.packet_size, codec.channels), np.float32)
        self._filled = 0
        self._next: int | None = None
        self._marker = True
        self._past: deque[Payload] = deque(maxlen=2)

    @property
    def origin(self) -> int:
        """The RTP timestamp of the source's first sample."""
        return self._offset

    @property
    def latency(self) -> float:
        """Seconds that coding adds at most: a packet's duration and the codec's look-ahead."""
        return self.codec.latency

    def push(self, block: AudioBlock) -> list[Packet]:
        """Take sound; return the packets that it completes, oldest first."""
        self._check(block)
        if block.start != self._next:
            # The source lost sound: the incomplete packet is dropped, and the marker announces the gap.
            self._filled, self._marker = 0, True
        self._next = block.end
        samples = block.samples
        # Where the sum of squares is finite, every sample is; the search takes six times as long.
        if not math.isfinite(np.vdot(samples, samples)):
            finite = np.isfinite(samples)
            self.faults["non-finite samples"] += int((~finite).sum())
            samples = np.where(finite, samples, np.float32(0))
        packets = list(self._cut(samples, block.start))
        if self._prompt and block.size > self.codec.packet_size:
            packets += self._cut_rest(block.end)
        return packets

    def recode(self, codec: Codec) -> None:
        """Use another codec setting from the next packet on; channels and packet size must stay the same."""
        self.codec, self._encoder = codec, open_encoder(codec)

    def flush(self) -> list[Packet]:
        """Return the incomplete packet, padded with silence."""
        if not self._filled or self._next is None:
            return []
        padding = np.zeros((self.codec.packet_size - self._filled, self.codec.channels), np.float32)
        return list(self._cut(padding, self._next))

    def wrap(self, kind: PayloadType, position: int, content: bytes, *, marker: bool | None = None) -> Packet:
        """Make the stream's next packet from a payload at ``position`` samples since the start of the stream.

        ``marker`` replaces the stream's own rule, which marks the first packet and those after gaps in the sound.
        """
        payload = Payload(kind, (self._offset + position) % (1 << 32), content)
        marked = self._marker if marker is None else marker
        packet = Packet(self._sequence, self.ssrc, payload, self._earlier(payload), marked)
        self._sequence, self._marker = (self._sequence + 1) % (1 << 16), False
        self.packets, self.octets = self.packets + 1, self.octets + len(content)
        return packet

    def report(self, now: float) -> SenderReport:
        """Make the sender report; ``now`` is of any clock, the same that evaluates the receiver's report."""
        timestamp = self._offset + (self._next or 0)
        return SenderReport(self.ssrc, now, timestamp % (1 << 32), self.packets, self.octets)

    def _check(self, block: AudioBlock) -> None:
        if block.sample_rate != CLOCK_RATE or block.channels != self.codec.channels:
            raise ValueError(
                f"a block of {block.channels} channels at {block.sample_rate} Hz, but this stream carries "
                f"{self.codec.channels} at {CLOCK_RATE} Hz; convert the sound or choose another codec"
            )

    def _cut(self, samples: np.ndarray, start: int) -> Iterator[Packet]:
        if not self._filled and len(samples) == self.codec.packet_size:
            yield self._code(start, samples)
            return
        taken = 0
        while taken < len(samples):
            step = min(self.codec.packet_size - self._filled, len(samples) - taken)
            self._buffer[self._filled : self._filled + step] = samples[taken : taken + step]
            self._filled, taken = self._filled + step, taken + step
            if self._filled == self.codec.packet_size:
                self._filled = 0
                yield self._code(start + taken - self.codec.packet_size, self._buffer)

    def _cut_rest(self, end: int) -> Iterator[Packet]:
        """Make shorter packets of what is left before ``end``, as far as the codec has so short ones."""
        while size := self.codec.largest_packet(self._filled):
            packet = self._code(end - self._filled, self._buffer[:size])
            self._buffer[: self._filled - size] = self._buffer[size : self._filled].copy()
            self._filled -= size
            yield packet

    def _code(self, start: int, samples: np.ndarray) -> Packet:
        packet = self.wrap(self.codec.kind, start, self._encoder.encode(samples))
        self._past.append(packet.payload)
        return packet

    def _earlier(self, payload: Payload) -> tuple[Payload, ...]:
        """Return the newest past payloads that fit, oldest first."""
        chosen: list[Payload] = []
        space = PAYLOAD_SPACE - len(payload.content)
        for past in list(reversed(self._past))[: self._redundancy.depth]:
            space -= _EARLIER_HEADER + len(past.content)
            behind = (payload.timestamp - past.timestamp) % (1 << 32)
            if space < 0 or len(past.content) > MAX_EARLIER_SIZE or behind > MAX_EARLIER_OFFSET:
                break
            chosen.insert(0, past)
        return tuple(chosen)
