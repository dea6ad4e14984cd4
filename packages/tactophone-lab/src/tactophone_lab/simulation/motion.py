"""The hand's motion: sparse moves become a smooth path, and the path a position on the
surface below it.

A *move* is a target: at this time, be at this place and press with this force. Pointers
report about a hundred a second; an arm moves more smoothly, so a three-pole low-pass
leads from target to path. Below the finger is the object whose footprint contains it,
or the ground between footprints; edges are rounded. A scene holds the objects and their
places, the ground and the room.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import Touch
from tactophone_lab.simulation.catalogue import SimulatedObject, find, surface
from tactophone_lab.simulation.contact import Array, Motion
from tactophone_lab.simulation.mechanics import compiled
from tactophone_lab.simulation.modes import Body, Mounting

LIFT = -0.5
"""Newtons pressed while hovering: negative, so that the finger rises."""

_PATH_CORNER = 14.0
"""Hz; a hand's voluntary movement ends near 10 Hz (Brooks, "Telerobotic response
requirements", IEEE SMC 1990)."""

_PRESS_CORNER = 9.0
"""Hz; of force control."""

HAND = np.dtype(
    [
        (name, np.float64)
        for name in (
            *(
                "x",
                "y",
                "x_speed",
                "y_speed",
                "x_target",
                "y_target",
                "x_eased",
                "y_eased",
            ),
            *("press", "press_rate", "press_target", "press_eased"),
            *("along", "x_direction", "y_direction", "sign"),
        )
    ]
)
"""The hand's state: place and speed, target and low-passed target, press likewise, and
the position along the track."""


class Move(NamedTuple):
    """At ``time`` (s since the stream began), be at ``x, y`` (m) and press with
    ``force`` (N; negative lifts)."""

    time: float
    x: float
    y: float
    force: float


class Field(NamedTuple):
    """Footprints ``(objects, 4)``: left, bottom, width, depth; their height over the
    ground and edge rounding, in m."""

    footprints: Array
    height: float
    rounding: float


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """The finger's path, per sample: ``x, y`` in m, and its motion over the tracks."""

    x: Array
    y: Array
    motion: Motion


class MoveFollower:
    """Follows moves; the path does not depend on the block size."""

    def __init__(self, field: Field, *, x: float, y: float, rate: int) -> None:
        self._field, self._rate = field, rate
        self._moves: deque[tuple[float, ...]] = deque()
        self._position = 0
        self._state = np.zeros(1, HAND)
        for axis, place in (("x", x), ("y", y)):
            for name in (axis, f"{axis}_target", f"{axis}_eased"):
                self._state[name] = place
        for name in ("press", "press_target", "press_eased"):
            self._state[name] = LIFT
        self._state["x_direction"] = self._state["sign"] = 1.0

    def queue(self, moves: Iterable[Move]) -> None:
        """Queue moves, oldest first; one whose time has passed takes effect at the next
        sample."""
        self._moves.extend(
            (float(round(move.time * self._rate)), *move[1:]) for move in moves
        )

    def follow(self, size: int) -> Path:
        """Return the path of the next ``size`` samples."""
        due = []
        while self._moves and self._moves[0][0] < self._position + size:
            due.append(self._moves.popleft())
        x, y, along, speed, press, height = (np.empty(size) for _ in range(6))
        motion = Motion(along, speed, press, np.empty(size, np.int64), height)
        _follow(
            np.array(due, float).reshape(-1, 4),
            self._position,
            self._field,
            self._state,
            x,
            y,
            motion,
            float(self._rate),
        )
        self._position += size
        return Path(x, y, motion)


@compiled
def _follow(
    moves: Array,
    position: int,
    field: Field,
    state: NDArray[np.void],
    x: Array,
    y: Array,
    motion: Motion,
    rate: float,
) -> None:
    s = state[0]
    step = 1.0 / rate
    taken = 0
    for i in range(x.size):
        while taken < len(moves) and moves[taken, 0] <= position + i:
            s.x_target, s.y_target, s.press_target = (
                moves[taken, 1],
                moves[taken, 2],
                moves[taken, 3],
            )
            taken += 1
        _approach(s, step)
        speed = _advance(s, step)
        x[i], y[i] = s.x, s.y
        motion.position[i], motion.speed[i], motion.press[i] = (
            s.along,
            s.sign * speed,
            s.press,
        )
        motion.body[i], motion.height[i] = _below(s.x, s.y, field)


@compiled
def _approach(s: Any, step: float) -> None:
    """One pole, then a critically damped pair, towards the target."""
    omega = 2 * np.pi * _PATH_CORNER
    s.x_eased += 2.0 * omega * step * (s.x_target - s.x_eased)
    s.y_eased += 2.0 * omega * step * (s.y_target - s.y_eased)
    s.x_speed += step * (omega * omega * (s.x_eased - s.x) - 2 * omega * s.x_speed)
    s.y_speed += step * (omega * omega * (s.y_eased - s.y) - 2 * omega * s.y_speed)
    s.x += step * s.x_speed
    s.y += step * s.y_speed
    omega = 2 * np.pi * _PRESS_CORNER
    s.press_eased += 2.0 * omega * step * (s.press_target - s.press_eased)
    s.press_rate += step * (
        omega * omega * (s.press_eased - s.press) - 2 * omega * s.press_rate
    )
    s.press += step * s.press_rate


