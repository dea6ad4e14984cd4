"""Clicks, the vibration that answers them, and what both tell of the way between: no device, no process.

Each click is followed twice: by counting samples of one sound clock, and through the marks that both sides leave on
the machine's clock.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.telemetry import STAGES
from tactophone.types import FloatArray

RATE = 48_000
BURST = 0.03
"""Seconds of a click: the shortest burst that is felt as vibration (Sci. Rep. 2025, 15:5057)."""

TONE = 300.0
"""Hz of a click: where the sense of vibration is best, and within every codec's band."""

PEAK = 0.8
"""Of a click; its first sample is already the highest."""

INTERVALS = (0.2, 0.25)
"""Seconds between clicks, drawn evenly: the vibration has faded by then, and every phase of the period comes up."""

FIRST = 1e-4
"""Amplitude from which a sample vibrates, 80 dB under full drive; at rest, every sample is exactly zero."""

LONGEST = 0.15
"""Seconds after which a click counts as missed."""

WARM_UP = 1.5
"""Seconds of sound before the first click, in which estimates settle."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What was measured, one entry a click, in seconds.

    Parameters
    ----------
    clicks
        How many were played; those missed are in no array.
    end_to_end
        By samples counted.
    stages
        By marks; for each stage of `tactophone.telemetry.STAGES`, of the clicks whose marks were all found.
    disagreement
        Between the mean of those clicks end to end and the mean of their stages' sum.
    period
        Samples a period of the JACK server.
    restarts
        Times that a side had to be begun again meanwhile; clicks after one are missed, as it stays muted.
    """

    clicks: int
    end_to_end: NDArray[np.float64]
    stages: dict[str, NDArray[np.float64]]
    disagreement: float
    period: int
    restarts: int = 0

    @property
    def missed(self) -> int:
        """Clicks that were not felt."""
        return self.clicks - len(self.end_to_end)


class Clicker:
    """Plays clicks and records the vibration; ``process`` is for a JACK client. Everything is allocated beforehand."""

    def __init__(self, clicks: int, *, seed: int = 0) -> None:
        gaps = np.random.default_rng([0xC11C, seed]).uniform(*INTERVALS, clicks) * RATE
        self.clicks: NDArray[np.int64] = (WARM_UP * RATE + np.cumsum(gaps)).astype(np.int64)
        size = int(self.clicks[-1] + INTERVALS[1] * RATE)
        self.played, self.felt = np.zeros(size, np.float32), np.zeros(size, np.float32)
        burst = PEAK * np.cos(2 * np.pi * TONE * np.arange(int(BURST * RATE)) / RATE)
        for click in self.clicks:
            self.played[click : click + len(burst)] = burst
        self.position = 0
        self._cycles = np.full((size // 16, 2), np.nan)
        self._count = 0

    @property
    def done(self) -> bool:
        """Whether all clicks have been played and their vibration has had its time."""
        return self.position >= len(self.played)

    @property
    def cycles(self) -> NDArray[np.float64]:
        """When each period began: its first sample, and the machine's clock in s."""
        return self._cycles[: self._count]

    def process(self, inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        """Be the JACK callback."""
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
        self.felt[position : position + size] = inputs[0]
        self.position = position + size

    def onsets(self) -> Iterator[tuple[int, int]]:
        """Give each click that was felt, with the first sample that vibrates after it."""
        for click in self.clicks:
            found = np.flatnonzero(np.abs(self.felt[click : click + int(LONGEST * RATE)]) > FIRST)
            if len(found) and not np.abs(self.felt[click - 480 : click]).max() > FIRST:
                yield int(click), int(click + found[0])

    def clock(self, sample: int) -> float:
        """The machine's clock at a sample: its period's beginning, and as far as it lies within."""
        start, begun = self.cycles[np.searchsorted(self.cycles[:, 0], sample, side="right") - 1]
        return float(begun + (sample - start) / RATE)


def analyse(clicker: Clicker, marks: dict[str, NDArray[np.void]], *, period: int) -> Measured:
    """Follow each click's packet through the marks."""
    felt = list(clicker.onsets())
    found = [_moments(clicker, marks, click, onset) for click, onset in felt]
    followed = np.array(
        [(onset - click) / RATE for (click, onset), moments in zip(felt, found, strict=True) if moments]
    )
    table = np.diff(np.array([moments for moments in found if moments]).reshape(-1, len(STAGES) + 1), axis=1)
    return Measured(
        clicks=len(clicker.clicks),
        end_to_end=np.array([(onset - click) / RATE for click, onset in felt]),
        stages={stage: table[:, index] for index, stage in enumerate(STAGES)},
        disagreement=float(abs(table.sum(axis=1).mean() - followed.mean())) if len(followed) else float("nan"),
        period=period,
    )


def _moments(clicker: Clicker, marks: dict[str, NDArray[np.void]], click: int, onset: int) -> list[float] | None:
    """Give the nine moments between which the eight stages lie; ``None`` when a mark of them is missing."""
    began = clicker.cycles[np.searchsorted(clicker.cycles[:, 0], click, side="right") - 1, 1]
    captured = _first_after(marks["captured"], began)
    # The operator's callback of the same period ran before the clicker's, so its mark is the last one before it.
    played = clicker.cycles[np.searchsorted(clicker.cycles[:, 0], onset, side="right") - 1, 1]
    rendered = _last_before(marks["rendered"], played)
    if captured is None or rendered is None:
        return None
    end = int(rendered["position"])
    times = [_time_at(marks[name], end) for name in ("sent", "received", "released", "decoded", "judged")]
    found = [moment for moment in times if moment is not None]
    if len(found) < len(times):
        return None
    return [clicker.clock(click), float(captured["time"]), *found, float(rendered["time"]), clicker.clock(onset)]


def _first_after(marks: NDArray[np.void], moment: float) -> np.void | None:
    index = int(np.searchsorted(marks["time"], moment))
    return marks[index] if index < len(marks) else None


def _last_before(marks: NDArray[np.void], moment: float) -> np.void | None:
    index = int(np.searchsorted(marks["time"], moment)) - 1
    return marks[index] if index >= 0 else None


def _time_at(marks: NDArray[np.void], end: int) -> float | None:
    """When sound up to a timestamp had come: at the first mark at it or less than half a second beyond."""
    beyond = (marks["position"] - end) % (1 << 32)
    found = np.flatnonzero(beyond < RATE // 2)
    return float(marks["time"][found[0]]) if len(found) else None
