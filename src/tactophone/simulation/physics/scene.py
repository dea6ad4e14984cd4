"""Scenes: what lies where under the finger, on which ground, in which room."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactophone.simulation.content.catalogue import TestObject, find, surface
from tactophone.simulation.physics.modes import Body, Mounting
from tactophone.simulation.physics.motion import Field
from tactophone.types import Touch

DEPTH = 0.07
"""Metres that every object reaches away from the operator."""


@dataclass(frozen=True, slots=True)
class Placed:
    """An object and its footprint's left and near edge and width, in m."""

    thing: TestObject
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

    Parameters
    ----------
    placed
        The objects; footprints do not overlap.
    ground
        What lies between and below them, as an object.
    height, rounding
        How high the objects stand over the ground and how their edges are rounded, in m.
    """

    placed: tuple[Placed, ...]
    ground: TestObject
    height: float = 0.012
    rounding: float = 0.005

    @property
    def things(self) -> tuple[TestObject, ...]:
        """The objects in order, then the ground."""
        return (*(placed.thing for placed in self.placed), self.ground)

    @property
    def cavity(self) -> Mounting:
        """The room around the finger, named for what stands in it."""
        return self.things[0].mounting

    @property
    def field(self) -> Field:
        """The footprints, as the hand's path is held against them."""
        prints = [[placed.left, placed.near, placed.width, DEPTH] for placed in self.placed]
        return Field(np.array(prints, dtype=np.float64).reshape(-1, 4), self.height, self.rounding)


def single(thing: TestObject, mounting: Mounting | None = None) -> Scene:
    """Place one object with its left end at the origin, mounted as the catalogue has it or otherwise."""
    mounted = thing if mounting is None else replace(thing, mounting=mounting)
    return Scene((Placed(mounted, 0.0, 0.0, thing.length),), _ground("floor", mounted.mounting))


def row(things: Sequence[TestObject], *, ground: str = "mat", pitch: float = 0.11) -> Scene:
    """Lay objects in a row on a ground, ``pitch`` metres apart; no two alike, even where the catalogue has one such."""
    placed = [
        Placed(replace(thing, surface=replace(thing.surface, seed=thing.surface.seed + 1000 * k)), k * pitch, 0, 0.085)
        for k, thing in enumerate(things)
    ]
    return Scene(tuple(placed), _ground(ground, things[0].mounting))


def five_stones(order: Sequence[Touch]) -> Scene:
    """Lay the competition's stones on an anti-slip mat in a box, each smooth or rough as ordered.

    >>> scene = five_stones([Touch.ROUGH, Touch.SMOOTH, Touch.SMOOTH, Touch.ROUGH, Touch.SMOOTH])
    >>> [placed.thing.label.name for placed in scene.placed][:2], scene.ground.name
    (['ROUGH', 'SMOOTH'], 'mat')
    """
    smooth = find("smooth competition stone")
    rough = [replace(find(name), mounting=Mounting.MAT) for name in ("20", "22")]
    return row([rough[k % 2] if label is Touch.ROUGH else smooth for k, label in enumerate(order)])


def shuffled(seed: int) -> tuple[Touch, ...]:
    """Three smooth and two rough, in an order drawn from the seed."""
    labels = [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2
    return tuple(labels[k] for k in np.random.default_rng([0xF1FE, seed]).permutation(5))


def _ground(name: str, mounting: Mounting) -> TestObject:
    shape, material = surface(name)
    return TestObject(
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