@compiled
def _advance(s: Any, step: float) -> float:
    """Advance along the track by the distance moved; a reversal goes back over the same
    track. Returns the speed."""
    speed = np.sqrt(s.x_speed * s.x_speed + s.y_speed * s.y_speed)
    if speed > 1e-4:
        x, y = s.x_speed / speed, s.y_speed / speed
        if x * s.x_direction + y * s.y_direction < -0.2:
            s.sign = -s.sign
            s.x_direction, s.y_direction = x, y
        else:
            s.x_direction += 200 * step * (x - s.x_direction)
            s.y_direction += 200 * step * (y - s.y_direction)
    s.along += s.sign * speed * step
    return speed


@compiled
def _below(x: float, y: float, field: Field) -> tuple[int, float]:
    """Index and height (m) of the body under the finger; the ground has the index after
    the last footprint."""
    for k in range(len(field.footprints)):
        left, bottom, width, depth = field.footprints[k]
        inside = min(x - left, left + width - x, y - bottom, bottom + depth - y)
        if inside >= field.rounding:
            return k, 0.0
        if inside > 0.0:
            fall = 1.0 - inside / field.rounding
            return k, -field.height * (1.0 - np.sqrt(1.0 - fall * fall))
    return len(field.footprints), -field.height


DEPTH = 0.07
"""Depth of every object, in m, away from the operator."""


@dataclass(frozen=True, slots=True)
class PlacedObject:
    """An object and its footprint's left and near edge and width, in m."""

    object: SimulatedObject
    left: float
    near: float
    width: float

    @property
    def centre(self) -> tuple[float, float]:
        """The middle of its footprint, in m."""
        return self.left + self.width / 2, self.near + DEPTH / 2


@dataclass(frozen=True, slots=True)
class Scene:
    """Objects on a ground.

    - ``placed``: the objects; footprints do not overlap.
    - ``ground``: the surface between them, as an object.
    - ``height``, ``rounding``: height of the objects over the ground and radius of
      their edges, in m.
    """

    placed: tuple[PlacedObject, ...]
    ground: SimulatedObject
    height: float = 0.012
    rounding: float = 0.005

    @property
    def objects(self) -> tuple[SimulatedObject, ...]:
        """The objects in order, then the ground."""
        return (*(placed.object for placed in self.placed), self.ground)

    @property
    def field(self) -> Field:
        """The footprints, for the hand's path."""
        prints = [
            [placed.left, placed.near, placed.width, DEPTH] for placed in self.placed
        ]
        return Field(
            np.array(prints, dtype=np.float64).reshape(-1, 4),
            self.height,
            self.rounding,
        )


def single(obj: SimulatedObject, mounting: Mounting | None = None) -> Scene:
    """Place one object with its left end at the origin, mounted as the catalogue has it
    or otherwise."""
    mounted = obj if mounting is None else replace(obj, mounting=mounting)
    return Scene(
        (PlacedObject(mounted, 0.0, 0.0, obj.length),),
        _ground("floor", mounted.mounting),
    )


def row(objects: Sequence[SimulatedObject], *, pitch: float = 0.11) -> Scene:
    """Place objects in a row on a mat, ``pitch`` metres apart; each gets a profile of
    its own."""
    placed = [
        PlacedObject(
            replace(
                obj, surface=replace(obj.surface, seed=obj.surface.seed + 1000 * k)
            ),
            k * pitch,
            0,
            0.085,
        )
        for k, obj in enumerate(objects)
    ]
    return Scene(tuple(placed), _ground("mat", objects[0].mounting))


def five_stones(order: Sequence[Touch]) -> Scene:
    """Place the competition's stones on an anti-slip mat in a box, smooth or rough in
    this order.

    >>> rough, smooth = Touch.ROUGH, Touch.SMOOTH
    >>> scene = five_stones([rough, smooth, smooth, rough, smooth])
    >>> [placed.object.label.name for placed in scene.placed][:2], scene.ground.name
    (['ROUGH', 'SMOOTH'], 'mat')
    """
    smooth = find("smooth competition stone")
    rough = [replace(find(name), mounting=Mounting.MAT) for name in ("20", "22")]
    return row(
        [
            rough[k % 2] if label is Touch.ROUGH else smooth
            for k, label in enumerate(order)
        ]
    )


def _ground(name: str, mounting: Mounting) -> SimulatedObject:
    shape, material = surface(name)
    return SimulatedObject(
        number=-1,
        name=name,
        surface=shape,
        material=material,
        substance=name,
        label=Touch.NONE,
        body=Body.BLOCK,
        mounting=mounting,
        length=1.0,
        mass=1.5,
    )
