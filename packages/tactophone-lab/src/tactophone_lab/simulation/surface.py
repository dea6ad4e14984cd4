"""Surfaces as statistics of their height, and the track of a fingertip over them.

A surface is a sum: a self-affine profile (rms height, roll-off wavelength, Hurst
exponent), grains, pits, periodic ridges, waviness, and a fine texture down to some
micrometres. From these a periodic profile of 0.655 m is drawn, the same at every call
for the same surface. All lengths in metres.

A fingertip of given radius and softness has a track over a surface: height, and
friction along the way. A round tip never reaches the floor of a groove narrower than
itself: its centre follows the envelope of the profile, the grey dilation by a parabola
(Meli, "Surface metrology of spherical tips", 2002). The envelope consists of smooth
arcs joined by downward cusps, where the tip leaves one asperity and meets the next: its
normal speed jumps by ``v l / R`` (``v`` slip, ``l`` distance of the two summits, ``R``
the tip's radius). So the rate and strength of the impacts follow from the heights;
nothing is drawn for an impact.

The contact patch then averages over its own width, which grows with load: Remington's
filter, ``|H|^2 = 1 / (1 + (pi/4) (k a)^3)`` with the patch radius ``a`` (Remington,
"Wheel/rail rolling noise", J. Acoust. Soc. Am. 81, 1805, 1987), of
:mod:`~tactophone_lab.simulation.mechanics`.
"""

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone_lab.simulation.mechanics import (
    ContactMechanics,
    compiled,
    hertz_patch,
    reduced_modulus,
    tip_on_body,
)

Profile = NDArray[np.float64]

HEIGHT_SPACING = 1.25e-6
"""Metres between two samples of a profile: a third of the finest wavelength, a step of
the contact at 0.12 m/s."""

SIZE = 1 << 19
"""Samples of a profile: 0.655 m, longer than any stroke, and quick to transform."""

FINEST = 20e-6
"""Shortest wavelength in m of the coarse part of a surface; the fine texture goes on
from there."""

FINEST_TEXTURE = 4e-6
"""Shortest wavelength in m of the fine texture: a third of the smallest patch, of steel
on steel."""

_TEXTURE_ROLLOFF = 50.0, 10e-6, 300e-6
"""The fine texture's roll-off by its rms height, and bounds in m: an rms slope of about
0.1 and an RSm of about 50 Rq, as ground, honed and cast surfaces have them (Persson et
al. 2005, section 2; Thomas, *Rough Surfaces*, 1999)."""


@dataclass(frozen=True, slots=True)
class Grains:
    """Rounded grains, one about every ``spacing``; heights are log-normal about
    ``height``, of ``spread``."""

    spacing: float
    height: float
    spread: float = 0.5
    filling: float = 1.0


@dataclass(frozen=True, slots=True)
class Pits:
    """Rounded pits strewn at random, one every ``spacing`` on average, up to ``width``
    in half-width."""

    spacing: float
    depth: float
    width: float = 0.3e-3


@dataclass(frozen=True, slots=True)
class Ridges:
    """Periodic ridges, one every ``period``, as of a weave, a mesh or a brushed sheet;
    ``height`` is the amplitude."""

    period: float
    height: float


@dataclass(frozen=True, slots=True)
class Surface:
    """The statistics of a surface's height.

    - ``name``, ``seed``: identifier, and the seed of its profile.
    - ``rms_height``: of the coarse self-affine part, down to `FINEST`, in m.
    - ``rolloff``: wavelength in m beyond which the self-affine spectrum is flat; the
      correlation length is about a sixth of it.
    - ``hurst``: Hurst exponent, from 0 (jagged) to 1 (smooth); 0.8 is usual for
      fractured and worn surfaces (Persson et al., "On the nature of surface roughness",
      J. Phys.: Condens. Matter 17, R1, 2005).
    - ``waviness``: rms height in m of form and waviness, of wavelengths between 3 and
      20 mm.
    - ``fine_height``: rms height in m of the fine texture, a self-affine part down to
      `FINEST_TEXTURE`.
    - ``grains``, ``pits``, ``ridges``: features added to the profile.
    """

    name: str
    seed: int
    rms_height: float
    rolloff: float
    hurst: float = 0.8
    waviness: float = 0.0
    fine_height: float = 0.0
    grains: Grains | None = None
    pits: Pits | None = None
    ridges: Ridges | None = None


def height_profile(surface: Surface) -> Profile:
    """Draw the surface's height along a line, in m, of mean 0; periodic, and the same
    at every call."""
    rng = np.random.default_rng(np.random.SeedSequence([0x5EED, surface.seed]))
    height = np.zeros(SIZE)
    if surface.grains:
        height += _grains(surface.grains, rng)
    height += self_affine(
        surface.rms_height, surface.rolloff, hurst=surface.hurst, rng=rng
    )
    if surface.pits:
        height -= _pits(surface.pits, rng)
    if surface.waviness:
        height += self_affine(surface.waviness, 20e-3, hurst=1.0, finest=3e-3, rng=rng)
    if surface.ridges:
        height += _ridges(surface.ridges)
    if surface.fine_height:
        height += _fine_texture(surface)
    return height - height.mean()


