"""A clocked buffer for the profiles that render the sound itself: constant delay, two
clocks reconciled, no clicks.

Packets wait here, still encoded, until they are due. On each pull the buffer decodes
what the block needs, conceals what is missing, and resamples it at the speed that its
`PlayoutController` computes, by libsamplerate's sinc interpolator (20 samples of delay,
120 dB). Where the sound is discontinuous (a jump of the position, the end of a longer
gap), the old sound fades out while the new sound fades in.

The controller decides which position of the stream to play, without any sound. It
follows *the newest sample that the empty network would have delivered by now, less a
margin*. The first part is the minimum transit time of each second, which neither loss
nor jitter moves (:mod:`~net.link.stats`); a slow proportional-integral loop turns the
rest into a speed. A loop on the buffer level or on arrival times, the usual design, is
unstable at 2 ms of jitter; this loop holds the clock ratio to a few ppm (both
measured).

The margin is one packet, the block to render, and an allowance for jitter: the lateness
that 1 packet in 1000 exceeds, learned during `PLAYOUT_WARM_UP` before anything is
played. It grows as soon as 1 packet in 250 is too late, and shrinks when half was
enough for a thousand packets. Changes are played a little faster or slower, by `SLEW`,
a ninth of the smallest change of frequency that a finger notices (Pongrac 2008). Only
an error above `JUMP` sets the position anew.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import ConfigError, PacketError
from tactophone.core.types import FloatArray
from tactophone.net.link.codec import Decoder, mirror, open_decoder
from tactophone.net.link.packet import CLOCK_RATE, Packet, Payload, TimestampUnwrapper
from tactophone.net.link.stats import Reception

TIME_CONSTANT = 8.0
"""Seconds of the loop, whose damping is 0.7 (`PlayoutController._steer`): slow against
jitter, fast against the drift of quartz."""

MAX_SKEW = 400e-6
"""Limit of the integral, as a ratio: twice the worst pair of sound cards."""

SLEW = 0.02
"""Maximum relative change of speed on the way to a changed margin: 20 ms in a
second."""

DEAD_BAND = 0.002
"""Seconds of error up to which only the slow loop acts; above, the position slews."""

JUMP = 0.04
"""Seconds of error above which the position is set anew: slewing would take more than
two seconds."""

MIN_ALLOWANCE = 0.002
"""Shortest allowance for jitter, in seconds."""

MAX_ALLOWANCE = 0.04
"""Longest allowance for jitter, in seconds. A packet that is later belongs to a stall,
which playout does not wait for. With a packet and a period of 512 samples, the margin
stays under the 60 ms from which sound counts as stale."""

PLAYOUT_WARM_UP = 0.25
"""Seconds of measuring before the first sound."""

_TARGET_LATE = 1 / 1000
"""Share of late packets that a new allowance is computed for."""

_MAX_LATE = 1 / 250
"""Share of late packets above which the allowance grows."""

_LONG = 4_000
"""Packets by which the allowance grows: 20 seconds of 5 ms each."""

_SHORT = 1_000
"""Packets by which the allowance shrinks: 5 seconds of 5 ms each."""

_SHRINK = 0.5
"""The allowance shrinks when this part of it would have been enough; hysteresis against
chance."""

_PATH_CHANGED = 20
"""Late packets in a row that mean a longer path, not jitter."""


@dataclass(frozen=True, slots=True)
class Step:
    """How to render the next block: stream samples for each rendered one, and whether
    the position was set anew."""

    speed: float
    jumped: bool = False


class PlayoutController:
    """Controls the playout of one stream; positions are in samples of the sender, times
    in s of the local clock.

    ``position``: the next sample to play; NaN before the first.
    """

    def __init__(self, *, block_size: int) -> None:
        self.position = math.nan
        self._block_size = block_size
        self._packet_size = 0
        self._first = math.inf
        self._arrived = -math.inf
        self._min_transit = math.inf
        self._allowance = Allowance()
        self._second = _Second()
        # The loop's estimate of how much faster the sender's clock runs than the local
        # one, as a ratio less 1.
        self._integral = 0.0
        self._speed = 1.0
        self._late: list[float] = []

    @property
    def margin(self) -> float:
        """Seconds from the play position to the newest sample that the empty network
        would have delivered."""
        return (
            self._packet_size + self._block_size
        ) / CLOCK_RATE + self._allowance.duration

    def push(self, start: int, size: int, *, now: float) -> None:
        """Add the arrival of a packet of ``size`` samples from position ``start``."""
        self._packet_size = size
        transit = now - (start + size) / CLOCK_RATE
        self._second.min_transit = min(self._second.min_transit, transit)
        self._min_transit = min(self._min_transit, transit)
        if now != self._arrived:
            # Packets that come together waited for the same cause: the first, which
            # waited longest, stands for all.
            self._arrived = now
            self._allowance.push(transit - self._min_transit)
        self._late = [*self._late, transit] if start < self.position else []
        if len(self._late) >= _PATH_CHANGED:
            # This is no jitter any more: the path has become longer. The lateness known
            # so far was measured against the shorter one.
            self._min_transit = min(self._late)
            self._late = []
            self._allowance.reset()

    def step(self, size: int, *, now: float) -> Step:
        """Advance by ``size`` samples rendered at ``now``; `position` is NaN until
        there is something to play."""
        if not self._warmed_up(now):
            return Step(1.0)
        target = (now - self._min_transit - self.margin) * CLOCK_RATE
        # An error this large is no drift: it is the first sample, a stall, or a pause
        # of the listener. Written so that a position of NaN, before the first, jumps
        # too.
        jumped = not abs(target - self.position) < JUMP * CLOCK_RATE
        if jumped:
            self.position = target
        second = self._second
        second.begun = now if math.isnan(second.begun) else second.begun
        second.error_sum += (target - self.position) / CLOCK_RATE
        second.steps += 1
        if now - second.begun >= 1.0:
            self._steer(second.error_sum / second.steps)
            if math.isfinite(second.min_transit):
                # The path of the second that has ended. A small change is drift or
                # chance, so half of it is believed; a larger one is another path, and
                # is taken over whole.
                change = second.min_transit - self._min_transit
                self._min_transit = (
                    second.min_transit
                    if abs(change) > DEAD_BAND
                    else self._min_transit + change / 2
                )
            self._second = _Second(now)
            self._allowance.update()
        # The position moves at the speed of the last second's end, until the next.
        self.position += size * self._speed
        return Step(self._speed, jumped)

    def _warmed_up(self, now: float) -> bool:
        if not math.isnan(self.position):
            return True
        self._first = min(
            self._first, now if math.isfinite(self._min_transit) else math.inf
        )
        if now - self._first < PLAYOUT_WARM_UP:
            return False
        self._allowance.update()
        return True

    def _steer(self, error: float) -> None:
        """Set the speed from the mean error of the last second, in s."""
        # A loop of the second order. With e the error, r the clocks' difference and T
        # the time constant, the speed 1 + i + e/T with i' = e/(2 T^2) gives e' = r - i
        # - e/T, so e'' + e'/T + e/(2 T^2) = 0 for a constant r: the natural frequency
        # is 1/(T sqrt 2), 14 mHz, and the damping 1/sqrt 2. The proportional part alone
        # would leave a constant error of r T; the integral takes it over, and is
        # therefore the estimate of the skew. One step a second is short against the 11
        # s of 1/frequency, so the loop may be computed as if it were continuous.
        if abs(error) > DEAD_BAND:
            # A changed margin, not skew: the integral stays as it is, or it would wind
            # up while the position slews.
            self._speed = (
                1 + self._integral + math.copysign(min(SLEW, abs(error)), error)
            )
            return
        self._integral += error / (2 * TIME_CONSTANT**2)
        self._integral = max(-MAX_SKEW, min(self._integral, MAX_SKEW))
        self._speed = 1 + self._integral + error / TIME_CONSTANT


class Allowance:
    """The allowance for jitter, in seconds."""

    def __init__(self) -> None:
        self.duration = MIN_ALLOWANCE
        self._lateness: deque[float] = deque(maxlen=_LONG)

    def push(self, lateness: float) -> None:
        """Add a packet's lateness (s) against the empty network; packets of a stall are
        left out."""
        if lateness <= MAX_ALLOWANCE:
            self._lateness.append(lateness)

    def update(self) -> None:
        """Grow if too many packets were late, shrink if few would be; call it once a
        second."""
        lateness = np.array(self._lateness)
        newest = lateness[-_SHORT:]
        if lateness.size and (lateness > self.duration).mean() > _MAX_LATE:
            self.duration = _allowance_for(lateness)
        elif len(newest) == _SHORT and _allowance_for(newest) < _SHRINK * self.duration:
            self.duration = _allowance_for(newest)

    def reset(self) -> None:
        """Drop the measurements of a path that has changed."""
        self._lateness.clear()


def _allowance_for(lateness: NDArray[np.float64]) -> float:
    needed = (
        np.quantile(lateness, 1 - _TARGET_LATE) + MIN_ALLOWANCE / 2
        if lateness.size
        else MIN_ALLOWANCE
    )
    return float(np.clip(needed, MIN_ALLOWANCE, MAX_ALLOWANCE))


@dataclass(slots=True)
class _Second:
    """What is measured in a second: the minimum transit time, and the mean error."""

    begun: float = math.nan
    min_transit: float = math.inf
    error_sum: float = 0.0
    steps: int = 0


MAX_EXTRAPOLATION = 0.02
"""Seconds of missing sound that are extrapolated in a row; after them there is
silence."""

CONCEALMENT_FADE = 120
"""Samples of a fade: 2.5 ms, a twelfth of the shortest burst felt as vibration (Sci.
Rep. 15:5057, 2025)."""

_QUEUE_SIZE = 400
"""Packets kept while nothing is pulled, and payloads that wait until they are due: a
second of 2.5 ms each."""

_SHORTEST = 48
"""Samples of a packet, 1 ms, down to which a block is decoded whole; Opus has packets
of 2.5 ms and more, and a robot's microphones periods of at least 1 ms."""

