"""New stones for the simulated operator: each a blend of two of the catalogue's."""

from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np

from tactophone.simulation.content.catalogue import SimulatedObject, catalogue
from tactophone.simulation.physics.modes import Body, Mounting
from tactophone.simulation.physics.surface import Surface
from tactophone.types import Touch

Blended = TypeVar("Blended")

MASS = (0.15, 0.7)
"""Kilograms of a stone that a hand can lift."""


def synthetic_object(label: Touch, rng: np.random.Generator) -> SimulatedObject:
    """Blend two movable objects of this label into a new one, in the competition's box.

    >>> stone = synthetic_object(Touch.ROUGH, np.random.default_rng(0))
    >>> stone.label, stone.roughness.ra > 5e-6
    (<Touch.ROUGH: 2>, True)
    """
    parents = [obj for obj in catalogue() if obj.label is label and obj.movable]
    first, second = (parents[k] for k in rng.choice(len(parents), 2, replace=False))
    share = float(rng.uniform(0.2, 0.8))
    return replace(
        first,
        number=-2,
        name=f"synthetic {label.name.lower()} stone",
        surface=_surface(first.surface, second.surface, share, rng),
        material=_blend(first.material, second.material, share),
        substance=f"between {first.substance} and {second.substance}",
        body=Body.SHELL if rng.random() < 0.5 else Body.BLOCK,
        mounting=Mounting.MAT,
        mass=float(rng.uniform(*MASS)),
    )


def _surface(first: Surface, second: Surface, share: float, rng: np.random.Generator) -> Surface:
    features: dict[str, Any] = {}
    for name in ("grains", "pits", "ridges"):
        a, b = getattr(first, name), getattr(second, name)
        # A feature that only one parent has is inherited whole or not at all.
        features[name] = _blend(a, b, share) if a is not None and b is not None else (a if rng.random() < share else b)
    plain = replace(first, grains=None, pits=None, ridges=None, name="synthetic", seed=int(rng.integers(1 << 30)))
    blended = _blend(plain, replace(second, grains=None, pits=None, ridges=None), share)
    return replace(blended, name=plain.name, seed=plain.seed, **features)


def _blend(first: Blended, second: Blended, share: float) -> Blended:
    """Blend the positive numbers of two dataclass instances geometrically, with weight ``share`` for the first."""
    blended: dict[str, Any] = {}
    for field in fields(first):  # type: ignore[arg-type]  # called with dataclass instances only
        a, b = getattr(first, field.name), getattr(second, field.name)
        if isinstance(a, float) and a > 0 and b > 0:
            blended[field.name] = float(a**share * b ** (1 - share))
    return replace(first, **blended)  # type: ignore[type-var]