def _fine_texture(surface: Surface) -> Profile:
    """Draw what the tip's cusps are made of, from a generator of its own."""
    ratio, least, most = _TEXTURE_ROLLOFF
    rng = np.random.default_rng(np.random.SeedSequence([0xF19E, surface.seed]))
    rolloff = min(max(ratio * surface.fine_height, least), most)
    return self_affine(
        surface.fine_height, rolloff, hurst=0.8, rng=rng, finest=FINEST_TEXTURE
    )


def self_affine(
    rms: float,
    rolloff: float,
    *,
    hurst: float,
    rng: np.random.Generator,
    finest: float = FINEST,
) -> Profile:
    """Draw a self-affine profile of this rms, whose spectrum falls as ``(1 +
    (q/q_r)^2)^-(H + 1/2)``.

    That is the one-dimensional spectrum of a self-affine surface with roll-off ``q_r``
    (Persson et al., section 3).
    """
    # Only the waves that are drawn: half a million numbers for each part would take
    # most of the time.
    frequency = np.arange(int(SIZE * HEIGHT_SPACING / finest) + 1) / (
        SIZE * HEIGHT_SPACING
    )
    power = (1 + (frequency * rolloff) ** 2) ** (-(hurst + 0.5))
    power[0] = 0
    phase = rng.standard_normal(power.size) + 1j * rng.standard_normal(power.size)
    height = np.fft.irfft(np.sqrt(power) * phase, SIZE)
    return np.asarray(height * (rms / height.std()))


def _grains(grains: Grains, rng: np.random.Generator) -> Profile:
    sites = int(SIZE * HEIGHT_SPACING / grains.spacing)
    filled = rng.random(sites) < grains.filling
    place = (np.arange(sites) + rng.uniform(-0.45, 0.45, sites))[
        filled
    ] * grains.spacing
    height = grains.height * np.exp(grains.spread * rng.standard_normal(place.size))
    radius = grains.spacing * rng.uniform(0.45, 0.85, place.size)
    return _caps(place, height, radius)


def _pits(pits: Pits, rng: np.random.Generator) -> Profile:
    count = int(SIZE * HEIGHT_SPACING / pits.spacing)
    place = rng.random(count) * SIZE * HEIGHT_SPACING
    depth = pits.depth * np.exp(0.5 * rng.standard_normal(count))
    return _caps(place, depth, pits.width * rng.uniform(0.3, 1.0, count))


def _ridges(ridges: Ridges) -> Profile:
    # A whole number of ridges, so that the profile joins its own beginning.
    count = max(1, round(SIZE * HEIGHT_SPACING / ridges.period))
    return np.asarray(
        ridges.height * np.abs(np.sin(np.pi * count * np.arange(SIZE) / SIZE))
    )


def _caps(place: Profile, height: Profile, radius: Profile) -> Profile:
    out = np.zeros(SIZE)
    _raise_caps(out, place / HEIGHT_SPACING, height, radius / HEIGHT_SPACING)
    return out


@compiled
def _raise_caps(out: Profile, place: Profile, height: Profile, radius: Profile) -> None:
    """Raise elliptic caps out of a plain; where two meet, the higher one shows."""
    for i in range(place.size):
        for k in range(
            int(np.floor(place[i] - radius[i])), int(np.ceil(place[i] + radius[i])) + 1
        ):
            offset = (k - place[i]) / radius[i]
            if offset * offset < 1.0:
                cap = height[i] * np.sqrt(1.0 - offset * offset)
                out[k % out.size] = max(out[k % out.size], cap)


LIGHT = 0.25
"""Lighter of the two loads in N for which the contact patch is computed; loads between
them are interpolated."""

HEAVY = 4.0
"""Heavier of the two loads in N for which the contact patch is computed."""

PATCH = 1.5e-3
"""Metres; wavelength of the largest patches of uneven friction."""


@dataclass(frozen=True, slots=True)
class Material:
    """Properties of a surface besides its shape.

    - ``modulus``: plane-strain modulus ``E / (1 - nu^2)`` in Pa, from handbooks;
      hardness follows from it by class.
    - ``kinetic``, ``static``: friction coefficients of the default tip's skin on it, at
      speed and at rest. The difference is what lets a tip stick and slip; it is
      *largest* on polished surfaces, where the true contact area is large (Persson, J.
      Chem. Phys. 115, 3840, 2001). It, the patches and the hiss scale with the area of
      another tip.
    - ``stribeck_speed``: in m/s; how fast friction falls from the one to the other.
    - ``patchiness``: relative rms of the friction coefficient along the surface.
    - ``hiss``: relative rms of the friction force's noise at 0.1 m/s, from micro-slips;
      grows with the square root of speed. It reaches the piezo and hardly the air
      microphone: sliding sideways moves no air.
    - ``snag_spacing``, ``snag_strength``: mean distance in m between places that hold
      the tip and suddenly release it, and the loss of friction there.
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
    """The tip's path over a surface: heights in m under light and heavy load, the slope
    that friction meets, and the contact's mechanics."""

    light: NDArray[np.float32]
    heavy: NDArray[np.float32]
    friction: NDArray[np.float32]
    mechanics: ContactMechanics