_FADE_ANGLES = np.linspace(0, np.pi / 2, CONCEALMENT_FADE, dtype=np.float32)[
    :, np.newaxis
]
"""Angles of a fade, shape ``(CONCEALMENT_FADE, 1)``: their cosine and sine keep the
power of the two sounds constant."""

_MAX_EXTRAPOLATED = round(MAX_EXTRAPOLATION * CLOCK_RATE)
"""`MAX_EXTRAPOLATION` in samples."""


@dataclass(frozen=True, slots=True)
class _QueuedPayload:
    payload: Payload
    primary: bool
    """Whether it is its packet's own payload, not a redundant copy in a later
    packet."""
    end: int


class Playout:
    """Decodes one stream of packets by the listener's clock.

    ``push`` only queues, so that a network thread may call it while an actuator's
    thread calls ``pull``. ``channels`` counts the channels of the output: a mono stream
    fills both, and the first channel of a stereo stream is contact.

    ``controller``: the delay, the margin and the clock skew of the playout.
    """

    latency = 20 / CLOCK_RATE
    """Seconds that the interpolator adds to the controller's delay."""

    def __init__(self, *, block_size: int, channels: int = 2) -> None:
        self.reception = Reception()
        self.controller = PlayoutController(block_size=block_size)
        self.block_size = block_size
        self._channels = channels
        self._arrived: deque[tuple[Packet, float]] = deque(maxlen=_QUEUE_SIZE)
        self._waiting: dict[int, _QueuedPayload] = {}
        self._timestamps = TimestampUnwrapper()
        self._packet_size = 0
        self._decoder: Decoder | None = None
        self._resampler = _open_resampler(channels)
        self._position: int | None = None
        self._decoded = self._ready = np.zeros((0, channels), np.float32)
        self._last = np.zeros((CONCEALMENT_FADE, channels), np.float32)
        self._fading = self._last[:0]
        self._extrapolated = 0
        self._discontinuous = True

    def push(self, packet: Packet, *, now: float) -> None:
        """Queue a packet, in any order."""
        self._arrived.append((packet, now))

    def pull(self, *, now: float) -> FloatArray:
        """Return the block due at ``now`` (s), shape ``(block_size, channels)``;
        silence where there is no sound."""
        while self._arrived:
            self._accept(*self._arrived.popleft())
        step = self.controller.step(self.block_size, now=now)
        if math.isnan(self.controller.position):
            return np.zeros((self.block_size, self._channels), np.float32)
        if step.jumped:
            # What is decoded already belongs to the old position; the new sound fades
            # in over it.
            self._position = round(self.controller.position - self.block_size)
            self._decoded = self._decoded[:0]
            self._discontinuous = True
        # The resampler returns a varying number of samples; what exceeds the block is
        # kept for the next pull.
        while len(self._ready) < self.block_size:
            needed = math.ceil((self.block_size - len(self._ready)) * step.speed) + 1
            block = self._resampler.process(self._read(needed), 1 / step.speed)
            self._ready = np.concatenate(
                [self._ready, block.reshape(-1, self._channels)]
            )
        block = self._ready[: self.block_size]
        self._ready = self._ready[self.block_size :]
        return block

    def _accept(self, packet: Packet, now: float) -> None:
        own = packet.payload
        if not self.reception.count(packet.sequence, own.timestamp, now=now):
            return
        start = self._timestamps.position(own.timestamp)
        size = self._keep(start, own, primary=True)
        if not size:
            return
        self._packet_size = size
        self.controller.push(start, size, now=now)
        if self._position is not None:
            self.reception.came_late(start, self._position)
        for payload in packet.earlier:
            self._keep(
                self._timestamps.position(payload.timestamp), payload, primary=False
            )

    def _keep(self, start: int, payload: Payload, *, primary: bool) -> int:
        """Store a payload until it is due; return its size in samples, 0 when it is
        broken."""
        try:
            size = self._decoder_for(payload).size(payload.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            return 0
        if primary or start not in self._waiting:
            self._waiting[start] = _QueuedPayload(payload, primary, start + size)
        if len(self._waiting) > _QUEUE_SIZE:
            # What lies furthest ahead may never be due, where timestamps jump.
            del self._waiting[max(self._waiting)]
        return size

    def _read(self, size: int) -> FloatArray:
        # A robot that sends a sample a packet must not make a period take longer than
        # it lasts: what is missing after so many packets is silence.
        for _ in range(2 + size // _SHORTEST):
            if len(self._decoded) >= size:
                break
            following = self._next(size - len(self._decoded))
            self._decoded = np.concatenate([self._decoded, following])
        else:
            missing = max(0, size - len(self._decoded))
            silence = np.zeros((missing, self._channels), np.float32)
            self._decoded = np.concatenate([self._decoded, silence])
            self._position = (self._position or 0) + missing
            self._discontinuous = True
        sound = self._decoded[:size]
        self._decoded = self._decoded[size:]
        return sound

    def _next(self, needed: int) -> FloatArray:
        """Decode, conceal or extrapolate the sound at the position, of which ``needed``
        samples are due."""
        assert self._position is not None
        for start in [
            start
            for start, waiting in self._waiting.items()
            if waiting.end <= self._position
        ]:
            del self._waiting[start]
        following = min(self._waiting, default=None)
        if following is None or following - self._position > _MAX_EXTRAPOLATED:
            return self._extrapolate(needed)
        if following > self._position:
            return self._conceal(
                following - self._position, self._waiting[following].payload
            )
        return self._decode(self._waiting.pop(following), needed)

    def _decode(self, waiting: "_QueuedPayload", needed: int) -> FloatArray:
        payload = waiting.payload
        try:
            samples = self._decoder_for(payload).decode(payload.content)
        except PacketError:
            self.reception.stats.packets_broken += 1
            return self._extrapolate(needed)
        # A payload may begin before the position, after a jump into its middle.
        skipped = (self._position or 0) - self._timestamps.position(payload.timestamp)
        self.reception.stats.packets_recovered += not waiting.primary
        self._extrapolated = 0
        return self._append(samples[skipped:], fade=self._discontinuous)

    def _conceal(self, size: int, following: Payload) -> FloatArray:
        try:
            samples = self._decoder_for(following).conceal(size, following.content)
        except PacketError:
            return self._extrapolate(size)
        self._count_concealed(size)
        return self._append(samples, fade=self._discontinuous)

    def _extrapolate(self, needed: int) -> FloatArray:
        """Continue without a following payload for a packet's length, or for what is
        due if that is longer: fading sound at first, then silence."""
        size = max(self._packet_size, min(needed, _MAX_EXTRAPOLATED))
        was_silent = self._extrapolated > _MAX_EXTRAPOLATED
        self._count_concealed(size)
        if self._decoder is not None and self._extrapolated <= _MAX_EXTRAPOLATED:
            sound = self._append(
                self._decoder.conceal(size, None), fade=self._discontinuous
            )
        else:
            sound = self._append(
                np.zeros((size, self._channels), np.float32), fade=not was_silent
            )
        self._discontinuous = True
        return sound

    def _count_concealed(self, size: int) -> None:
        self.reception.stats.samples_concealed += size
        self._extrapolated += size

    def _append(self, samples: FloatArray, *, fade: bool) -> FloatArray:
        """Advance by ``samples``; with ``fade``, cross-fade from the sound before into
        them."""
        assert self._position is not None
        samples = np.broadcast_to(
            samples[:, : self._channels], (len(samples), self._channels)
        )
        self._position += len(samples)
        self.reception.stats.samples_received += len(samples)
        self._discontinuous = False
        if fade:
            # The sound before is continued by its mirror image, which starts where it
            # ended.
            self._fading = mirror(self._last[::-1], CONCEALMENT_FADE)
        length = min(len(self._fading), len(samples))
        if length:
            # A fade may span several calls: the angles go on where the last call
            # stopped.
            old = self._fading[:length]
            self._fading = self._fading[length:]
            new = samples[:length]
            rest = samples[length:]
            done = CONCEALMENT_FADE - len(self._fading) - length
            angle = _FADE_ANGLES[done:][:length]
            samples = np.concatenate([np.cos(angle) * old + np.sin(angle) * new, rest])
        self._last = np.concatenate([self._last, samples])[-CONCEALMENT_FADE:]
        return samples

    def _decoder_for(self, payload: Payload) -> Decoder:
        if self._decoder is None:
            self._decoder = open_decoder(payload.kind)
        if self._decoder.kind != payload.kind:
            raise PacketError(
                f"a payload of {payload.kind.name} in a stream of "
                f"{self._decoder.kind.name}"
            )
        return self._decoder


def _open_resampler(channels: int) -> Any:
    try:
        import samplerate
    except ImportError as error:
        raise ConfigError(
            "clocked playout needs: pip install 'tactophone[link]'"
        ) from error
    return samplerate.Resampler("sinc_fastest", channels=channels)
