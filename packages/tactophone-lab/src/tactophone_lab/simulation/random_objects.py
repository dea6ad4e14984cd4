"""Objects that nobody designed: drawn at random within stated physical ranges.

The catalogue's objects were made by hand, so a score on them flatters whoever made
them. Here each property is drawn by itself: how the object is built and mounted, its
geometry, stiffness and friction. The number of an object and the seed decide all of
it, so that object 7 is the same whether 8 or 800 are drawn.

Even-numbered objects are rough and odd-numbered ones smooth. The two classes differ
in their geometry alone, and leave a gap between them as the paper's stones do: its
authors chose stones that are clearly rough or clearly smooth.
"""

from typing import NamedTuple

import numpy as np

from tactophone.core.types import Touch
from tactophone_lab.simulation.catalogue import SimulatedObject
from tactophone_lab.simulation.modes import Body, Mounting
from tactophone_lab.simulation.surface import Grains, Material, Pits, Ridges, Surface

MICROMETRE = 1e-6
"""One micrometre in m."""

MILLIMETRE = 1e-3
"""One millimetre in m."""

GIGAPASCAL = 1e9
"""One gigapascal in Pa."""


class Span(NamedTuple):
    """A range of positive numbers, drawn evenly over its logarithm."""

    low: float
    high: float

    def draw(self, rng: np.random.Generator, unit: float = 1.0) -> float:
        """Draw a number, times ``unit``."""
        return unit * float(np.exp(rng.uniform(np.log(self.low), np.log(self.high))))


class Build(NamedTuple):
    """How an object is built: what decides its modes, and how stiff it may be."""

    name: str
    body: Body
    mountings: tuple[Mounting, ...]
    modulus: Span
    """Plane-strain modulus in GPa (Ashby, *Materials Selection in Mechanical Design*,
    appendix A)."""
    mass: Span
    """In kg: density by volume of things of this size that lie about."""
    length: Span
    """Length for a stroke in mm; the paper's stones have 70 to 120."""


_LOOSE = (Mounting.HELD, Mounting.TABLE, Mounting.BOX, Mounting.MAT)

_IN_PLACE = (Mounting.FIXED,)

_HAND_SIZE = Span(70, 120)
"""Length for a stroke, in mm, on an object that fits a hand."""

_BROAD = Span(150, 250)
"""Length for a stroke, in mm, on a wall, a pane or a tabletop."""

BUILDS = (
    Build("stone", Body.BLOCK, _LOOSE, Span(15, 75), Span(0.3, 1.8), _HAND_SIZE),
    Build("cast", Body.BLOCK, _LOOSE, Span(3, 20), Span(0.3, 1.2), _HAND_SIZE),
    Build("hollow cast", Body.SHELL, _LOOSE, Span(2, 8), Span(0.12, 0.4), _HAND_SIZE),
    Build("board", Body.BLOCK, _LOOSE, Span(0.6, 3), Span(0.2, 0.8), _HAND_SIZE),
    Build("plaster", Body.WALL, _IN_PLACE, Span(1, 8), Span(10, 25), _BROAD),
    Build("pane", Body.PANE, _IN_PLACE, Span(2.5, 75), Span(0.4, 0.8), _BROAD),
    Build("sheet", Body.SHEET, _IN_PLACE, Span(70, 220), Span(0.5, 1.0), _BROAD),
    Build("tabletop", Body.TABLETOP, _IN_PLACE, Span(0.6, 3), Span(3, 10), _BROAD),
    Build("soft top", Body.TABLETOP, _IN_PLACE, Span(0.004, 0.8), Span(3, 8), _BROAD),
    Build("soft floor", Body.WALL, _IN_PLACE, Span(0.004, 0.8), Span(12, 20), _BROAD),
)
"""Each is as likely as the next; a fifth of them is soft."""

SOFT = 1.0
"""GPa; a covering softer than this grips like rubber, leather or vinyl."""

HURST = (0.7, 0.9)
"""Fractured, worn and machined surfaces have about 0.8 (Persson et al., "On the nature
of surface roughness", J. Phys.: Condens. Matter 17, R1, 2005)."""

ROUGH_HEIGHT = Span(9, 28)
"""rms height in um: sand-cast, sawn and flame-cut surfaces have an Ra of 6 to 25 um
(*Machinery's Handbook*, surface roughness by process)."""

ROUGH_ROLLOFF = Span(0.3, 2)
"""mm; the catalogue's span."""

ROUGH_WAVINESS = Span(30, 180)
"""rms height in um; the catalogue's span."""

ROUGH_FINE_HEIGHT = Span(1.6, 5)
"""rms height in um; the catalogue's span."""

