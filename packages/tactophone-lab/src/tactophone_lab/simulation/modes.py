"""Vibration modes: of a body, by its construction and mounting.

A body is a handful of damped masses on springs that the contact force drives; each
moves the contact and radiates. Frequencies and dampings are drawn within ranges from
plate and shell formulas for bodies of that size (Blevins, *Formulas for Natural
Frequency and Mode Shape*, 1979) and from loss factors of stone, wood and hand (Cremer,
Heckl, Petersson, *Structure-Borne Sound*, 2005, table 4.2; Dong et al., "Mechanical
impedances distributed at the fingers and palm", J. Biomech. 38, 1165, 2005).

Radiation is in pascals at the air microphone per m/s^2 of the mode: ``rho S / (4 pi
r)`` of a small source at distance ``r`` (Kinsler et al., *Fundamentals of Acoustics*,
2000, section 7.2). A table moves more air than a stone, but lies farther from a
microphone that sits two centimetres from the contact.
"""

import enum
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

MODE = np.dtype(
    [
        (name, np.float64)
        for name in ("stiffness", "mobility", "damping", "radiation", "strain")
    ]
)
"""A mode as the kernel takes it: omega^2, 1 / modal mass, 2 zeta omega, Pa per m/s^2,
and piezo newtons per metre."""


class Body(enum.StrEnum):
    """How an object is built, which decides its modes."""

    BLOCK = "block"
    SHELL = "shell"
    WALL = "wall"
    PANE = "pane"
    SHEET = "sheet"
    TABLETOP = "tabletop"


class Mounting(enum.StrEnum):
    """How an object is held: three scenarios for movable ones, ``MAT`` in the
    competition's box, ``FIXED`` in place."""

    HELD = "held"
    TABLE = "table"
    BOX = "box"
    MAT = "mat"
    FIXED = "fixed"


class Mode(NamedTuple):
    """One resonance: Hz, kg, fraction of critical damping, Pa per m/s^2, share of the
    force that reaches the piezo."""

    frequency: float
    mass: float
    damping: float
    radiation: float
    strain: float = 0.0


AREA_DENSITY = {
    Body.BLOCK: 110.0,  # 5 cm of stone
    Body.SHELL: 8.0,  # 5 mm of gypsum or resin
    Body.WALL: 12.0,  # 1 cm of plaster
    Body.PANE: 10.0,  # 4 mm of glass
    Body.SHEET: 9.5,  # 1.2 mm of steel
    Body.TABLETOP: 17.0,  # 25 mm of wood
}
"""Mass in kg per square metre, of a body as a plate."""

NEAR_FIELD = 0.05
"""Metres; the plate's radiation is not computed for a nearer place, where it is not yet
a wave."""

_AIR_DENSITY = 1.2
"""kg/m^3."""


def plate_pressure(body: Body, distance: float) -> float:
    """Pressure in Pa per newton on a large plate, from its highest separate mode to its
    coincidence: flat in frequency.

    ``p = rho / (2 pi r m)`` (Cremer, Heckl, Petersson, *Structure-Borne Sound*, 2005,
    section 6.7).

    >>> round(plate_pressure(Body.SHELL, 0.05), 2)
    0.48
    """
    return _AIR_DENSITY / (2 * np.pi * max(distance, NEAR_FIELD) * AREA_DENSITY[body])


_Bounds = tuple[float, float]


class _Range(NamedTuple):
    """Bounds of one mode's frequency, mass, damping and radiation; a mass may be
    relative to the body's own."""

    frequency: _Bounds
    mass: _Bounds
    damping: _Bounds
    radiation: _Bounds
    relative: bool = False


def _ranges(
    frequencies: list[_Bounds],
    mass: _Bounds,
    damping: _Bounds,
    radiation: _Bounds,
    *,
    relative: bool = False,
) -> tuple[_Range, ...]:
    """Bounds of modes that differ in frequency only."""
    return tuple(
        _Range(frequency, mass, damping, radiation, relative)
        for frequency in frequencies
    )


