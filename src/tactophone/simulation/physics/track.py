"""The track of a fingertip of given radius and softness over a surface: height, and friction along the way.

A round tip never reaches the floor of a groove narrower than itself: its centre follows the envelope of the profile,
the grey dilation by a parabola (Meli, "Surface metrology of spherical tips", 2002). The envelope consists of smooth
arcs joined by downward cusps, where the tip leaves one asperity and meets the next: its normal speed jumps by
``v l / R`` (``v`` slip, ``l`` distance of the two summits, ``R`` the tip's radius). So the rate and strength of the
impacts follow from the heights; nothing is drawn for an impact.

The contact patch then averages over its own width, which grows with load: Remington's filter,
``|H|^2 = 1 / (1 + (pi/4) (k a)^3)`` with the patch radius ``a`` (Remington, "Wheel/rail rolling noise", J. Acoust. Soc.
Am. 81, 1805, 1987), of :mod:`~tactophone.simulation.physics.contact_mechanics`.
"""

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.simulation.physics.compiled import compiled
from tactophone.simulation.physics.contact_mechanics import ContactMechanics, hertz_patch, reduced_modulus, tip_on_body
from tactophone.simulation.physics.surface import (
    FINEST_TEXTURE,
    SIZE,
    SPACING,
    Profile,
    Surface,
    height_profile,
    self_affine,
)

LIGHT, HEAVY = 0.25, 4.0
"""Newtons for which the patch is computed; loads between them are interpolated."""


PATCH = 1.5e-3
"""Metres; wavelength of the largest patches of uneven friction."""


@dataclass(frozen=True, slots=True)
class Material:
    """Properties of a surface besides its shape.

    Parameters
    ----------
    modulus
        Plane-strain modulus ``E / (1 - nu^2)`` in Pa, from handbooks; hardness follows from it by class.
    kinetic, static
        Friction coefficients of the default tip's skin on it, at speed and at rest. The difference is what lets a tip
        stick and slip; it is *largest* on polished surfaces, where the true contact area is large (Persson, J. Chem.
        Phys. 115, 3840, 2001). It, the patches and the hiss scale with the area of another tip.
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

    modulus: float = 55e9
    kinetic: float = 0.30
    static: float = 0.36
    stribeck_speed: float = 0.010
    patchiness: float = 0.07
    hiss: float = 0.02
    snag_spacing: float = 0.02
    snag_strength: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The tip's path over a surface: heights in m under light and heavy load, the slope that friction meets, and the
    contact's mechanics."""

    light: NDArray[np.float32]
    heavy: NDArray[np.float32]
    friction: NDArray[np.float32]
    mechanics: ContactMechanics


@functools.lru_cache(maxsize=16)  # 6 MB each; five stones and the ground, with room for the next five
def track(surface: Surface, material: Material, tip_radius: float, tip_modulus: float) -> Track:
    """Trace a surface with a tip of this radius in m and plane-strain modulus in Pa."""
    height = height_profile(surface)
    mechanics = mechanics_of(height, material, tip_radius, tip_modulus)
    traced = envelope(height, tip_radius)
    traced -= traced.mean()
    rng = np.random.default_rng(np.random.SeedSequence([0xF21C, surface.seed]))
    spectrum = np.fft.rfft(traced)
    light, heavy = (_averaged(spectrum, mechanics.patch(load)) for load in (LIGHT, HEAVY))
    return Track(
        light=light.astype(np.float32),
        heavy=heavy.astype(np.float32),
        friction=_friction(spectrum, material, mechanics, rng).astype(np.float32),
        mechanics=mechanics,
    )


def mechanics_of(height: Profile, material: Material, tip_radius: float, tip_modulus: float) -> ContactMechanics:
    """Compute the contact of a tip with a profile: waves longer than ten patches are form, which it follows."""
    patch = hertz_patch(tip_radius, reduced_modulus(tip_modulus, material.modulus))
    spectrum = np.fft.rfft(height) * (np.fft.rfftfreq(height.size, SPACING) > 1 / (10 * patch))
    # Parseval: a one-sided spectrum holds half of the power, the constant and Nyquist terms aside.
    rq = float(np.sqrt(2 * np.sum(np.abs(spectrum) ** 2)) / height.size)
    return tip_on_body(tip_radius, tip_modulus, material.modulus, rq=rq)


def envelope(height: Profile, tip_radius: float) -> Profile:
    """Follow a tip's centre: ``max over u of h(s + u) - u^2 / 2R``, periodic."""
    return np.asarray(_dilate(height, SPACING, tip_radius))


def patch_filter(height: Profile, radius: float) -> Profile:
    """Average a profile over a contact patch of this radius in m."""
    return _averaged(np.fft.rfft(height), radius)


def _averaged(spectrum: NDArray[np.complex128], radius: float) -> Profile:
    """Average the profile of this spectrum, of an even number of samples, over a contact patch."""
    size = 2 * (spectrum.size - 1)
    wavenumber = 2 * np.pi * np.fft.rfftfreq(size, SPACING)
    passed = (wavenumber < 2 * np.pi / FINEST_TEXTURE) / np.sqrt(1 + np.pi / 4 * (wavenumber * radius) ** 3)
    return np.fft.irfft(spectrum * passed, size)


def _friction(
    spectrum: NDArray[np.complex128], material: Material, mechanics: ContactMechanics, rng: np.random.Generator
) -> Profile:
    """Tangential over normal force beyond plain friction: slope, patches of friction, and snags.

    ``spectrum`` is that of the traced profile.
    """
    slope = np.gradient(_averaged(spectrum, mechanics.patch(1.0)), SPACING)
    patchiness = mechanics.adhesion * material.kinetic * material.patchiness
    patches = self_affine(patchiness, PATCH, hurst=0.5, rng=rng)
    uneven = patch_filter(patches + _snags(material, rng), mechanics.patch(LIGHT))
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
    """Upper envelope of downward parabolas, one hanging from every height, in linear time.

    After Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", Theory of Computing 8, 415 (2012),
    for a periodic function: the profile is continued at both ends by as far as a parabola can reach.
    """
    size = height.size
    reach = min(size // 2, int(np.ceil(np.sqrt(2 * radius * (height.max() - height.min())) / spacing)) + 1)
    total = size + 2 * reach
    bend = spacing * spacing / (2 * radius)
    apex = np.empty(total, np.int64)
    begin = np.empty(total)
    count = 0
    for i in range(total):
        top = height[(i - reach) % size]
        start = -np.inf
        while count > 0:
            last = apex[count - 1]
            # Right of this place the new parabola is the higher one; left of it, the last.
            start = 0.5 * (i + last) - (top - height[(last - reach) % size]) / (2 * bend * (i - last))
            if start > begin[count - 1]:
                break
            count -= 1
            start = -np.inf
        apex[count], begin[count] = i, start
        count += 1
    out = np.empty(size)
    k = 0
    for i in range(size):
        while k + 1 < count and begin[k + 1] <= i + reach:
            k += 1
        out[i] = height[(apex[k] - reach) % size] - bend * (i + reach - apex[k]) ** 2
    return out
