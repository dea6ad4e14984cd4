"""A clocked buffer for the profiles that render the sound itself: constant delay, two clocks reconciled, no clicks.

Packets wait here, still encoded, until they are due. On each pull the buffer decodes what the block needs, conceals
what is missing, and resamples it at the speed that :mod:`~tactophone.link.playout_clock` computes, by libsamplerate's
sinc interpolator (20 samples of delay, 120 dB). Where the sound is discontinuous (a jump of the position, the end of a
longer gap), the old sound fades out while the new sound fades in.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactophone.errors import ConfigError, PacketError
from tactophone.link.codec import Decoder, open_decoder
from tactophone.link.packet import CLOCK_RATE, Packet, Payload, TimestampUnwrapper
from tactophone.link.pcm import mirror
from tactophone.link.playout_clock import PlayoutController
from tactophone.link.stats import Reception
from tactophone.types import FloatArray

MAX_EXTRAPOLATION = 0.02
"""Seconds of missing sound that are extrapolated in a row; after them there is silence."""

FADE = 120
"""Samples of a fade: 2.5 ms, a twelfth of the shortest burst felt as vibration (Sci. Rep. 15:5057, 2025)."""

_QUEUE_SIZE = 400
"""Packets kept while nothing is pulled: a second of 2.5 ms each."""

_FADE_ANGLES = np.linspace(0, np.pi / 2, FADE, dtype=np.float32)[:, np.newaxis]
_MAX_EXTRAPOLATED = round(MAX_EXTRAPOLATION * CLOCK_RATE)


@dataclass(frozen=True, slots=True)
class _Waiting:
    payload: Payload
    primary: bool
    """Whether it is its packet's own payload, not a redundant copy in a later packet."""
    end: int