_OWN: dict[Body, tuple[_Range, ...]] = {
    # The bulk modes of a fist-sized stone lie over 2.5 kHz; what moves is only the
    # contact's surroundings.
    Body.BLOCK: _ranges(
        [(2600, 4200), (4300, 6000), (6200, 8200)],
        (0.45, 0.45),
        (0.014, 0.05),
        (8e-4, 8e-4),
        relative=True,
    ),
    # A cast shell, 3 to 5 mm thick: light local modes from 250 Hz up.
    Body.SHELL: (
        *_ranges(
            [(240, 460)], (0.10, 0.20), (0.03, 0.07), (1.2e-3, 2.4e-3), relative=True
        ),
        *_ranges(
            [(500, 880), (1000, 1700)],
            (0.10, 0.18),
            (0.03, 0.07),
            (1.2e-3, 2.4e-3),
            relative=True,
        ),
        *_ranges(
            [(1800, 2800)], (0.06, 0.06), (0.05, 0.07), (1.0e-3, 1.0e-3), relative=True
        ),
    ),
    Body.WALL: _ranges(
        [(80, 130), (200, 320), (460, 700)], (8, 20), (0.04, 0.08), (8e-3, 1.2e-2)
    ),
    Body.PANE: _ranges(
        [(120, 180), (270, 380), (480, 640), (820, 1100)],
        (0.3, 0.7),
        (0.03, 0.06),
        (1.5e-3, 3e-3),
    ),
    Body.SHEET: _ranges(
        [(60, 90), (140, 200), (260, 350), (470, 600), (800, 1000)],
        (0.5, 1.0),
        (0.025, 0.05),
        (2e-3, 4e-3),
    ),
    Body.TABLETOP: _ranges(
        [(55, 80), (130, 180), (240, 320), (400, 520), (650, 820)],
        (4, 9),
        (0.02, 0.04),
        (8e-3, 1.2e-2),
    ),
}

_HELD_BY: dict[Mounting, tuple[_Range, ...]] = {
    # The palm's tissue under the stone, then the hand on the wrist (Dong et al. 2005).
    Mounting.HELD: (
        *_ranges([(14, 28)], (1, 1), (0.3, 0.5), (1e-4, 1e-4), relative=True),
        *_ranges([(70, 130)], (2.5, 2.5), (0.2, 0.35), (1e-4, 1e-4), relative=True),
    ),
    # The stone rocks on its three points; the tabletop below it booms.
    Mounting.TABLE: (
        *_ranges([(170, 320)], (1, 1), (0.06, 0.14), (6e-4, 6e-4), relative=True),
        *_ranges(
            [(55, 85), (120, 180), (220, 330), (380, 560)],
            (5, 12),
            (0.02, 0.05),
            (1e-2, 1e-2),
        ),
    ),
    # Cardboard: light panels, lossy.
    Mounting.BOX: _ranges(
        [(60, 100), (140, 220), (280, 430), (520, 780)],
        (0.9, 2.0),
        (0.03, 0.06),
        (3e-3, 6e-3),
    ),
    # The stone on a rubber mat, in a wooden box.
    Mounting.MAT: (
        *_ranges([(55, 110)], (1, 1), (0.12, 0.25), (6e-4, 6e-4), relative=True),
        *_ranges(
            [(70, 120), (190, 300), (420, 640)], (1.7, 3.2), (0.03, 0.06), (3e-3, 6e-3)
        ),
    ),
    Mounting.FIXED: (),
}


def body_modes(
    body: Body, mounting: Mounting, *, mass: float, rng: np.random.Generator
) -> list[Mode]:
    """Draw the modes of a body of this mass (kg) in this mounting."""
    return [_draw(bounds, mass, rng) for bounds in (*_OWN[body], *_HELD_BY[mounting])]


def mode_table(modes: Sequence[Mode], size: int | None = None) -> NDArray[np.void]:
    """Make the kernel's table of modes, padded to ``size`` with modes of zero
    mobility."""
    table = np.zeros(len(modes) if size is None else size, MODE)
    for row, mode in zip(table, modes, strict=False):
        omega = 2 * np.pi * mode.frequency
        row["stiffness"], row["mobility"] = omega**2, 1 / mode.mass
        row["damping"], row["radiation"] = 2 * mode.damping * omega, mode.radiation
        row["strain"] = mode.strain * mode.mass * omega**2
    return table


def _draw(bounds: _Range, mass: float, rng: np.random.Generator) -> Mode:
    drawn = [float(rng.uniform(*pair)) for pair in bounds[:4]]
    if bounds.relative:
        drawn[1] *= mass
    return Mode(*drawn)
