"""The stone box: find the two rough stones of five by touch alone, in a browser.

Here are the rules as values, without clock or network. The order of the stones stays on
the server until the curtain is lifted.
"""

import json
import math
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import Touch

# The stones lie as in `simulation.motion.five_stones`.
PITCH = 0.11
"""Metres from stone to stone."""

WIDTH = 0.085
"""Metres along the row that a stone takes."""

DEPTH = 0.07
"""Metres across the row that a stone takes."""

SLOT_MARGIN = 0.015
"""Metres that the finger can reach beyond the stones."""

LIFTED_PRESSURE = -0.1
"""Newtons of a lifted finger: negative, so that it rises, but little, so that a press
reaches the stone soon."""

GREATEST_FORCE = 5.0
"""Newtons: the strongest press in free exploration of textures (Tanaka et al., PLoS One
9, 2014)."""

SHORTEST_STROKE = 0.01
"""Metres over a stone, without a reversal, that count as a stroke."""


@dataclass(frozen=True, slots=True)
class GameSettings:
    """What the page's server needs."""

    name: str
    """Name of the operator's run, whose vibration the page plays."""
    orders: Sequence[Sequence[Touch]]
    """Orders of the stones, round after round, then from the first again."""
    seed: int
    """Seed of the first round; each further round adds 1."""
    finger: Connection
    """Connection to the finger; takes ``("lay", order, seed)`` and ``("move", x, y,
    force)``."""
    results: Path
    """File to which results are appended, one line of JSON per round."""


@dataclass(frozen=True, slots=True)
class Point:
    """A target of the finger: time in s, place in m, force in N (negative: lifted)."""

    time: float
    x: float
    y: float
    force: float

    @property
    def stone(self) -> int:
        """Index of the stone under pressure; -1 for none."""
        index, within = divmod(self.x, PITCH)
        pressed = (
            self.force > 0
            and 0 <= index < 5
            and within <= WIDTH
            and 0 <= self.y <= DEPTH
        )
        return int(index) if pressed else -1


@dataclass(frozen=True, slots=True)
class RoundResult:
    """The result of a round."""

    finished: str
    """Date and time, ISO 8601 with zone."""
    seed: int
    order: tuple[str, ...]
    choices: tuple[int, ...]
    """`order` and `choices`: the stones' labels from left to right, and the 0-based
    indices of those chosen as rough."""
    correct: int
    """How many choices are rough."""
    duration: float
    """Seconds from the first touch to the choice."""
    strokes: tuple[int, ...]
    """Number of strokes, per stone."""
    trainer: bool = False
    """Whether the player saw the truth and the detector's decision."""
    round_trip: float | None = None
    """Median seconds from press to sound; ``None`` if not measured."""
    false_bumps: int | None = None
    dips: int | None = None
    """`false_bumps` and `dips`: how often smooth was rendered as rough, and rough
    interrupted within one touch."""

    def append(self, path: Path) -> None:
        """Write it to the file's end; a line that a full disk has cut stays by
        itself."""
        with path.open("ab+") as file:
            size = file.seek(0, os.SEEK_END)
            file.seek(max(0, size - 1))
            cut = file.read() not in (b"", b"\n")
            file.write(b"\n" * cut + json.dumps(asdict(self)).encode() + b"\n")


class Round:
    """A round in progress.

    >>> smooth, rough = Touch.SMOOTH, Touch.ROUGH
    >>> game = Round((rough, smooth, smooth, rough, smooth), seed=1)
    >>> for k in range(5):
    ...     game.touch(Point(0.1 * k, 0.02 + 0.01 * k, 0.03, 1.5))
    >>> game.strokes, game.truth(Point(1.0, 0.02, 0.03, 1.5)).name
    ([1, 0, 0, 0, 0], 'ROUGH')
    >>> game.finish([0, 2], Point(9.4, 0, 0, LIFTED_PRESSURE), finished="now").correct
    1
    """

    def __init__(
        self, order: Sequence[Touch], *, seed: int, trainer: bool = False
    ) -> None:
        self.order = tuple(order)
        self.seed = seed
        self.trainer = trainer
        self.strokes = [0] * len(order)
        self.here: Point | None = None
        self.path: list[Point] = []
        self.round_trips: list[float] = []
        self._distance = 0.0
        self._counted = False

    def touch(self, point: Point, *, kept: bool = True) -> None:
        """Move to a target; count a stroke when the finger has moved `SHORTEST_STROKE`
        over one stone. ``kept``: whether the target joins the path of the result."""
        last = self.here or point
        self.here = point
        if kept:
            self.path.append(point)
        step = point.x - last.x
        # A lift, another stone or a reversal ends the stroke.
        if point.stone < 0 or last.stone != point.stone or step * self._distance < 0:
            self._distance = 0.0
            self._counted = False
        self._distance += step if point.stone == last.stone else 0.0
        if (
            point.stone >= 0
            and not self._counted
            and abs(self._distance) >= SHORTEST_STROKE
        ):
            self._counted = True
            self.strokes[point.stone] += 1

    def truth(self, point: Point) -> Touch:
        return Touch.NONE if point.stone < 0 else self.order[point.stone]

    def finish(
        self, choices: Sequence[int], now: Point, *, finished: str
    ) -> RoundResult:
        """Score the player's choice of the two rough stones.

        Raises `ValueError` if the choice is not two different stones.
        """
        chosen = tuple(sorted(set(choices)))
        if len(chosen) != 2 or not all(
            0 <= stone < len(self.order) for stone in chosen
        ):
            raise ValueError(
                f"choices are {list(choices)}, but must be two of the stones 0 to "
                f"{len(self.order) - 1}"
            )
        begin = next((point.time for point in self.path if point.stone >= 0), now.time)
        return RoundResult(
            finished=finished,
            seed=self.seed,
            order=tuple(touch.name.lower() for touch in self.order),
            choices=chosen,
            correct=sum(self.order[stone] is Touch.ROUGH for stone in chosen),
            duration=round(now.time - begin, 3),
            strokes=tuple(self.strokes),
            trainer=self.trainer,
            round_trip=float(np.median(self.round_trips)) if self.round_trips else None,
        )

    def track(self, begin: float) -> NDArray[np.float64]:
        """Return rows of time since ``begin`` (s), x, y (m), force (N) and truth, shape
        ``(points, 5)``."""
        rows = [
            (point.time - begin, point.x, point.y, point.force, self.truth(point))
            for point in self.path
        ]
        return np.array(rows, dtype=np.float64).reshape(-1, 5)


def within_reach(x: float, y: float, force: float, *, now: float) -> Point:
    """Clip a requested target to the box and to a hand's force; raises `ValueError` for
    a place that is not finite."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError("x and y must be finite numbers")
    width = 4 * PITCH + WIDTH
    return Point(
        now,
        min(max(x, -SLOT_MARGIN), width + SLOT_MARGIN),
        min(max(y, -SLOT_MARGIN), DEPTH + SLOT_MARGIN),
        min(force, GREATEST_FORCE) if force > 0 else LIFTED_PRESSURE,
    )


def read_results(path: Path) -> list[RoundResult]:
    """Read a results file; invalid lines are skipped."""
    if not path.is_file():
        return []
    results = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        try:
            results.append(RoundResult(**json.loads(line)))
        except (ValueError, TypeError, RecursionError):
            continue
    return results
