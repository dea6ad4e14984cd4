"""Scenes: objects and their places, the ground and the room."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tactophone.simulation.content.catalogue import SimulatedObject, find, surface
from tactophone.simulation.physics.modes import Body, Mounting
from tactophone.simulation.physics.motion import Field
from tactophone.types import Touch

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

    Parameters
    ----------
    placed
        The objects; footprints do not overlap.
    ground
        The surface between them, as an object.
    height, rounding
        Height of the objects over the ground and radius of their edges, in m.
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
    def cavity(self) -> Mounting:
        """The mounting that determines the room around the finger."""
        return self.objects[0].mounting

    @property
    def field(self) -> Field:
        """The footprints, for the hand's path."""
        prints = [[placed.left, placed.near, placed.width, DEPTH] for placed in self.placed]
        return Field(np.array(prints, dtype=np.float64).reshape(-1, 4), self.height, self.rounding)


def single(obj: SimulatedObject, mounting: Mounting | None = None) -> Scene:
    """Place one object with its left end at the origin, mounted as the catalogue has it or otherwise."""
    mounted = obj if mounting is None else replace(obj, mounting=mounting)
    return Scene((PlacedObject(mounted, 0.0, 0.0, obj.length),), _ground("floor", mounted.mounting))


def row(objects: Sequence[SimulatedObject], *, ground: str = "mat", pitch: float = 0.11) -> Scene:
    """Place objects in a row on a ground, ``pitch`` metres apart; each gets a profile of its own."""
    placed = [
        PlacedObject(replace(obj, surface=replace(obj.surface, seed=obj.surface.seed + 1000 * k)), k * pitch, 0, 0.085)
        for k, obj in enumerate(objects)
    ]
    return Scene(tuple(placed), _ground(ground, objects[0].mounting))


def five_stones(order: Sequence[Touch]) -> Scene:
    """Place the competition's stones on an anti-slip mat in a box, smooth or rough in this order.

    >>> scene = five_stones([Touch.ROUGH, Touch.SMOOTH, Touch.SMOOTH, Touch.ROUGH, Touch.SMOOTH])
    >>> [placed.object.label.name for placed in scene.placed][:2], scene.ground.name
    (['ROUGH', 'SMOOTH'], 'mat')
    """
    smooth = find("smooth competition stone")
    rough = [replace(find(name), mounting=Mounting.MAT) for name in ("20", "22")]
    return row([rough[k % 2] if label is Touch.ROUGH else smooth for k, label in enumerate(order)])


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
