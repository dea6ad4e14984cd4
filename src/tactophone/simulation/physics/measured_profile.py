"""Measured height profiles as surfaces: those of the package ``tdw``, if it is installed.

ThreeDWorld's ``tdw`` 1.13 (BSD-2-Clause) holds twelve height profiles in metres, 1.394068 um apart. Ten are used: the
heights of *sanded acrylic* are nanometres, so its scale is wrong, and those of *sandpaper* are implausibly smooth. How
they were measured is not documented there. All are finer than the border between rough and smooth stones, so they have
no label of roughness; they serve for Ra, and as texture of which nothing is drawn.
"""

import importlib.metadata
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tactophone.errors import ConfigError

Profile = NDArray[np.float64]

STEP = 1.394068e-6
"""Metres between two heights (``SCRAPE_M_PER_PIXEL`` in the package)."""

FILES = MappingProxyType(
    {
        "acrylic": "acrylic",
        "bass wood": "bass_wood",
        "ceramic": "ceramic",
        "plywood": "plywood",
        "polycarbonate": "polycarbonate",
        "polyethylene": "polyethylene",
        "poplar": "poplar_wood",
        "pvc": "pvc",
        "rough wood": "rough_wood",
        "vinyl": "vinyl",
    }
)
"""File of each surface, without its suffix."""

INSTALL = "pip install --no-deps 'tdw==1.13.0.0'"
"""Without its dependencies, a game engine's: only its files are read."""

_LAG = 4
_JUMP = 3.0
"""Two scans were joined where heights `_LAG` samples apart differ by more than so many times the 99.9th percentile."""


def measured_profile(name: str, *, step: float, size: int) -> Profile:
    """Return a measured profile in m, periodic, of mean 0.

    Its longest scan is followed forth and back, as often as it fits in whole.

    Parameters
    ----------
    name
        One of `FILES`.
    step, size
        Metres between two heights, and their number.

    Raises
    ------
    ConfigError
        If the package is not installed.
    """
    scan = max(_scans(np.load(_path(FILES[name]))), key=len)
    turns = int(np.ceil(size * step / (2 * len(scan) * STEP)))
    # A place's distance from the last turn: it rises to half a period and falls again, without a jump at the seam.
    place = np.arange(size) * step % (size * step / turns)
    place = np.minimum(place, size * step / turns - place)
    height = np.interp(place, np.arange(len(scan)) * STEP, scan)
    return np.asarray(height - height.mean())


def _scans(heights: Profile) -> Iterator[Profile]:
    """Cut where scans were joined; remove each one's tilt."""
    moved = np.abs(heights[_LAG:] - heights[:-_LAG])
    joints = np.flatnonzero(moved > _JUMP * np.quantile(moved, 0.999))
    bounds = [0, *joints, *(joints + _LAG), len(heights)]
    for begin, end in zip(sorted(bounds), sorted(bounds)[1:], strict=False):
        if end - begin > 2 * _LAG:
            part = heights[begin:end].astype(np.float64)
            yield part - np.polyval(np.polyfit(np.arange(len(part)), part, 1), np.arange(len(part)))


def _path(stem: str) -> Path:
    try:
        files = importlib.metadata.files("tdw") or []
    except importlib.metadata.PackageNotFoundError:
        raise ConfigError(f"measured surfaces need the package tdw: {INSTALL}") from None
    for file in files:
        if file.parent.name == "scrape_surfaces" and file.name == f"{stem}.npy":
            return Path(str(file.locate()))
    raise ConfigError(f"the installed tdw has no height profile {stem!r}: {INSTALL}")
