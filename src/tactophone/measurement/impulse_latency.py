"""Analysis of the latency from impulses to vibration, without devices or processes.

The latency of each impulse is measured twice: by counting samples of one sound clock, and by the marks that both sides
record on the system clock.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.telemetry import STAGES
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray

BURST = 0.03
"""Seconds of an impulse: the shortest burst that is felt as vibration (Sci. Rep. 2025, 15:5057)."""

TONE = 300.0
"""Hz of an impulse: near the best sensitivity of the skin, and within every codec's band."""

PEAK = 0.8
"""Amplitude of an impulse; its first sample is the highest."""

INTERVALS = (0.22, 0.27)
"""Range of seconds between impulses, uniform: the vibration has faded 10 ms before, as it ends 197 ms after an impulse
at the latest (512 samples, Opus 10 ms), and every phase of the period occurs."""

FIRST = 1e-4
"""Amplitude above which a sample vibrates, 80 dB below full drive; at rest, every sample is exactly zero."""

LONGEST = 0.15
"""Seconds after which an impulse counts as missed."""

WARM_UP = 1.5
"""Seconds of sound before the first impulse, in which estimators converge."""


@dataclass(frozen=True, slots=True, eq=False)
class ImpulseLatency:
    """The measured latencies, one entry for each impulse, in seconds."""

    impulses: int
    """Number played; missed impulses are in no array."""
    end_to_end: NDArray[np.float64]
    """By counted samples."""
    stages: dict[str, NDArray[np.float64]]
    """By marks, for each stage of `tactophone.telemetry.STAGES`; only impulses with all marks."""
    disagreement: float
    """Difference between the mean end-to-end latency of those impulses and the mean sum of their stages."""
    period: int
    """Samples of a period of the JACK server."""
    restarts: int = 0
    """Number of times that a side was restarted; later impulses are missed, as it stays muted."""

    @property
    def missed(self) -> int:
        """Number of impulses that caused no vibration."""
        return self.impulses - len(self.end_to_end)


class ImpulsePlayer:
    """Plays impulses and records the vibration; ``process`` is for a JACK client and allocates nothing."""

    def __init__(self, impulses: int, *, seed: int = 0) -> None:
        gaps = np.random.default_rng([0xC11C, seed]).uniform(*INTERVALS, impulses) * LIVE_SAMPLE_RATE
        self.impulses: NDArray[np.int64] = (WARM_UP * LIVE_SAMPLE_RATE + np.cumsum(gaps)).astype(np.int64)
        size = int(self.impulses[-1] + INTERVALS[1] * LIVE_SAMPLE_RATE)
        self.played, self.vibration = np.zeros(size, np.float32), np.zeros(size, np.float32)
        burst = PEAK * np.cos(2 * np.pi * TONE * np.arange(int(BURST * LIVE_SAMPLE_RATE)) / LIVE_SAMPLE_RATE)
        for impulse in self.impulses:
            self.played[impulse : impulse + len(burst)] = burst
        self.position = 0
        self._cycles = np.full((size // 16, 2), np.nan)
        self._count = 0

    @property
    def done(self) -> bool:
        """Whether all impulses were played and the time for their vibration has passed."""
        return self.position >= len(self.played)

    @property
    def cycles(self) -> NDArray[np.float64]:
        """The start of each period: its first sample, and the system clock in s; shape ``(periods, 2)``."""
        return self._cycles[: self._count]

    def process(self, inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        """Play and record a period, as the JACK callback."""
        size, position = len(outputs[0]), self.position
        if position + size > len(self.played) or self._count >= len(self._cycles):
            self.position = len(self.played)
            for output in outputs:
                output[:] = 0.0
            return
        self._cycles[self._count] = position, time.monotonic()
        self._count += 1
        for output in outputs:
            output[:] = self.played[position : position + size]
        self.vibration[position : position + size] = inputs[0]
        self.position = position + size

    def onsets(self) -> Iterator[tuple[int, int]]:
        """Yield each impulse that caused vibration, and the first sample that vibrates after it."""
        for impulse in self.impulses:
            after = self.vibration[impulse : impulse + int(LONGEST * LIVE_SAMPLE_RATE)]
            found = np.flatnonzero(np.abs(after) > FIRST)
            if len(found) and not np.abs(self.vibration[impulse - 480 : impulse]).max() > FIRST:
                yield int(impulse), int(impulse + found[0])

    def clock(self, sample: int) -> float:
        """Return the system clock (s) at a sample, counted from the start of its period."""
        start, begun = self.cycles[np.searchsorted(self.cycles[:, 0], sample, side="right") - 1]
        return float(begun + (sample - start) / LIVE_SAMPLE_RATE)


def analyse(player: ImpulsePlayer, marks: dict[str, NDArray[np.void]], *, period: int) -> ImpulseLatency:
    """Follow the packet of each impulse through the marks."""
    onsets = list(player.onsets())
    found = [_moments(player, marks, impulse, onset) for impulse, onset in onsets]
    complete = [pair for pair, moments in zip(onsets, found, strict=True) if moments]
    followed = np.array([(onset - impulse) / LIVE_SAMPLE_RATE for impulse, onset in complete])
    # Rows are impulses; the differences of nine successive moments are the durations of the eight stages.
    table = np.diff(np.array([moments for moments in found if moments]).reshape(-1, len(STAGES) + 1), axis=1)
    return ImpulseLatency(
        impulses=len(player.impulses),
        end_to_end=np.array([(onset - impulse) / LIVE_SAMPLE_RATE for impulse, onset in onsets]),
        stages={stage: table[:, index] for index, stage in enumerate(STAGES)},
        disagreement=float(abs(table.sum(axis=1).mean() - followed.mean())) if len(followed) else float("nan"),
        period=period,
    )


def _moments(player: ImpulsePlayer, marks: dict[str, NDArray[np.void]], impulse: int, onset: int) -> list[float] | None:
    """Return the nine moments that bound the eight stages; ``None`` when a mark is missing."""
    period_start = player.cycles[np.searchsorted(player.cycles[:, 0], impulse, side="right") - 1, 1]
    captured = _first_after(marks["captured"], period_start)
    # The operator's callback of the same period ran before the player's, so its mark is the last one before it.
    played = player.cycles[np.searchsorted(player.cycles[:, 0], onset, side="right") - 1, 1]
    rendered = _last_before(marks["rendered"], played)
    if captured is None or rendered is None:
        return None
    end = int(rendered["position"])
    times = [_time_at(marks[name], end) for name in ("sent", "received", "released", "decoded", "detected")]
    found = [moment for moment in times if moment is not None]
    if len(found) < len(times):
        return None
    return [player.clock(impulse), float(captured["time"]), *found, float(rendered["time"]), player.clock(onset)]


def _first_after(marks: NDArray[np.void], moment: float) -> np.void | None:
    index = int(np.searchsorted(marks["time"], moment))
    return marks[index] if index < len(marks) else None


def _last_before(marks: NDArray[np.void], moment: float) -> np.void | None:
    index = int(np.searchsorted(marks["time"], moment)) - 1
    return marks[index] if index >= 0 else None


def _time_at(marks: NDArray[np.void], end: int) -> float | None:
    """Return the time of the first mark at an RTP timestamp or less than half a second after it."""
    beyond = (marks["position"] - end) % (1 << 32)
    found = np.flatnonzero(beyond < LIVE_SAMPLE_RATE // 2)
    return float(marks["time"][found[0]]) if len(found) else None
