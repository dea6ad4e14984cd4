"""The contact between finger and surface, sample by sample: from motion to force, and
from force to sound.

Inputs, state and outputs are tuples and records that numba can compile. A chain of
masses and springs is stepped at twice the sample rate, semi-implicitly (each speed
before its position, so that springs do not gain energy): arm -> silicone -> pad ->
contact -> body, and sideways joint -> silicone -> pad. The contact is Hunt-Crossley
along the normal and LuGre along the surface. The track's height excites it: where the
tip leaves one asperity and meets the next, the track has a cusp, and the surface's
normal speed jumps. Its slope and friction patches drag on it.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactophone_lab.simulation.finger import Finger
from tactophone_lab.simulation.mechanics import compiled

Array = NDArray[np.float64]

CONTACT_STATE = np.dtype(
    [
        (name, np.float64)
        for name in (
            *("arm", "arm_speed", "pad", "pad_speed"),
            *("link", "link_speed", "shear", "shear_speed"),
            *("bristle", "load", "friction_noise", "plate_force"),
        )
    ]
)
"""The finger's state: heights and displacements in m, speeds in m/s, the smoothed load
in N, and the filters of friction noise and of the force on the body as a plate."""

BODY = np.dtype(
    [
        *(
            (name, np.float64)
            for name in (
                "stiffness",
                "kinetic",
                "static",
                "stribeck_speed",
                "hiss",
                "hiss_share",
            )
        ),
        *((name, np.float64) for name in ("plate", "plate_share")),
        ("modes", np.int64),
    ]
)
"""A touched body: Hertz' stiffness in N/m^1.5, friction coefficients, Stribeck speed,
rms of micro-slips and the coefficient of their one-pole low-pass, pressure of the body
as a plate in Pa/N and the coefficient of its high-pass, and how many modes it has."""

OVERSAMPLING = 2
"""Steps a sample: the stiffest mode, at 8 kHz, needs a step under 1 / (pi f) = 40 us;
10 us leave it undistorted."""


class Motion(NamedTuple):
    """The hand's motion in a block, per sample: position along the track (m), speed
    (m/s), press (N), index of the body under the finger, and that body's height (m)."""

    position: Array
    speed: Array
    press: Array
    body: NDArray[np.int64]
    height: Array


