"""Inputs, state and outputs of the contact kernel, as tuples and records that numba can compile."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STATE = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("arm", "arm_speed", "pad", "pad_speed"),
            *("link", "link_speed", "shear", "shear_speed"),
            *("bristle", "load", "friction_noise", "plate_force"),
        )
    ]
)
"""The finger's state: heights and displacements in m, speeds in m/s, the smoothed load in N, and the filters of
friction noise and of the force on the body as a plate."""

BODY = np.dtype(
    [
        *((name, np.float64) for name in ("stiffness", "kinetic", "static", "stribeck_speed", "hiss", "hiss_share")),
        *((name, np.float64) for name in ("plate", "plate_share")),
        ("modes", np.int64),
    ]
)
"""A touched body: Hertz' stiffness in N/m^1.5, friction coefficients, Stribeck speed, rms of micro-slips and the
coefficient of their one-pole low-pass, pressure of the body as a plate in Pa/N and the
coefficient of its high-pass, and how many modes it has."""

OVERSAMPLING = 2
"""Steps a sample: the stiffest mode, at 8 kHz, needs a step under 1 / (pi f) = 40 us; 10 us leave it undistorted."""


class Motion(NamedTuple):
    """The hand's motion in a block, per sample: position along the track (m), speed (m/s), press (N), index of the body
    under the finger, and that body's height (m)."""

    position: Array
    speed: Array
    press: Array
    body: NDArray[np.int64]
    height: Array


class Ground(NamedTuple):
    """All that can be touched: tracks ``(bodies, SIZE)``, SIZE a power of two, their spacing (m), and the bodies.

    ``modes`` has a row for each body and, last, one for the finger itself, of which ``flexure`` modes are in use.
    """

    light: NDArray[np.float32]
    heavy: NDArray[np.float32]
    friction: NDArray[np.float32]
    spacing: float
    bodies: NDArray[np.void]
    modes: NDArray[np.void]
    flexure: int


class Ringing(NamedTuple):
    """Displacements (m) and speeds of all modes, laid out as ``Ground.modes``."""

    displacement: Array
    speed: Array


class ContactSignals(NamedTuple):
    """The kernel's output, per sample: force at piezo and contact (N), pressure from finger and body (Pa)."""

    strain: Array
    force: Array
    finger: Array
    body: Array
