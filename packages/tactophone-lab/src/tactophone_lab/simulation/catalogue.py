"""The catalogue of named objects: surface, material, mounting, and true roughness."""

import functools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from importlib import resources
from typing import Any, TypeVar

from tactophone.core.errors import DatasetError, did_you_mean
from tactophone.core.types import Touch
from tactophone_lab.datasets.roughness import COARSE_CUTOFF, Roughness, measure_profile
from tactophone_lab.simulation.modes import Body, Mounting
from tactophone_lab.simulation.surface import (
    HEIGHT_SPACING,
    Grains,
    Material,
    Pits,
    Ridges,
    Surface,
    height_profile,
)

PAPER = range(23)
"""Numbers of the paper's objects: 20 for training, then those for testing."""

TEST = frozenset({20, 21, 22})
"""The authors' test objects; 20 is spare."""

SCENARIOS = (Mounting.HELD, Mounting.TABLE, Mounting.BOX)
"""The paper's acoustic scenarios, for all movable objects."""

_UNITS = {"_um": 1e-6, "_mm": 1e-3, "_mm_s": 1e-3, "_gpa": 1e9}


@dataclass(frozen=True, slots=True)
class SimulatedObject:
    """An object of the catalogue."""

    number: int
    name: str
    """`number` and `name`: numbers up to 22 are the numbers of the authors' files."""
    surface: Surface
    material: Material
    """`surface` and `material`: statistics of its height, and its other properties."""
    substance: str
    """What it is made of, as text."""
    label: Touch
    """As people labelled it: ``SMOOTH`` or ``ROUGH``."""
    body: Body
    mounting: Mounting
    """`body` and `mounting`: how it is built and mounted."""
    length: float
    """Length available for a stroke, in m."""
    mass: float
    """In kg."""

    @property
    def roughness(self) -> Roughness:
        """Ra and Rq of the simulated profile."""
        return surface_roughness(self.surface)

    @property
    def movable(self) -> bool:
        """Whether it can be held, laid on a table or put into a box."""
        return self.mounting is not Mounting.FIXED


@functools.cache
def surface_roughness(surface: Surface) -> Roughness:
    """Return Ra and Rq of a surface's profile."""
    return measure_profile(
        height_profile(surface),
        step=HEIGHT_SPACING,
        cutoff=COARSE_CUTOFF,
        periodic=True,
    )


@functools.cache
def catalogue() -> tuple[SimulatedObject, ...]:
    """Return all objects, ordered by number."""
    tables = _read()
    return tuple(_object(entry, tables["surfaces"]) for entry in tables["objects"])


def find(name: str) -> SimulatedObject:
    """Find an object by its number or name.

    >>> find("3").name, find("lava stone").label
    ('polished marble', <Touch.ROUGH: 2>)
    """
    for obj in catalogue():
        if name in (obj.name, str(obj.number)):
            return obj
    if hint := did_you_mean(name, (obj.name for obj in catalogue())):
        raise DatasetError(
            f"{name!r} is not an object of the catalogue{hint} `tactophone simulate "
            "objects` lists all"
        )
    names = ", ".join(f"{obj.number} {obj.name}" for obj in catalogue())
    raise DatasetError(f"{name!r} is not an object of the catalogue; there are {names}")


@functools.cache
def surface(name: str) -> tuple[Surface, Material]:
    """Return a surface of the catalogue and its material; some, such as the mat, belong
    to no object."""
    return _surface(name, _read()["surfaces"][name])


@functools.cache
def _read() -> Mapping[str, Any]:
    return tomllib.loads(
        resources.files("tactophone_lab.simulation")
        .joinpath("catalogue.toml")
        .read_text("utf-8")
    )


def _object(entry: Mapping[str, Any], surfaces: Mapping[str, Any]) -> SimulatedObject:
    shape, material = _surface(entry["surface"], surfaces[entry["surface"]])
    return SimulatedObject(
        number=entry["number"],
        name=entry["name"],
        surface=shape,
        material=material,
        substance=entry["material"],
        label=Touch[entry["label"].upper()],
        body=Body(entry["body"]),
        mounting=Mounting(entry["mounting"]),
        length=entry["length_mm"] * 1e-3,
        mass=entry["mass"],
    )


def _surface(name: str, table: Mapping[str, Any]) -> tuple[Surface, Material]:
    shape = _si(
        {
            key: value
            for key, value in table.items()
            if not isinstance(value, str | list | dict)
        }
    )
    parts = {kind.__name__.lower(): kind for kind in (Grains, Pits, Ridges)}
    features: dict[str, Any] = {
        key: parts[key](**_si(table[key])) for key in parts if key in table
    }
    return Surface(name, **shape, **features), Material(**_si(table["material"]))


def _si(table: Mapping[str, float]) -> dict[str, Any]:
    """Turn ``height_um = 3`` into ``height = 3e-6``."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        suffix = next(
            (
                unit
                for unit in sorted(_UNITS, key=len, reverse=True)
                if key.endswith(unit)
            ),
            "",
        )
        found[key.removesuffix(suffix)] = value * _UNITS[suffix] if suffix else value
    return found


Blended = TypeVar("Blended")


def blend(first: Blended, second: Blended, share: float) -> Blended:
    """Blend the positive numbers of two dataclass instances geometrically, with weight
    ``share`` for the first."""
    blended: dict[str, Any] = {}
    for field in fields(first):  # type: ignore[arg-type]  # called with dataclass instances only
        a, b = getattr(first, field.name), getattr(second, field.name)
        if isinstance(a, float) and a > 0 and b > 0:
            blended[field.name] = float(a**share * b ** (1 - share))
    return replace(first, **blended)  # type: ignore[type-var]
