"""A round of the stone box: five stones under a curtain, three smooth and two rough; find the rough ones by touch.

The rules as values, without clock or network. The order is known here and never leaves before the curtain is lifted.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone.types import Touch

PITCH, WIDTH, DEPTH = 0.11, 0.085, 0.07
"""Metres from stone to stone, across one, and away from the player, as `simulation.five_stones` lays them."""

MARGIN = 0.015
"""Metres around the stones that the finger can reach."""

LIFTED = -0.5
"""Newtons with which a lifted finger presses: it rises."""

GREATEST_FORCE = 5.0
"""Newtons: as hard as people explore a texture (Tanaka et al., PLoS One 9, 2014)."""

SHORTEST_STROKE = 0.01
"""Metres over a stone, without turning back, that count as one stroke."""


@dataclass(frozen=True, slots=True)
class Box:
    """What a stone box is made of.

    Parameters
    ----------
    name
        Of the operator's run, whose vibration is felt.
    orders
        What lies under the curtain, round after round, beginning with ``seed``; then from the first again.
    hand
        Takes ``("lay", order, seed)`` and ``("move", x, y, force)``; the other end leads to the finger.
    results
        The file that rounds are appended to.
    """

    name: str
    orders: Sequence[Sequence[Touch]]
    seed: int
    hand: Connection
    results: Path


@dataclass(frozen=True, slots=True)
class Point:
    """Where the finger is wished to be: time in s, place in m, force in N (negative: lifted)."""

    time: float
    x: float
    y: float
    force: float

    @property
    def stone(self) -> int:
        """Which stone it presses on; -1 for none."""
        index, within = divmod(self.x, PITCH)
        on = self.force > 0 and 0 <= index < 5 and within <= WIDTH and 0 <= self.y <= DEPTH
        return int(index) if on else -1


@dataclass(frozen=True, slots=True)
class Result:
    """What is kept of a round.

    Parameters
    ----------
    finished
        Date and time, ISO 8601 with zone.
    order, choices
        0-based from left to right: what the stones are, and which were chosen as rough.
    correct
        How many of the choices are rough.
    duration
        Seconds from the first touch to the choice.
    strokes
        How many, on each stone.
    trainer
        Whether the player was told what was felt.
    round_trip
        Median seconds from pressing to hearing; ``None`` if it was never measured.
    """

    finished: str
    seed: int
    order: tuple[str, ...]
    choices: tuple[int, ...]
    correct: int
    duration: float
    strokes: tuple[int, ...]
    trainer: bool = False
    round_trip: float | None = None

    def append(self, path: Path) -> None:
        """Add one line of JSON to a results file."""
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(self)) + "\n")


class Round:
    """One round while it is played.

    Examples
    --------
    >>> smooth, rough = Touch.SMOOTH, Touch.ROUGH
    >>> game = Round((rough, smooth, smooth, rough, smooth), seed=1)
    >>> for k in range(5):
    ...     game.touch(Point(0.1 * k, 0.02 + 0.01 * k, 0.03, 1.5))
    >>> game.strokes, game.truth(Point(1.0, 0.02, 0.03, 1.5)).name
    ([1, 0, 0, 0, 0], 'ROUGH')
    >>> game.finish([0, 2], Point(9.4, 0, 0, LIFTED), finished="now").correct
    1
    """

    def __init__(self, order: Sequence[Touch], *, seed: int, trainer: bool = False) -> None:
        self.order, self.seed, self.trainer = tuple(order), seed, trainer
        self.strokes = [0] * len(order)
        self.path: list[Point] = []
        self.round_trips: list[float] = []
        self._way, self._counted = 0.0, False

    def touch(self, point: Point) -> None:
        """Follow the finger; count a stroke when it has gone far enough one way over one stone."""
        last = self.path[-1] if self.path else point
        self.path.append(point)
        step = point.x - last.x
        if point.stone < 0 or last.stone != point.stone or step * self._way < 0:
            self._way, self._counted = 0.0, False
        self._way += step if point.stone == last.stone else 0.0
        if point.stone >= 0 and not self._counted and abs(self._way) >= SHORTEST_STROKE:
            self._counted = True
            self.strokes[point.stone] += 1

    def truth(self, point: Point) -> Touch:
        """What truly lies under the finger."""
        return Touch.NONE if point.stone < 0 else self.order[point.stone]

    def finish(self, choices: Sequence[int], now: Point, *, finished: str) -> Result:
        """Take the player's choice of the two rough ones."""
        chosen = tuple(sorted(set(choices)))
        if len(chosen) != 2 or not all(0 <= stone < len(self.order) for stone in chosen):
            raise ValueError(f"choices are {list(choices)}, but two of the stones 0 to {len(self.order) - 1} count")
        begin = next((point.time for point in self.path if point.stone >= 0), now.time)
        return Result(
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
        """Rows of time since ``begin``, x, y, force and truth."""
        rows = [(point.time - begin, point.x, point.y, point.force, self.truth(point)) for point in self.path]
        return np.array(rows, dtype=np.float64).reshape(-1, 5)


def within_reach(x: float, y: float, force: float, *, now: float) -> Point:
    """Hold a wish inside the box and within a hand's strength."""
    width = 4 * PITCH + WIDTH
    return Point(
        now,
        min(max(x, -MARGIN), width + MARGIN),
        min(max(y, -MARGIN), DEPTH + MARGIN),
        min(force, GREATEST_FORCE) if force > 0 else LIFTED,
    )


def past(path: Path) -> list[Result]:
    """Read the rounds in a results file; a line that is none is passed over."""
    if not path.exists():
        return []
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            found.append(Result(**json.loads(line)))
        except (ValueError, TypeError):
            continue
    return found