GRAIN_SPACING = Span(0.3, 2.6)
"""Spacing of grains in mm: medium and coarse sand has 0.2 to 2 mm, and fine gravel
begins there (ISO 14688-1)."""

GRAIN_HEIGHT = Span(60, 260)
"""um: abrasive grains of P220 to P60 have 68 to 269 um (ISO 6344-2)."""

GRAIN_SPREAD = (0.3, 0.7)
"""Of the logarithm of grains' heights: sorted to mixed sand."""

GRAIN_FILLING = (0.5, 1.0)
"""Share of places that hold a grain."""

RIDGE_SHARE = 0.1
"""Of rough objects: ribbed, woven or embossed instead of grainy."""

RIDGE_PERIOD = Span(1, 3)
"""mm; ribs, weaves and studs that a fingertip of 4 mm still feels one by one."""

RIDGE_HEIGHT = Span(60, 150)
"""um; the catalogue's span."""

PIT_SHARE = 0.3
"""Of all objects."""

ROUGH_PIT_SPACING = Span(2.5, 7)
"""mm: pores of lava and concrete."""

ROUGH_PIT_DEPTH = Span(150, 350)
"""um."""

ROUGH_PIT_WIDTH = Span(0.7, 1.6)
"""mm."""

SMOOTH_HEIGHT = Span(0.1, 2.4)
"""rms height in um: polished, ground, honed, glazed and lacquered surfaces have an Ra
of 0.1 to 1.6 um (*Machinery's Handbook*)."""

SMOOTH_ROLLOFF = Span(0.08, 0.8)
"""mm; the catalogue's span."""

SMOOTH_WAVINESS = Span(2, 110)
"""rms height in um: from float glass to a river pebble."""

SMOOTH_FINE_HEIGHT = Span(0.5, 1.6)
"""Times the rms height."""

FINEST_SMOOTH = 1.7 * MICROMETRE
"""Greatest fine height of a smooth object in m: a smooth thing has no sandy feel."""

SMOOTH_PIT_SPACING = Span(4, 15)
"""mm: pores of wood, pinholes of glaze; closer ones would make the object rough."""

SMOOTH_PIT_DEPTH = Span(1.5, 60)
"""um."""

SMOOTH_PIT_WIDTH = Span(0.2, 0.6)
"""mm."""

HARD_FRICTION = (0.34, 0.65)
"""Kinetic coefficient of a hard polymer skin on hard solids (Bowden and Tabor, *The
Friction and Lubrication of Solids*, 1950: 0.3 to 0.6)."""

SOFT_FRICTION = (0.45, 0.95)
"""Kinetic coefficient on rubber, leather, cork and soft plastic, which adhere."""

ROUGH_STICTION = (0.04, 0.08)
"""Static less kinetic coefficient: little true contact on a rough surface."""

SMOOTH_STICTION = (0.08, 0.25)
"""The same on a smooth one, whose contact area is large (Persson, J. Chem. Phys. 115,
3840, 2001)."""

STRIBECK_SPEED = Span(0.010, 0.020)
"""m/s; the catalogue's span."""

ROUGH_PATCHINESS = Span(0.05, 0.1)
"""The catalogue's span; nobody published one."""

SMOOTH_PATCHINESS = Span(0.12, 0.3)
"""The catalogue's span."""

ROUGH_HISS = Span(0.01, 0.05)
"""The catalogue's span."""

SMOOTH_HISS = Span(0.02, 0.11)
"""The catalogue's span: micro-slips are louder where the contact area is larger."""

ROUGH_SNAG_SPACING = Span(2.5, 6)
"""mm; the catalogue's span."""

SMOOTH_SNAG_SPACING = Span(12, 80)
"""mm; the catalogue's span."""

ROUGH_SNAG_STRENGTH = Span(0.15, 0.3)
"""The catalogue's span."""

SMOOTH_SNAG_STRENGTH = Span(0.02, 0.07)
"""The catalogue's span."""

MOST_OBJECTS = 1000
"""Most objects of one seed, so that their numbers never reach the next seed's."""


def draw_objects(count: int, seed: int) -> tuple[SimulatedObject, ...]:
    """Draw objects, rough and smooth in turn."""
    return tuple(draw_object(number, seed) for number in range(count))


