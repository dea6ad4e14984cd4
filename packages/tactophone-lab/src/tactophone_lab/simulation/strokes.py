"""Scripts of moves: the paper's seven takes, and strokes, slips and taps to compose
others.

Strokes follow the minimum-jerk profile of a reaching hand (Flash & Hogan, J. Neurosci.
5, 1688, 1985), with tremor and drift of press about their mean. Pressures and speeds
are as people use when they explore textures freely: 0.2 to 5 N, 2 to 20 cm/s (Tanaka et
al., "Contact force and scanning velocity during active roughness perception", PLoS One
9, 2014).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone_lab.simulation.motion import DEPTH, LIFT, Move, PlacedObject
from tactophone_lab.simulation.takes import Take

STROKE_STEP = 0.005
"""Seconds between two moves of a script."""

TOUCH = 0.3
"""Newtons of a gentle approach, until the finger is down."""

EDGE = 0.008
"""Metres that a stroke overshoots an edge when it slips off."""

STROKE_PRESSURES = {"light": (0.25, 0.8), "medium": (0.8, 2.0), "strong": (2.0, 4.5)}
"""Newtons, by the paper's names."""

SPEEDS = {"light": (0.03, 0.12), "medium": (0.04, 0.16), "strong": (0.06, 0.22)}
"""Peak speed in m/s: people who press harder also move faster."""

SLIPS = 0.06
"""Share of strokes that run over an edge."""


class Script:
    """A list of moves under construction, one motion after another.

    ``x`` and ``y`` are the finger's place at the start in m; ``rng`` draws tremor,
    drift and pauses.
    """

    def __init__(
        self, rng: np.random.Generator, *, x: float, y: float, start: float = 0.0
    ) -> None:
        self.rng = rng
        self.x, self.y, self.time = x, y, start
        self.moves: list[Move] = []

    def hover(
        self, duration: float, *, x: float | None = None, y: float | None = None
    ) -> None:
        """Lift off, and move to a place in the air."""
        self._go(duration, x, y, lambda phase: np.full_like(phase, LIFT))

    def land(self, force: float) -> None:
        """Come down gently and press."""
        self._go(0.15, None, None, lambda phase: np.full_like(phase, min(force, TOUCH)))
        self._go(0.12, None, None, lambda phase: TOUCH + (force - TOUCH) * _ease(phase))

    def stroke(
        self, x: float, duration: float, force: float, *, y: float | None = None
    ) -> None:
        """Stroke to a place, with about this force."""
        size = max(2, round(duration / STROKE_STEP))
        press = force * np.clip(
            1 + 0.18 * self._wander(size, 2.0) + 0.07 * self._wander(size, 9.0),
            0.25,
            2.2,
        )
        self._go(duration, x, y, lambda phase: press)

    def wiggle(
        self, amplitude: float, frequency: float, duration: float, *, force: float
    ) -> None:
        """Rub to and fro around the current place."""
        size = max(2, round(duration / STROKE_STEP))
        time = STROKE_STEP * np.arange(size)
        phase = 2 * np.pi * (frequency * time + 0.05 * self._wander(size, 0.8))
        path = self.x + amplitude * np.minimum(1, time / 0.2) * np.sin(phase)
        press = force * np.clip(
            1 + 0.2 * self._wander(size, 1.5) + 0.1 * self._wander(size, 8.0), 0.25, 2.2
        )
        self._write(path, np.full(size, self.y), press)

    def tap(self, force: float) -> None:
        """Touch down hard and lift off, without sliding."""
        self._go(0.08, None, None, lambda phase: np.full_like(phase, force))
        self.hover(0.25)

    def _go(
        self,
        duration: float,
        x: float | None,
        y: float | None,
        press: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    ) -> None:
        size = max(2, round(duration / STROKE_STEP))
        phase = np.arange(1, size + 1) / size
        to_x, to_y = (self.x if x is None else x), (self.y if y is None else y)
        self._write(
            self.x + (to_x - self.x) * _ease(phase),
            self.y + (to_y - self.y) * _ease(phase),
            press(phase),
        )

    def _write(
        self, x: NDArray[np.float64], y: NDArray[np.float64], press: NDArray[np.float64]
    ) -> None:
        times = self.time + STROKE_STEP * np.arange(x.size)
        self.moves += [
            Move(*map(float, row)) for row in zip(times, x, y, press, strict=True)
        ]
        self.x, self.y, self.time = (
            float(x[-1]),
            float(y[-1]),
            self.time + STROKE_STEP * x.size,
        )

    def _wander(self, size: int, frequency: float) -> NDArray[np.float64]:
        """Noise of unit rms with a bandwidth of about ``frequency`` Hz."""
        knots = max(4, int(size * STROKE_STEP * frequency * 2) + 2)
        drawn = self.rng.standard_normal(knots)
        return np.interp(np.linspace(0, knots - 1, size), np.arange(knots), drawn)