@functools.lru_cache(
    maxsize=16
)  # 6 MB each; five stones and the ground, with room for the next five
def track(
    surface: Surface, material: Material, tip_radius: float, tip_modulus: float
) -> Track:
    """Trace a surface with a tip of this radius in m and plane-strain modulus in Pa."""
    height = height_profile(surface)
    mechanics = mechanics_of(height, material, tip_radius, tip_modulus)
    traced = envelope(height, tip_radius)
    traced -= traced.mean()
    rng = np.random.default_rng(np.random.SeedSequence([0xF21C, surface.seed]))
    spectrum = np.fft.rfft(traced)
    light, heavy = (
        _averaged(spectrum, mechanics.patch(load)) for load in (LIGHT, HEAVY)
    )
    return Track(
        light=light.astype(np.float32),
        heavy=heavy.astype(np.float32),
        friction=_friction(spectrum, material, mechanics, rng).astype(np.float32),
        mechanics=mechanics,
    )


def mechanics_of(
    height: Profile, material: Material, tip_radius: float, tip_modulus: float
) -> ContactMechanics:
    """Compute the contact of a tip with a profile: waves longer than ten patches are
    form, which it follows."""
    patch = hertz_patch(tip_radius, reduced_modulus(tip_modulus, material.modulus))
    spectrum = np.fft.rfft(height) * (
        np.fft.rfftfreq(height.size, HEIGHT_SPACING) > 1 / (10 * patch)
    )
    # Parseval: a one-sided spectrum holds half of the power, the constant and Nyquist
    # terms aside.
    rq = float(np.sqrt(2 * np.sum(np.abs(spectrum) ** 2)) / height.size)
    return tip_on_body(tip_radius, tip_modulus, material.modulus, rq=rq)


def envelope(height: Profile, tip_radius: float) -> Profile:
    """Follow a tip's centre: ``max over u of h(s + u) - u^2 / 2R``, periodic."""
    return np.asarray(_dilate(height, HEIGHT_SPACING, tip_radius))


def patch_filter(height: Profile, radius: float) -> Profile:
    """Average a profile over a contact patch of this radius in m."""
    return _averaged(np.fft.rfft(height), radius)


def _averaged(spectrum: NDArray[np.complex128], radius: float) -> Profile:
    """Average the profile of this spectrum, of an even number of samples, over a
    contact patch."""
    size = 2 * (spectrum.size - 1)
    wavenumber = 2 * np.pi * np.fft.rfftfreq(size, HEIGHT_SPACING)
    passed = (wavenumber < 2 * np.pi / FINEST_TEXTURE) / np.sqrt(
        1 + np.pi / 4 * (wavenumber * radius) ** 3
    )
    return np.fft.irfft(spectrum * passed, size)


def _friction(
    spectrum: NDArray[np.complex128],
    material: Material,
    mechanics: ContactMechanics,
    rng: np.random.Generator,
) -> Profile:
    """Tangential over normal force beyond plain friction: slope, patches of friction,
    and snags.

    ``spectrum`` is the spectrum of the traced profile.
    """
    slope = np.gradient(_averaged(spectrum, mechanics.patch(1.0)), HEIGHT_SPACING)
    patchiness = mechanics.adhesion * material.kinetic * material.patchiness
    patches = self_affine(patchiness, PATCH, hurst=0.5, rng=rng)
    uneven = patch_filter(patches + _snags(material, rng), mechanics.patch(LIGHT))
    return np.asarray(slope + uneven)


def _snags(material: Material, rng: np.random.Generator) -> Profile:
    """Ramps that end abruptly: the tip is held, then released."""
    out = np.zeros(SIZE)
    count = rng.poisson(SIZE * HEIGHT_SPACING / material.snag_spacing)
    strength = np.minimum(
        material.snag_strength * np.exp(0.6 * rng.standard_normal(count)), 1.2
    )
    for place, peak, width in zip(
        rng.integers(SIZE, size=count),
        strength,
        rng.uniform(0.15e-3, 0.5e-3, count),
        strict=True,
    ):
        ramp = int(width / HEIGHT_SPACING)
        out[(place + np.arange(ramp)) % SIZE] += np.linspace(0, peak, ramp)
    return out - out.mean()


@compiled
def _dilate(height: Profile, spacing: float, radius: float) -> Profile:
    """Upper envelope of downward parabolas, one hanging from every height, in linear
    time.

    After Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions",
    Theory of Computing 8, 415 (2012), for a periodic function: the profile is continued
    at both ends by as far as a parabola can reach.
    """
    size = height.size
    reach = min(
        size // 2,
        int(np.ceil(np.sqrt(2 * radius * (height.max() - height.min())) / spacing)) + 1,
    )
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
            # Right of this place the new parabola is the higher one; left of it, the
            # last.
            start = 0.5 * (i + last) - (top - height[(last - reach) % size]) / (
                2 * bend * (i - last)
            )
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