def draw_object(number: int, seed: int) -> SimulatedObject:
    """Draw one object: rough if its number is even, smooth if it is odd."""
    if not 0 <= number < MOST_OBJECTS:
        raise ValueError(f"number {number} is not in 0 to {MOST_OBJECTS - 1}")
    rng = np.random.default_rng([0x0B1EC7, seed, number])
    label = Touch.SMOOTH if number % 2 else Touch.ROUGH
    build = BUILDS[rng.integers(len(BUILDS))]
    modulus = build.modulus.draw(rng)
    name = f"random {seed}-{number}"
    # Beyond all numbers of the catalogue, whose seeds of surfaces are small too.
    unique = MOST_OBJECTS * (seed + 1) + number
    shape = _rough_surface if label is Touch.ROUGH else _smooth_surface
    return SimulatedObject(
        number=unique,
        name=f"{name} {build.name}",
        surface=shape(name, unique, rng),
        material=_material(label, modulus, rng),
        # No two are kin: each is left out by itself.
        substance=name,
        label=label,
        body=build.body,
        mounting=build.mountings[rng.integers(len(build.mountings))],
        length=build.length.draw(rng, MILLIMETRE),
        mass=build.mass.draw(rng),
    )


def _rough_surface(name: str, seed: int, rng: np.random.Generator) -> Surface:
    ridges = None
    grains = None
    if rng.random() < RIDGE_SHARE:
        ridges = Ridges(
            period=RIDGE_PERIOD.draw(rng, MILLIMETRE),
            height=RIDGE_HEIGHT.draw(rng, MICROMETRE),
        )
    else:
        grains = Grains(
            spacing=GRAIN_SPACING.draw(rng, MILLIMETRE),
            height=GRAIN_HEIGHT.draw(rng, MICROMETRE),
            spread=rng.uniform(*GRAIN_SPREAD),
            filling=rng.uniform(*GRAIN_FILLING),
        )
    pits = _pits(ROUGH_PIT_SPACING, ROUGH_PIT_DEPTH, ROUGH_PIT_WIDTH, rng)
    return Surface(
        name=name,
        seed=seed,
        rms_height=ROUGH_HEIGHT.draw(rng, MICROMETRE),
        rolloff=ROUGH_ROLLOFF.draw(rng, MILLIMETRE),
        hurst=rng.uniform(*HURST),
        waviness=ROUGH_WAVINESS.draw(rng, MICROMETRE),
        fine_height=ROUGH_FINE_HEIGHT.draw(rng, MICROMETRE),
        grains=grains,
        pits=pits,
        ridges=ridges,
    )


def _smooth_surface(name: str, seed: int, rng: np.random.Generator) -> Surface:
    rms_height = SMOOTH_HEIGHT.draw(rng, MICROMETRE)
    fine_height = min(rms_height * SMOOTH_FINE_HEIGHT.draw(rng), FINEST_SMOOTH)
    pits = _pits(SMOOTH_PIT_SPACING, SMOOTH_PIT_DEPTH, SMOOTH_PIT_WIDTH, rng)
    return Surface(
        name=name,
        seed=seed,
        rms_height=rms_height,
        rolloff=SMOOTH_ROLLOFF.draw(rng, MILLIMETRE),
        hurst=rng.uniform(*HURST),
        waviness=SMOOTH_WAVINESS.draw(rng, MICROMETRE),
        fine_height=fine_height,
        pits=pits,
    )


def _pits(
    spacing: Span, depth: Span, width: Span, rng: np.random.Generator
) -> Pits | None:
    """Draw the pits of a surface, or none."""
    if rng.random() >= PIT_SHARE:
        return None
    return Pits(
        spacing=spacing.draw(rng, MILLIMETRE),
        depth=depth.draw(rng, MICROMETRE),
        width=width.draw(rng, MILLIMETRE),
    )


def _material(label: Touch, modulus: float, rng: np.random.Generator) -> Material:
    """Draw friction and what goes with it; ``modulus`` in GPa."""
    rough = label is Touch.ROUGH
    kinetic = rng.uniform(*(SOFT_FRICTION if modulus < SOFT else HARD_FRICTION))
    stiction = rng.uniform(*(ROUGH_STICTION if rough else SMOOTH_STICTION))
    patchiness = ROUGH_PATCHINESS if rough else SMOOTH_PATCHINESS
    hiss = ROUGH_HISS if rough else SMOOTH_HISS
    spacing = ROUGH_SNAG_SPACING if rough else SMOOTH_SNAG_SPACING
    strength = ROUGH_SNAG_STRENGTH if rough else SMOOTH_SNAG_STRENGTH
    return Material(
        modulus=modulus * GIGAPASCAL,
        kinetic=kinetic,
        static=kinetic + stiction,
        stribeck_speed=STRIBECK_SPEED.draw(rng),
        patchiness=patchiness.draw(rng),
        hiss=hiss.draw(rng),
        snag_spacing=spacing.draw(rng, MILLIMETRE),
        snag_strength=strength.draw(rng),
    )