def take_moves(
    take: Take, placed: PlacedObject, *, duration: float, rng: np.random.Generator
) -> list[Move]:
    """Script one of the paper's takes on an object; `SLIPS` of the strokes run over an
    edge."""
    middle, depth = placed.centre
    script = Script(rng, x=middle, y=depth)
    while script.time < duration:
        script.hover(
            rng.uniform(0.25, 0.7),
            x=middle + rng.uniform(-0.3, 0.3) * placed.width,
            y=_lane(rng, placed),
        )
        force, speed = (
            log_uniform(rng, bounds[take.pressure])
            for bounds in (STROKE_PRESSURES, SPEEDS)
        )
        script.land(force)
        {"long": _long, "short": _short, "wiggle": _wiggle}[take.stroke](
            script, placed, force, speed
        )
    return script.moves


def _long(script: Script, placed: PlacedObject, force: float, speed: float) -> None:
    left, right = placed.left + 0.01, placed.left + placed.width - 0.01
    target = right if script.x < placed.centre[0] else left
    if script.rng.random() < SLIPS:
        target += np.sign(target - script.x) * (0.01 + EDGE)
    script.stroke(target, _duration(abs(target - script.x), speed), force)


def _short(script: Script, placed: PlacedObject, force: float, speed: float) -> None:
    for _ in range(script.rng.integers(1, 4)):
        length = script.rng.uniform(0.008, 0.03) * script.rng.choice([-1, 1])
        target = float(
            np.clip(
                script.x + length, placed.left + 0.01, placed.left + placed.width - 0.01
            )
        )
        script.stroke(target, _duration(abs(target - script.x), speed), force)


def _wiggle(script: Script, _: PlacedObject, force: float, speed: float) -> None:
    amplitude = script.rng.uniform(0.004, 0.016)
    frequency = float(np.clip(speed / (2 * np.pi * amplitude), 1.0, 4.5))
    script.wiggle(amplitude, frequency, script.rng.uniform(3, 8), force=force)


def log_uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    """Draw between bounds, uniformly in the logarithm, as people perceive force and
    speed."""
    return float(np.exp(rng.uniform(*np.log(bounds))))


def _duration(length: float, peak: float) -> float:
    # A minimum-jerk stroke's peak speed is 15/8 of its mean.
    return max(0.15, 15 / 8 * length / peak)


def _lane(rng: np.random.Generator, placed: PlacedObject) -> float:
    return placed.near + rng.uniform(0.25, 0.75) * DEPTH


def _ease(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """Minimum jerk: ``10 p^3 - 15 p^4 + 6 p^5``."""
    return phase**3 * (10 - 15 * phase + 6 * phase**2)


@dataclass(frozen=True, slots=True)
class Visit:
    """How an object is explored: duration (s), force (N), peak speed (m/s), and whether
    the finger slips off it."""

    duration: float
    force: float
    speed: float
    slips: bool = False


def explore(script: Script, placed: PlacedObject, visit: Visit) -> None:
    """Hover to an object, stroke it, and leave it: by lifting off, or by slipping off
    its right edge."""
    middle = placed.centre[0]
    script.hover(script.rng.uniform(0.8, 1.8), x=middle, y=_lane(script.rng, placed))
    begin = script.time
    script.land(visit.force)
    while script.time - begin < visit.duration:
        target = middle + script.rng.choice([-1, 1]) * script.rng.uniform(0.012, 0.032)
        script.stroke(
            target,
            _duration(abs(target - script.x), visit.speed),
            visit.force,
            y=_lane(script.rng, placed),
        )
    if visit.slips:
        over = placed.left + placed.width + EDGE
        script.stroke(over, _duration(over - script.x, visit.speed), visit.force)
        script.stroke(over, 0.25, visit.force)
    script.hover(script.rng.uniform(0.3, 0.6))
