"""The track of a fingertip of given radius and softness over a surface: height, and friction along the way.

A round tip never reaches the floor of a groove narrower than itself: its centre follows the envelope of the profile,
the grey dilation by a parabola (Meli, "Surface metrology of spherical tips", 2002). Its contact patch then averages
over its own width, which grows with load: Remington's filter, ``|H|^2 = 1 / (1 + (pi/4) (k a)^3)`` with Hertz' patch
radius ``a`` (Remington, "Wheel/rail rolling noise", J. Acoust. Soc. Am. 81, 1805, 1987; Johnson, *Contact Mechanics*,
1985, eq. 4.22).
"""

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.simulation.physics.compiled import compiled
from tactophone.simulation.physics.surface import FINEST, SIZE, SPACING, Profile, Surface, height_profile, self_affine

LIGHT, HEAVY = 0.25, 4.0
"""Newtons for which the patch is computed; loads between them are interpolated."""


PATCH = 1.5e-3
"""Metres; wavelength of the largest patches of uneven friction."""


@dataclass(frozen=True, slots=True)
class Material:
    """Properties of a surface besides its shape.

    Parameters
    ----------
    stiffness
        Reduced elastic modulus of the tip's hard skin against it, in Pa.
    asperity_radius
        Radius in m of the summits that carry the load; sets contact stiffness and patch.
    micro_height
        Rms height in m of what is finer than the profile; its impacts act as noise.
    kinetic, static
        Friction coefficients at speed and at rest. The difference is what lets a tip stick and slip; it is *largest* on
        polished surfaces, where the true contact area is large (Persson, J. Chem. Phys. 115, 3840, 2001).
    stribeck_speed
        In m/s; how fast friction falls from the one to the other.
    patchiness
        Relative rms of the friction coefficient along the surface.
    hiss
        Relative rms of the friction force's noise at 0.1 m/s, from micro-slips; grows with the square root of speed.
        It reaches the piezo and hardly the air microphone: sliding sideways moves no air.
    snag_spacing, snag_strength
        Mean distance in m between places that hold the tip and suddenly release it, and the loss of friction there.
    """

    stiffness: float = 2.5e9
    asperity_radius: float = 1.0e-3
    micro_height: float = 1e-6
    kinetic: float = 0.30
    static: float = 0.36
    stribeck_speed: float = 0.010
    patchiness: float = 0.07
    hiss: float = 0.02
    snag_spacing: float = 0.02
    snag_strength: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The tip's path over a surface: heights in m under light and heavy load, and the slope that friction meets."""

    light: NDArray[np.float32]
    heavy: NDArray[np.float32]
    friction: NDArray[np.float32]


@functools.lru_cache(maxsize=64)
def track(surface: Surface, material: Material, tip_radius: float) -> Track:
    """Trace a surface with a tip of this radius in m."""
    traced = envelope(height_profile(surface), tip_radius)
    traced -= traced.mean()
    rng = np.random.default_rng(np.random.SeedSequence([0xF21C, surface.seed]))
    light, heavy = (patch_filter(traced, patch_radius(load, material)) for load in (LIGHT, HEAVY))
    return Track(
        light=light.astype(np.float32),
        heavy=heavy.astype(np.float32),
        friction=_friction(traced, material, rng).astype(np.float32),
    )


def envelope(height: Profile, tip_radius: float) -> Profile:
    """Follow a tip's centre: ``max over u of h(s + u) - u^2 / 2R``, periodic."""
    return np.asarray(_dilate(height, SPACING, tip_radius))


def patch_radius(load: float, material: Material) -> float:
    """Hertz' contact radius in m under a load in N: ``(3 F r / 4 E*)^(1/3)``."""
    return float((0.75 * load * material.asperity_radius / material.stiffness) ** (1 / 3))


def patch_filter(height: Profile, radius: float) -> Profile:
    """Average a profile over a contact patch of this radius in m."""
    wavenumber = 2 * np.pi * np.fft.rfftfreq(height.size, SPACING)
    passed = (wavenumber < 2 * np.pi / FINEST) / np.sqrt(1 + np.pi / 4 * (wavenumber * radius) ** 3)
    return np.fft.irfft(np.fft.rfft(height) * passed, height.size)


def _friction(traced: Profile, material: Material, rng: np.random.Generator) -> Profile:
    """Tangential over normal force beyond plain friction: slope, patches of friction, and snags."""
    slope = np.gradient(patch_filter(traced, patch_radius(1.0, material)), SPACING)
    patches = self_affine(material.kinetic * material.patchiness, PATCH, hurst=0.5, rng=rng)
    uneven = patch_filter(patches + _snags(material, rng), patch_radius(LIGHT, material))
    return np.asarray(slope + uneven)


def _snags(material: Material, rng: np.random.Generator) -> Profile:
    """Ramps that end abruptly: the tip is held, then released."""
    out = np.zeros(SIZE)
    count = rng.poisson(SIZE * SPACING / material.snag_spacing)
    strength = np.minimum(material.snag_strength * np.exp(0.6 * rng.standard_normal(count)), 1.2)
    for place, peak, width in zip(
        rng.integers(SIZE, size=count), strength, rng.uniform(0.15e-3, 0.5e-3, count), strict=True
    ):
        ramp = int(width / SPACING)
        out[(place + np.arange(ramp)) % SIZE] += np.linspace(0, peak, ramp)
    return out - out.mean()


@compiled
def _dilate(height: Profile, spacing: float, radius: float) -> Profile:
    size, top = height.size, height.max()
    reach = min(size // 2, int(np.ceil(np.sqrt(2 * radius * (top - height.min())) / spacing)))
    out = np.empty(size)
    for i in range(size):
        best = height[i]
        for k in range(1, reach + 1):
            drop = (k * spacing) ** 2 / (2 * radius)
            if top - drop <= best:
                break
            best = max(best, height[(i + k) % size] - drop, height[i - k] - drop)
        out[i] = best
    return out