class Ground(NamedTuple):
    """All that can be touched: tracks ``(bodies, SIZE)``, SIZE a power of two, their
    spacing (m), and the bodies.

    ``modes`` has a row for each body and, last, one for the finger itself, which uses
    the first ``flexure`` modes of its row.
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
    """The kernel's output, per sample: force at piezo and contact (N), pressure from
    finger and body (Pa)."""

    strain: Array
    force: Array
    finger: Array
    body: Array


_MAX_FORCE = 60.0
"""Newtons; beyond any stroke. Keeps extreme settings from diverging."""

_GRIP = 0.1
"""Share of friction that drives a body's modes, whose motion is mostly along the
normal."""

_BEND = 0.25
"""Share of friction that bends the finger's shell: the pad's height over its neutral
axis by its length."""


_TINY = 1e-60
"""Displacements and speeds below are set to zero: no sound changes by a bit. A body
that the finger has left would ring on with ever smaller numbers, which processors
compute a hundred times slower below 1e-308."""

_CLEAN_INTERVAL = 256
"""Samples between two such searches."""


@compiled
def slide(
    motion: Motion,
    noise: Array,
    ground: Ground,
    finger: Finger,
    state: NDArray[np.void],
    ringing: Ringing,
    signals: ContactSignals,
    rate: float,
) -> None:
    """Move the finger through one block; ``noise`` is unit normal, of shape ``(samples,
    OVERSAMPLING)``."""
    step = 1.0 / (OVERSAMPLING * rate)
    s = state[0]
    for i in range(motion.position.size):
        if i % _CLEAN_INTERVAL == 0:
            _clear_tiny(s, ringing)
        strain, force, air, radiated = 0.0, 0.0, 0.0, 0.0
        for k in range(OVERSAMPLING):
            at = motion.position[i] + k * step * motion.speed[i]
            step_signals = _step(
                s,
                finger,
                ground,
                ringing,
                motion.body[i],
                at,
                motion.speed[i],
                motion.press[i],
                motion.height[i],
                noise[i, k],
                step,
            )
            strain += step_signals[0]
            force += step_signals[1]
            air += step_signals[2]
            radiated += step_signals[3]
        signals.strain[i], signals.force[i] = (
            strain / OVERSAMPLING,
            force / OVERSAMPLING,
        )
        signals.finger[i], signals.body[i] = air / OVERSAMPLING, radiated / OVERSAMPLING


@compiled
def _clear_tiny(s: Any, ringing: Ringing) -> None:
    for values in (ringing.displacement, ringing.speed):
        for row in range(values.shape[0]):
            for j in range(values.shape[1]):
                if abs(values[row, j]) < _TINY:
                    values[row, j] = 0.0
    if abs(s.bristle) < _TINY:
        s.bristle = 0.0
    if abs(s.load) < _TINY:
        s.load = 0.0
    if abs(s.plate_force) < _TINY:
        s.plate_force = 0.0


@compiled
def _step(
    s: Any,
    finger: Finger,
    ground: Ground,
    ringing: Ringing,
    which: int,
    at: float,
    speed: float,
    press: float,
    height: float,
    noise: float,
    step: float,
) -> tuple[float, float, float, float]:
    body = ground.bodies[which]
    slip = speed + s.link_speed + s.shear_speed
    track, slope, drag = _under(ground, which, at + s.link + s.shear, s.load)
    own = ground.bodies.size
    yielding, yielding_speed = _moved(ringing, which, body.modes)
    bent, bent_speed = _moved(ringing, own, ground.flexure)
    depth = track + height + yielding - s.pad - bent
    rate = slope * slip + yielding_speed - s.pad_speed - bent_speed
    normal = _press(depth, rate, body.stiffness, finger.restitution)
    tangential = _rub(s, body, finger, normal, slip, drag, noise, step)
    pad, shear, shake = _swing(s, finger, press, normal, tangential, step)
    strain = finger.normal_strain * normal + finger.shear_strain * tangential
    bend, flexed = _ring(
        ground, ringing, own, ground.flexure, normal + _BEND * tangential, step
    )
    air = (
        finger.pad_radiation * pad
        + finger.shear_radiation * shear
        + finger.shake_radiation * shake
        + flexed
    )
    # What is under the highest of the body's modes is radiated by them, and by the
    # plate only beyond.
    s.plate_force += body.plate_share * (normal - s.plate_force)
    radiated = body.plate * (normal - s.plate_force)
    for b in range(ground.bodies.size):  # bodies that the finger has left still ring
        push = _GRIP * tangential - normal if b == which else 0.0
        radiated += _ring(ground, ringing, b, ground.bodies[b].modes, push, step)[1]
    s.load += 0.004 * (normal - s.load)
    return strain + bend, normal, air, radiated


@compiled
def _under(
    ground: Ground, which: int, at: float, load: float
) -> tuple[float, float, float]:
    """Height (m), slope and drag under the pad; the patch's averaging is interpolated
    between light and heavy load."""
    place = at / ground.spacing
    left = int(np.floor(place))
    part = place - left
    a = left & (ground.light.shape[1] - 1)
    b = (left + 1) & (ground.light.shape[1] - 1)
    # Hertz' patch grows with the cube root of the load; 4 N is the heavy track's.
    heavy = np.cbrt(min(1.0, load * 0.25))
    first = ground.light[which, a] * (1 - heavy) + ground.heavy[which, a] * heavy
    second = ground.light[which, b] * (1 - heavy) + ground.heavy[which, b] * heavy
    drag = ground.friction[which, a] * (1 - part) + ground.friction[which, b] * part
    return first * (1 - part) + second * part, (second - first) / ground.spacing, drag


@compiled
def _press(depth: float, rate: float, stiffness: float, restitution: float) -> float:
    """Hunt-Crossley: ``K d^1.5 (1 + c d')``, never pulling."""
    if depth <= 0.0:
        return 0.0
    force = stiffness * depth * np.sqrt(depth) * (1.0 + restitution * rate)
    return min(max(force, 0.0), _MAX_FORCE)


@compiled
def _rub(
    s: Any,
    body: Any,
    finger: Finger,
    normal: float,
    slip: float,
    drag: float,
    noise: float,
    step: float,
) -> float:
    """LuGre friction, solved implicitly, with the track's drag and the noise of
    micro-slips; in N, against the slip."""
    if normal <= 0.0:
        s.bristle *= 0.98
        return 0.0
    speed = abs(slip)
    limit = body.kinetic + (body.static - body.kinetic) / (
        1.0 + (slip / body.stribeck_speed) ** 2
    )
    bristle = (s.bristle + step * slip) / (
        1.0 + step * finger.bristle_stiffness * speed / limit
    )
    friction = (
        finger.bristle_stiffness * bristle
        + finger.bristle_damping * (bristle - s.bristle) / step
    )
    s.bristle = bristle
    s.friction_noise += body.hiss_share * (noise - s.friction_noise)
    unit = np.sqrt(
        (2 - body.hiss_share) / body.hiss_share
    )  # of a one-pole low-pass fed with white noise
    hiss = body.hiss * normal**0.8 * np.sqrt(speed * 10.0) * unit * s.friction_noise
    return hiss - normal * (min(max(friction, -1.5), 1.5) + drag)


@compiled
def _swing(
    s: Any, finger: Finger, press: float, normal: float, tangential: float, step: float
) -> tuple[float, float, float]:
    """Step arm, pad and joint; return the accelerations of pad, pad sideways and finger
    (m/s^2)."""
    silicone = finger.pad_stiffness * (s.arm - s.pad) + finger.pad_damping * (
        s.arm_speed - s.pad_speed
    )
    push = -press - finger.arm_damping * s.arm_speed - silicone
    if s.arm > finger.arm_rest:  # the end stop over the hovering finger
        push -= 2e3 * (s.arm - finger.arm_rest) + 10.0 * s.arm_speed
    arm = push / finger.arm_mass
    s.arm_speed += step * arm
    s.arm += step * s.arm_speed
    pad = (silicone + normal) / finger.pad_mass
    s.pad_speed += step * pad
    s.pad += step * s.pad_speed
    omega = 2 * np.pi * finger.link_frequency
    joint = finger.link_mass * (
        omega * omega * s.link + 2 * finger.link_loss * omega * s.link_speed
    )
    sideways = finger.shear_stiffness * s.shear + finger.shear_damping * s.shear_speed
    link = (sideways - joint) / finger.link_mass
    shear = (tangential - sideways) / finger.pad_mass
    s.link_speed += step * link
    s.link += step * s.link_speed
    s.shear_speed += step * (shear - link)
    s.shear += step * s.shear_speed
    return pad, shear, arm + 0.5 * link


@compiled
def _moved(ringing: Ringing, row: int, count: int) -> tuple[float, float]:
    """Displacement (m) and speed (m/s) of the contact, summed over a body's modes."""
    displacement, speed = 0.0, 0.0
    for j in range(count):
        displacement += ringing.displacement[row, j]
        speed += ringing.speed[row, j]
    return displacement, speed


@compiled
def _ring(
    ground: Ground, ringing: Ringing, row: int, count: int, force: float, step: float
) -> tuple[float, float]:
    """Step a body's modes under a force; return the force at the piezo (N) and the
    radiated pressure (Pa)."""
    strain, pressure = 0.0, 0.0
    for j in range(count):
        mode = ground.modes[row, j]
        previous, speed = ringing.displacement[row, j], ringing.speed[row, j]
        pull = force * mode.mobility - mode.damping * speed - mode.stiffness * previous
        ringing.speed[row, j] = speed + step * pull
        ringing.displacement[row, j] = previous + step * ringing.speed[row, j]
        strain += mode.strain * ringing.displacement[row, j]
        pressure += mode.radiation * pull
    return strain, pressure
