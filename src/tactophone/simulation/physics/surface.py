"""Surfaces as statistics of their height.

A surface is a sum: a self-affine profile (rms height, roll-off wavelength, Hurst exponent),
grains, pits, periodic ridges, waviness, and a fine texture down to some micrometres. From these
a periodic profile of 0.655 m is drawn, the same at every call for the same surface. All lengths
in metres.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.simulation.physics.compiled import compiled
from tactophone.simulation.physics.measured_profile import measured_profile

Profile = NDArray[np.float64]

SPACING = 1.25e-6
"""Metres between two samples of a profile: a third of the finest wavelength, a step of the contact at 0.12 m/s."""

SIZE = 1 << 19
"""Samples of a profile: 0.655 m, longer than any stroke, and quick to transform."""

FINEST = 20e-6
"""Shortest wavelength in m of the coarse part of a surface; the fine texture goes on from there."""

FINEST_TEXTURE = 4e-6
"""Shortest wavelength in m of the fine texture: a third of the smallest patch, of steel on steel."""

_TEXTURE_ROLLOFF = 50.0, 10e-6, 300e-6
"""The fine texture's roll-off by its rms height, and bounds in m: an rms slope of about 0.1 and an RSm of about 50 Rq,
as ground, honed and cast surfaces have them (Persson et al. 2005, section 2; Thomas, *Rough Surfaces*, 1999)."""


@dataclass(frozen=True, slots=True)
class Grains:
    """Rounded grains, one about every ``spacing``; heights are log-normal about ``height``, of ``spread``."""

    spacing: float
    height: float
    spread: float = 0.5
    filling: float = 1.0


@dataclass(frozen=True, slots=True)
class Pits:
    """Rounded pits strewn at random, one every ``spacing`` on average, up to ``width`` in half-width."""

    spacing: float
    depth: float
    width: float = 0.3e-3


@dataclass(frozen=True, slots=True)
class Ridges:
    """Periodic ridges, one every ``period``, as of a weave, a mesh or a brushed sheet; ``height`` is the amplitude."""

    period: float
    height: float


@dataclass(frozen=True, slots=True)
class Surface:
    """The statistics of a surface's height.

    Parameters
    ----------
    name, seed
        Identifier, and the seed of its profile.
    rms_height
        Of the coarse self-affine part, down to `FINEST`, in m.
    rolloff
        Wavelength in m beyond which the self-affine spectrum is flat; the correlation length is about a sixth of it.
    hurst
        Hurst exponent, from 0 (jagged) to 1 (smooth); 0.8 is usual for fractured and worn surfaces (Persson et al.,
        "On the nature of surface roughness", J. Phys.: Condens. Matter 17, R1, 2005).
    waviness
        Rms height in m of form and waviness, of wavelengths between 3 and 20 mm.
    fine_height
        Rms height in m of the fine texture, a self-affine part down to `FINEST_TEXTURE`.
    grains, pits, ridges
        Features added to the profile.
    measured
        Name of a measured profile, used in place of a drawn one.
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
    measured: str = ""


def height_profile(surface: Surface) -> Profile:
    """Draw the surface's height along a line, in m, of mean 0; periodic, and the same at every call."""
    if surface.measured:
        return measured_profile(surface.measured, step=SPACING, size=SIZE)
    rng = np.random.default_rng(np.random.SeedSequence([0x5EED, surface.seed]))
    height = np.zeros(SIZE)
    if surface.grains:
        height += _grains(surface.grains, rng)
    height += self_affine(surface.rms_height, surface.rolloff, hurst=surface.hurst, rng=rng)
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
    return self_affine(surface.fine_height, rolloff, hurst=0.8, rng=rng, finest=FINEST_TEXTURE)


def self_affine(
    rms: float, rolloff: float, *, hurst: float, rng: np.random.Generator, finest: float = FINEST
) -> Profile:
    """Draw a self-affine profile of this rms, whose spectrum falls as ``(1 + (q/q_r)^2)^-(H + 1/2)``.

    That is the one-dimensional spectrum of a self-affine surface with roll-off ``q_r`` (Persson et al., section 3).
    """
    # Only the waves that are drawn: half a million numbers for each part would take most of the time.
    frequency = np.arange(int(SIZE * SPACING / finest) + 1) / (SIZE * SPACING)
    power = (1 + (frequency * rolloff) ** 2) ** (-(hurst + 0.5))
    power[0] = 0
    phase = rng.standard_normal(power.size) + 1j * rng.standard_normal(power.size)
    height = np.fft.irfft(np.sqrt(power) * phase, SIZE)
    return np.asarray(height * (rms / height.std()))


def _grains(grains: Grains, rng: np.random.Generator) -> Profile:
    sites = int(SIZE * SPACING / grains.spacing)
    filled = rng.random(sites) < grains.filling
    place = (np.arange(sites) + rng.uniform(-0.45, 0.45, sites))[filled] * grains.spacing
    height = grains.height * np.exp(grains.spread * rng.standard_normal(place.size))
    radius = grains.spacing * rng.uniform(0.45, 0.85, place.size)
    return _caps(place, height, radius)


def _pits(pits: Pits, rng: np.random.Generator) -> Profile:
    count = int(SIZE * SPACING / pits.spacing)
    place = rng.random(count) * SIZE * SPACING
    depth = pits.depth * np.exp(0.5 * rng.standard_normal(count))
    return _caps(place, depth, pits.width * rng.uniform(0.3, 1.0, count))


def _ridges(ridges: Ridges) -> Profile:
    # A whole number of ridges, so that the profile joins its own beginning.
    count = max(1, round(SIZE * SPACING / ridges.period))
    return np.asarray(ridges.height * np.abs(np.sin(np.pi * count * np.arange(SIZE) / SIZE)))


def _caps(place: Profile, height: Profile, radius: Profile) -> Profile:
    out = np.zeros(SIZE)
    _raise_caps(out, place / SPACING, height, radius / SPACING)
    return out


@compiled
def _raise_caps(out: Profile, place: Profile, height: Profile, radius: Profile) -> None:
    """Raise elliptic caps out of a plain; where two meet, the higher one shows."""
    for i in range(place.size):
        for k in range(int(np.floor(place[i] - radius[i])), int(np.ceil(place[i] + radius[i])) + 1):
            offset = (k - place[i]) / radius[i]
            if offset * offset < 1.0:
                cap = height[i] * np.sqrt(1.0 - offset * offset)
                out[k % out.size] = max(out[k % out.size], cap)
