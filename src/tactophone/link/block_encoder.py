"""Blocks of any length become encoded sound of one length."""

import math
import secrets
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactophone.link.codec import Codec, open_encoder
from tactophone.link.packet import CLOCK_RATE, PayloadType
from tactophone.types import AudioBlock, FloatArray


@dataclass(frozen=True, slots=True)
class EncodedSound:
    """Sound of one packet: ``content`` of type ``kind`` at ``start`` samples; ``after_gap`` if sound before is lost."""

    kind: PayloadType
    start: int
    content: bytes
    after_gap: bool = False


class BlockEncoder:
    """Cuts and encodes sound, for one stream of packets or for several that carry the same.

    Parameters
    ----------
    prompt
        Whether the rest of a block longer than a packet is sent at once in shorter packets. Else it waits for the next
        block: with periods of 512 samples and packets of 480, for up to 10 ms.

    Attributes
    ----------
    faults
        ``non-finite samples``: NaN and infinities, sent as silence, because they would corrupt the state of the codec.
    origin
        The RTP timestamp of the source's first sample, in all streams.
    position
        The first sample of the next block; ``None`` before the first.
    """

    def __init__(self, codec: Codec, *, prompt: bool = False) -> None:
        self.faults: Counter[str] = Counter()
        self._prompt = prompt
        self.origin = secrets.randbits(32)
        self.position: int | None = None
        self.recode(codec)
        self._buffer = np.zeros((codec.packet_size, codec.channels), np.float32)
        self._filled, self._after_gap = 0, True

    @property
    def missing(self) -> int:
        """Samples until the next packet is complete."""
        return self.codec.packet_size - self._filled

    def push(self, block: AudioBlock) -> list[EncodedSound]:
        """Take sound; return what it completes, oldest first."""
        self._check(block)
        if block.start != self.position:
            # The source lost sound: the incomplete packet is dropped.
            self._filled, self._after_gap = 0, True
        self.position = block.end
        samples = block.samples
        # Where the sum of squares is finite, every sample is; the search takes six times as long.
        if not math.isfinite(np.vdot(samples, samples)):
            finite = np.isfinite(samples)
            self.faults["non-finite samples"] += int((~finite).sum())
            samples = np.where(finite, samples, np.float32(0))
        encoded = list(self._cut(samples, block.start))
        if self._prompt and block.size > self.codec.packet_size:
            encoded += self._cut_rest(block.end)
        return encoded

    def recode(self, codec: Codec) -> None:
        """Use another codec setting from the next packet on; channels and packet size must stay the same."""
        self.codec, self._encoder = codec, open_encoder(codec)

    def reset(self) -> None:
        """Begin anew: a receiver that has missed all before decodes what follows as it was encoded."""
        self.recode(self.codec)
        self.position, self._filled, self._after_gap = None, 0, True

    def _check(self, block: AudioBlock) -> None:
        if block.sample_rate != CLOCK_RATE or block.channels != self.codec.channels:
            raise ValueError(
                f"a block of {block.channels} channels at {block.sample_rate} Hz, but this stream carries "
                f"{self.codec.channels} at {CLOCK_RATE} Hz; convert the sound or choose another codec"
            )

    def _cut(self, samples: FloatArray, start: int) -> Iterator[EncodedSound]:
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

    def _cut_rest(self, end: int) -> Iterator[EncodedSound]:
        """Make shorter packets of what is left before ``end``, as far as the codec has so short ones."""
        while size := self.codec.largest_packet(self._filled):
            encoded = self._code(end - self._filled, self._buffer[:size])
            self._buffer[: self._filled - size] = self._buffer[size : self._filled].copy()
            self._filled -= size
            yield encoded

    def _code(self, start: int, samples: FloatArray) -> EncodedSound:
        encoded = EncodedSound(self.codec.kind, start, self._encoder.encode(samples), self._after_gap)
        self._after_gap = False
        return encoded