class Playout:
    """Decodes one stream of packets by the listener's clock.

    ``push`` only queues, so that a network thread may call it while an actuator's thread calls ``pull``. ``channels``
    is of the output: a mono stream fills both, of a stereo stream the first is contact.

    Attributes
    ----------
    controller
        Its delay and margin, and the clock skew.
    """

    def __init__(self, *, block_size: int, channels: int = 2) -> None:
        self.reception = Reception()
        self.controller = PlayoutController(block_size=block_size)
        self.block_size, self._channels = block_size, channels
        self._arrived: deque[tuple[Packet, float]] = deque(maxlen=_QUEUE_SIZE)
        self._waiting: dict[int, _Waiting] = {}
        self._timestamps = TimestampUnwrapper()
        self._packet_size = 0
        self._decoder: Decoder | None = None
        self._resampler = _open_resampler(channels)
        self._position: int | None = None
        self._decoded = self._ready = np.zeros((0, channels), np.float32)
        self._last = np.zeros((FADE, channels), np.float32)
        self._fading = self._last[:0]
        self._extrapolated = 0
        self._discontinuous = True

    @property
    def latency(self) -> float:
        """Seconds that the interpolator adds to the controller's delay."""
        return 20 / CLOCK_RATE

    def push(self, packet: Packet, *, now: float) -> None:
        """Queue a packet, in any order."""
        self._arrived.append((packet, now))

    def pull(self, *, now: float) -> FloatArray:
        """Return the block due at ``now`` (s), shape ``(block_size, channels)``; silence where there is no sound."""
        while self._arrived:
            self._accept(*self._arrived.popleft())
        step = self.controller.step(self.block_size, now=now)
        if math.isnan(self.controller.position):
            return np.zeros((self.block_size, self._channels), np.float32)
        if step.jumped:
            self._move(round(self.controller.position - self.block_size))
        # The resampler returns a varying number of samples; what exceeds the block is kept for the next pull.
        while len(self._ready) < self.block_size:
            needed = math.ceil((self.block_size - len(self._ready)) * step.speed) + 1
            block = self._resampler.process(self._read(needed), 1 / step.speed)
            self._ready = np.concatenate([self._ready, block.reshape(-1, self._channels)])
        block, self._ready = self._ready[: self.block_size], self._ready[self.block_size :]
        return block

    def _accept(self, packet: Packet, now: float) -> None:
        own = packet.payload
        if not self.reception.count(packet.sequence, own.timestamp, len(own.content), now=now):
            return
        start = self._timestamps.position(own.timestamp)
        size = self._keep(start, own, primary=True)
        if not size:
            return
        self._packet_size = size
        self.controller.push(start, size, now=now)
        if self._position is not None:
            self.reception.stats.packets_late += start < self._position
        for payload in packet.earlier:
            self._keep(self._timestamps.position(payload.timestamp), payload, primary=False)

    def _keep(self, start: int, payload: Payload, *, primary: bool) -> int:
        """Store a payload until it is due; return its size in samples, 0 when it is broken."""
        try:
            size = self._decoder_for(payload).size(payload.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            return 0
        if primary or start not in self._waiting:
            self._waiting[start] = _Waiting(payload, primary, start + size)
        return size

    def _move(self, position: int) -> None:
        """Continue from another position of the stream."""
        self._position = position
        self._decoded = self._decoded[:0]
        self._discontinuous = True

    def _read(self, size: int) -> FloatArray:
        """Return the next samples at the sender's rate."""
        while len(self._decoded) < size:
            self._decoded = np.concatenate([self._decoded, self._next()])
        sound, self._decoded = self._decoded[:size], self._decoded[size:]
        return sound

    def _next(self) -> FloatArray:
        """Decode, conceal or extrapolate the sound at the position."""
        assert self._position is not None
        for start in [start for start, waiting in self._waiting.items() if waiting.end <= self._position]:
            del self._waiting[start]
        following = min(self._waiting, default=None)
        if following is None or following - self._position > _MAX_EXTRAPOLATED:
            return self._extrapolate()
        if following > self._position:
            return self._conceal(following - self._position, self._waiting[following].payload)
        return self._decode(self._waiting.pop(following))

    def _decode(self, waiting: "_Waiting") -> FloatArray:
        payload = waiting.payload
        try:
            samples = self._decoder_for(payload).decode(payload.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            return self._extrapolate()
        # A payload may begin before the position, after a jump into its middle.
        skipped = (self._position or 0) - self._timestamps.position(payload.timestamp)
        self.reception.stats.packets_recovered += not waiting.primary
        self._extrapolated = 0
        return self._append(samples[skipped:], fade=self._discontinuous)

    def _conceal(self, size: int, following: Payload) -> FloatArray:
        """Conceal lost samples before a payload that is here."""
        try:
            samples = self._decoder_for(following).conceal(size, following.content)
        except PacketError:
            return self._extrapolate()
        self._count_concealed(size)
        return self._append(samples, fade=self._discontinuous)

    def _extrapolate(self) -> FloatArray:
        """Continue for a packet's length without a following payload: fading sound at first, then silence."""
        size, was_silent = self._packet_size, self._extrapolated > _MAX_EXTRAPOLATED
        self._count_concealed(size)
        if self._decoder is not None and self._extrapolated <= _MAX_EXTRAPOLATED:
            sound = self._append(self._decoder.conceal(size, None), fade=self._discontinuous)
        else:
            sound = self._append(np.zeros((size, self._channels), np.float32), fade=not was_silent)
        self._discontinuous = True
        return sound

    def _count_concealed(self, size: int) -> None:
        self.reception.stats.samples_concealed += size
        self.reception.stats.concealment_events += self._extrapolated == 0
        self._extrapolated += size

    def _append(self, samples: FloatArray, *, fade: bool) -> FloatArray:
        """Advance by ``samples``; with ``fade``, cross-fade from the sound before into them."""
        assert self._position is not None
        samples = np.broadcast_to(samples[:, : self._channels], (len(samples), self._channels))
        self._position += len(samples)
        self.reception.stats.samples_received += len(samples)
        self._discontinuous = False
        if fade:
            # The sound before is continued by its mirror image, which starts where it ended.
            self._fading = mirror(self._last[::-1], FADE)
        length = min(len(self._fading), len(samples))
        if length:
            # A fade may span several calls: the angles go on where the last call stopped.
            old, self._fading = self._fading[:length], self._fading[length:]
            new, rest = samples[:length], samples[length:]
            angle = _FADE_ANGLES[FADE - len(self._fading) - length :][:length]
            samples = np.concatenate([np.cos(angle) * old + np.sin(angle) * new, rest])
        self._last = np.concatenate([self._last, samples])[-FADE:]
        return samples

    def _decoder_for(self, payload: Payload) -> Decoder:
        if self._decoder is None or self._decoder.kind != payload.kind:
            self._decoder = open_decoder(payload.kind)
        return self._decoder


def _open_resampler(channels: int) -> Any:
    try:
        import samplerate
    except ImportError as error:
        raise ConfigError("clocked playout needs: pip install 'tactophone[link]'") from error
    return samplerate.Resampler("sinc_fastest", channels=channels)
