"""Encoded sound becomes the packets of one stream, each with as much redundancy as the loss requires."""

import secrets
from collections import deque
from dataclasses import dataclass

from tactophone.link.block_encoder import BlockEncoder, EncodedSound
from tactophone.link.packet import MAX_EARLIER_OFFSET, MAX_EARLIER_SIZE, PAYLOAD_SPACE, Packet, Payload, PayloadType
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

    The encoder is of this stream, or the one encoder of several streams that carry the same sound.
    """

    def __init__(self, encoder: BlockEncoder, *, ssrc: int, redundancy: Redundancy) -> None:
        self.encoder = encoder
        self.packets = self.octets = 0
        self.ssrc, self._redundancy = ssrc, redundancy
        # Below 2**15, as RFC 3711 section 3.3.1 recommends: the loss of the first packets cannot then cause a wrong
        # roll-over count.
        self._sequence = secrets.randbelow(1 << 15)
        self._marker = True
        self._past: deque[Payload] = deque(maxlen=2)

    @property
    def origin(self) -> int:
        """The RTP timestamp of the source's first sample."""
        return self.encoder.origin

    def push(self, block: AudioBlock) -> list[Packet]:
        """Take sound; return the packets that it completes, oldest first."""
        return [self.packet(encoded) for encoded in self.encoder.push(block)]

    def packet(self, encoded: EncodedSound) -> Packet:
        """Make the stream's next packet from encoded sound."""
        # A gap in the sound is announced by the marker.
        self._marker |= encoded.after_gap
        packet = self.wrap(encoded.kind, encoded.start, encoded.content)
        self._past.append(packet.payload)
        return packet

    def wrap(self, kind: PayloadType, position: int, content: bytes) -> Packet:
        """Make the stream's next packet from a payload at ``position`` samples since the start of the stream."""
        payload = Payload(kind, (self.origin + position) % (1 << 32), content)
        packet = Packet(self._sequence, self.ssrc, payload, self._earlier(payload), self._marker)
        self._sequence, self._marker = (self._sequence + 1) % (1 << 16), False
        self.packets, self.octets = self.packets + 1, self.octets + len(content)
        return packet

    def report(self, now: float) -> SenderReport:
        """Make the sender report; ``now`` is of any clock, the same that evaluates the receiver's report."""
        timestamp = self.origin + (self.encoder.position or 0)
        return SenderReport(self.ssrc, now, timestamp % (1 << 32), self.packets, self.octets)

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
