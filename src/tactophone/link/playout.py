"""A clocked buffer for the profiles that render the sound itself: steady delay, two clocks reconciled, no click.

Packets wait here, still coded, until their time. Asked for a block, it decodes what the block needs, bridges what is
missing, and reads it at the speed that :mod:`~tactophone.link.playout_clock` gives, by libsamplerate's sinc interpolator (20
samples of delay, 120 dB). Where sound cannot go on as it was (a place set anew, the end of a drought), the old fades
out as the new fades in.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactophone.errors import ConfigError, PacketError
from tactophone.link.codec import Decoder, open_decoder
from tactophone.link.packet import CLOCK_RATE, Packet, Payload, Timeline
from tactophone.link.pcm import mirror
from tactophone.link.playout_clock import PlayoutController
from tactophone.link.stats import Reception
from tactophone.types import FloatArray

LONGEST_GUESS = 0.02
"""Seconds of missing sound that are guessed in a row; then there is silence."""

FADE = 120
"""Samples of a fade: 2.5 ms, a twelfth of the shortest burst that is felt as vibration (Sci. Rep. 15:5057, 2025)."""

_MOST_QUEUED = 400
"""Packets kept for a listener who does not pull: a second of 2.5 ms each."""

_FADE_ANGLES = np.linspace(0, np.pi / 2, FADE, dtype=np.float32)[:, np.newaxis]
_LONGEST_BRIDGE = round(LONGEST_GUESS * CLOCK_RATE)


@dataclass(frozen=True, slots=True)
class _Waiting:
    payload: Payload
    own: bool
    end: int


class Playout:
    """Puts one stream back together by the listener's clock.

    ``push`` only queues, so that a network thread may call it while an actuator's thread calls ``pull``.

    Parameters
    ----------
    block_size
        Samples asked for at once.
    channels
        Of the sound given, 1 or 2; a stream of one fills both, of two the first is contact.

    Attributes
    ----------
    pace
        Its delay and margin, and how the clocks differ.
    """

    def __init__(self, *, block_size: int, channels: int = 2) -> None:
        self.reception = Reception()
        self.pace = PlayoutController(block_size=block_size)
        self.block_size, self._channels = block_size, channels
        self._arrived: deque[tuple[Packet, float]] = deque(maxlen=_MOST_QUEUED)
        self._waiting: dict[int, _Waiting] = {}
        self._timeline = Timeline()
        self._packet_size = 0
        self._decoder: Decoder | None = None
        self._resampler = _open_resampler(channels)
        self._place: int | None = None
        self._sound = self._ready = np.zeros((0, channels), np.float32)
        self._last = np.zeros((FADE, channels), np.float32)
        self._fading = self._last[:0]
        self._guessed = 0
        self._apart = True

    @property
    def latency(self) -> float:
        """Seconds that the interpolator adds to the pace's delay."""
        return 20 / CLOCK_RATE

    def push(self, packet: Packet, *, now: float) -> None:
        """Take a packet that has come, in any order."""
        self._arrived.append((packet, now))

    def pull(self, *, now: float) -> FloatArray:
        """Give the block of shape ``(block_size, channels)`` that is due at ``now``; silence where there is nothing."""
        while self._arrived:
            self._accept(*self._arrived.popleft())
        step = self.pace.step(self.block_size, now=now)
        if math.isnan(self.pace.position):
            return np.zeros((self.block_size, self._channels), np.float32)
        if step.jumped:
            self._move(round(self.pace.position - self.block_size))
        while len(self._ready) < self.block_size:
            wanted = math.ceil((self.block_size - len(self._ready)) * step.speed) + 1
            block = self._resampler.process(self._read(wanted), 1 / step.speed)
            self._ready = np.concatenate([self._ready, block.reshape(-1, self._channels)])
        block, self._ready = self._ready[: self.block_size], self._ready[self.block_size :]
        return block

    def _accept(self, packet: Packet, now: float) -> None:
        stats, own = self.reception.stats, packet.payload
        if not self.reception.count(packet.sequence, own.timestamp, len(own.content), now=now):
            return
        start = self._timeline.position(own.timestamp)
        size = self._keep(start, own, own=True)
        if not size:
            return
        self._packet_size = size
        self.pace.push(start, size, now=now)
        stats.packets_late += self._place is not None and start < self._place
        for payload in packet.earlier:
            self._keep(self._timeline.position(payload.timestamp), payload, own=False)

    def _keep(self, start: int, payload: Payload, *, own: bool) -> int:
        """Let a payload wait for its time; returns its size, 0 when it is broken."""
        try:
            size = self._decoder_for(payload).size(payload.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            return 0
        if own or start not in self._waiting:
            self._waiting[start] = _Waiting(payload, own, start + size)
        return size

    def _move(self, place: int) -> None:
        """Go on from elsewhere."""
        self._place = place
        self._sound = self._sound[:0]
        self._apart = True

    def _read(self, size: int) -> FloatArray:
        """Give the next samples of the stream as it was sent, at its own rate."""
        while len(self._sound) < size:
            self._sound = np.concatenate([self._sound, self._next()])
        sound, self._sound = self._sound[:size], self._sound[size:]
        return sound

    def _next(self) -> FloatArray:
        """Decode what comes next, or guess at it."""
        assert self._place is not None
        self._forget_the_past(self._place)
        following = min(self._waiting, default=None)
        if following is None or following - self._place > _LONGEST_BRIDGE:
            return self._guess()
        if following > self._place:
            return self._bridge(following - self._place, self._waiting[following].payload)
        return self._decode(self._waiting.pop(following))

    def _decode(self, waiting: "_Waiting") -> FloatArray:
        payload = waiting.payload
        try:
            samples = self._decoder_for(payload).decode(payload.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            return self._guess()
        skipped = (self._place or 0) - self._timeline.position(payload.timestamp)
        self.reception.stats.packets_recovered += not waiting.own
        self._guessed = 0
        return self._go_on(samples[skipped:], fresh=self._apart)

    def _bridge(self, size: int, following: Payload) -> FloatArray:
        """Guess what was lost before a packet that is here."""
        try:
            guess = self._decoder_for(following).conceal(size, following.content)
        except PacketError:
            return self._guess()
        self._count_guess(size)
        return self._go_on(guess, fresh=self._apart)

    def _guess(self) -> FloatArray:
        """Go on for a packet's length with nothing to go by: a guess that fades, and then silence."""
        size, was_silent = self._packet_size, self._guessed > _LONGEST_BRIDGE
        self._count_guess(size)
        if self._decoder is not None and self._guessed <= _LONGEST_BRIDGE:
            sound = self._go_on(self._decoder.conceal(size, None), fresh=self._apart)
        else:
            sound = self._go_on(np.zeros((size, self._channels), np.float32), fresh=not was_silent)
        self._apart = True
        return sound

    def _count_guess(self, size: int) -> None:
        self.reception.stats.samples_concealed += size
        self.reception.stats.concealment_events += self._guessed == 0
        self._guessed += size

    def _go_on(self, samples: FloatArray, *, fresh: bool) -> FloatArray:
        """Join samples to what went before; where they are fresh, fade from the one into the other."""
        assert self._place is not None
        samples = np.broadcast_to(samples[:, : self._channels], (len(samples), self._channels))
        self._place += len(samples)
        self.reception.stats.samples_received += len(samples)
        self._apart = False
        if fresh:
            self._fading = mirror(self._last[::-1], FADE)
        length = min(len(self._fading), len(samples))
        if length:
            old, self._fading = self._fading[:length], self._fading[length:]
            new, rest = samples[:length], samples[length:]
            angle = _FADE_ANGLES[FADE - len(self._fading) - length :][:length]
            samples = np.concatenate([np.cos(angle) * old + np.sin(angle) * new, rest])
        self._last = np.concatenate([self._last, samples])[-FADE:]
        return samples

    def _forget_the_past(self, place: int) -> None:
        for start in [start for start, waiting in self._waiting.items() if waiting.end <= place]:
            del self._waiting[start]

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
