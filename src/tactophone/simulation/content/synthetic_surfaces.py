"""Stones that nobody has met: each a blend of two of the catalogue's, so that rounds never run out of new ones."""

from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from tactophone.simulation.content.catalogue import TestObject, catalogue
from tactophone.simulation.physics.modes import Body, Mounting
from tactophone.simulation.physics.surface import Surface
from tactophone.types import Touch

Blended = TypeVar("Blended")

MASS = (0.15, 0.7)
"""Kilograms of a stone that a hand can fetch."""


def invent(label: Touch, rng: np.random.Generator) -> TestObject:
    """Invent a stone, smooth or rough, in the competition's box.

    >>> stone = invent(Touch.ROUGH, np.random.default_rng(0))
    >>> stone.label, stone.roughness.ra > 5e-6
    (<Touch.ROUGH: 2>, True)
    """
    parents = [thing for thing in catalogue() if thing.label is label and thing.movable]
    one, other = (parents[k] for k in rng.choice(len(parents), 2, replace=False))
    share = float(rng.uniform(0.2, 0.8))
    return replace(
        one,
        number=-2,
        name=f"invented {label.name.lower()} stone",
        surface=_surface(one.surface, other.surface, share, rng),
        material=_blend(one.material, other.material, share),
        substance=f"between {one.substance} and {other.substance}",
        body=Body.SHELL if rng.random() < 0.5 else Body.BLOCK,
        mounting=Mounting.MAT,
        mass=float(rng.uniform(*MASS)),
    )


def _surface(one: Surface, other: Surface, share: float, rng: np.random.Generator) -> Surface:
    features: dict[str, Any] = {}
    for name in ("grains", "pits", "ridges"):
        mine, theirs = getattr(one, name), getattr(other, name)
        both = mine is not None and theirs is not None
        features[name] = _blend(mine, theirs, share) if both else (mine if rng.random() < share else theirs)
    plain = replace(one, grains=None, pits=None, ridges=None, name="invented", seed=int(rng.integers(1 << 30)))
    blended = _blend(plain, replace(other, grains=None, pits=None, ridges=None), share)
    return replace(blended, name=plain.name, seed=plain.seed, **features)


def _blend(one: Blended, other: Blended, share: float) -> Blended:
    """Blend two records number by number, in ratio: ``share`` of the first."""
    blended: dict[str, Any] = {}
    for field in fields(one):  # type: ignore[arg-type]  # any of our records is a dataclass
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, float) and mine > 0 and theirs > 0:
            blended[field.name] = float(mine**share * theirs ** (1 - share))
    return replace(one, **blended)  # type: ignore[type-var]
