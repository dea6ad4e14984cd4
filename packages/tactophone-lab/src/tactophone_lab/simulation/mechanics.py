"""How a round tip meets a rough body: patch, stiffness, contact time and corner, from
radius, moduli and hardness.

A tip under load touches a patch of Hertz' radius ``a = (3 F R / 4 E*)^(1/3)``, with ``1
/ E*`` the sum of the compliances of *both* bodies (Johnson, *Contact Mechanics*, 1985,
section 4.2). On a rough surface fewer summits carry the load. Greenwood and Tripp (J.
Appl. Mech. 34, 153, 1967) measure that by ``alpha = Rq R / a^2``: far under 1 the tip
sinks over many summits and the patch is Hertz'; far over 1 it stands on one summit,
crushed until ``pi a^2 H = F`` (``H``: the softer body's hardness). Between the two, the
patch is their geometric mean, weighed by alpha.

The patch shapes the sound: it averages heights (`track`), it is the spring on which the
tip's mass rings, and it is the area in which friction adheres.

`compiled` compiles the sample loops with numba, once, and caches the machine code
beside the source, or in the user's cache folder where the installation is read-only.
Where neither can be written, as in a container under a foreign user, every start
compiles again.
Beware: numba detects changes only in the file that defines a kernel. So all that a
kernel calls is defined in its file; after changing a tuple or a constant that it
imports, save that too.
"""

import functools
import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np

from tactophone.core.errors import ConfigError
from tactophone.core.foreign_settings import refuse_settings_here

refuse_settings_here("numba")
try:
    import numba
except ImportError as error:  # pragma: no cover
    raise ConfigError(
        "the simulated finger needs numba and scipy, which are not installed: pip "
        "install 'tactophone-lab[sim]'"
    ) from error

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def compiled(kernel: Kernel) -> Kernel:
    """Compile a sample loop at its first call, without the interpreter lock; strictly
    IEEE, so that bits repeat."""
    try:
        return cast(Kernel, numba.njit(cache=True, nogil=True)(kernel))
    except RuntimeError as error:
        # numba raises this, and nothing more specific, where no cache can be written.
        if "cannot cache" not in str(error):
            raise
    _warn_of_no_cache()
    return cast(Kernel, numba.njit(nogil=True)(kernel))


@functools.cache
def _warn_of_no_cache() -> None:
    """Say once in each process that compiled code cannot be kept."""
    logging.getLogger(__name__).warning(
        "the simulated finger is compiled anew at every start, which takes half a "
        "minute: no folder for machine code can be written; set NUMBA_CACHE_DIR to one"
    )


SKIN = 3.3e9
"""Plane-strain modulus in Pa of the default tip's hard skin (ABS, PMMA: E = 2.3 to 3
GPa, Poisson's ratio 0.35 to 0.37). The catalogue's friction figures hold for it."""

YIELDING = 0.1e9
"""Pa; softer bodies (rubber, skin) spring back and are not crushed."""

_TABOR = ((1e10, 15.0), (2e9, 20.0), (0.0, 30.0))
"""Modulus over hardness by class: metal, stone and glass; plaster and resin; wood and
paper (Tabor, *The Hardness of Metals*, 1951: H is three times the yield stress, which
is 1/45 to 1/90 of the modulus)."""

_TANGENTIAL = 0.82
"""Tangential over normal stiffness of a contact, ``2 (1 - nu) / (2 - nu)`` at nu = 0.3
(Mindlin 1949; Johnson 7.4)."""

_ADHESION = 0.05, 2.0
"""Bounds of the adhesive share of friction, relative to the skin's: steel on steel
still rubs, and rubber's friction coefficient is about twice a hard plastic's (Persson,
J. Chem. Phys. 115, 3840, 2001)."""


@dataclass(frozen=True, slots=True)
class ContactMechanics:
    """The contact of one tip with one body.

    - ``modulus``: reduced modulus ``E*`` of both bodies, in Pa.
    - ``radius``: radius in m of the Hertz contact that has the true patch at 1 N.
    - ``adhesion``: adhesive friction, relative to the default tip's skin.
    """

    modulus: float
    radius: float
    adhesion: float

    @property
    def hertz_stiffness(self) -> float:
        """``K`` of ``F = K d^1.5``, in N/m^1.5: ``4/3 E* sqrt(R)`` (Johnson, eq.
        4.23)."""
        return float(4 / 3 * self.modulus * np.sqrt(self.radius))

    def patch(self, load: float) -> float:
        """Radius in m of the patch under a load in N."""
        return float((0.75 * load * self.radius / self.modulus) ** (1 / 3))

    def corner(self, mass: float, load: float = 1.0) -> float:
        """Resonance in Hz of a mass in kg on the loaded contact's normal stiffness ``2
        E* a``."""
        return float(np.sqrt(2 * self.modulus * self.patch(load) / mass) / (2 * np.pi))

    def tangential_corner(self, mass: float) -> float:
        """Resonance in Hz along the surface at 1 N; micro-slips over it do not move the
        mass."""
        return float(np.sqrt(_TANGENTIAL) * self.corner(mass))


def reduced_modulus(first: float, second: float) -> float:
    """Reduced modulus of two plane-strain moduli ``E / (1 - nu^2)``, in Pa.

    >>> round(reduced_modulus(2e9, 2e9))
    1000000000
    """
    return 1 / (1 / first + 1 / second)


def hertz_patch(radius: float, modulus: float) -> float:
    """Radius in m of a smooth sphere's patch at 1 N."""
    return float((0.75 * radius / modulus) ** (1 / 3))


def tip_on_body(
    radius: float, tip: float, body: float, *, rq: float
) -> ContactMechanics:
    """Compute the contact of a tip of this radius (m) and modulus (Pa) with a body of
    this modulus.

    ``rq`` is the rms height in m of the body's roughness within about ten of the tip's
    patches.
    """
    modulus = reduced_modulus(tip, body)
    whole = hertz_patch(radius, modulus)
    # Of the softer body that yields; 0 if none does.
    yielding = [modulus for modulus in (tip, body) if modulus > YIELDING]
    hardness = min(
        (
            each / next(ratio for least, ratio in _TABOR if each > least)
            for each in yielding
        ),
        default=0.0,
    )
    crushed = (
        min(whole, np.sqrt(1 / (np.pi * hardness)))
        if hardness and tip > YIELDING
        else whole
    )
    alpha = rq * radius / whole**2
    patch = whole ** (1 / (1 + alpha)) * crushed ** (alpha / (1 + alpha))
    skin = reduced_modulus(SKIN, body)
    adhesion = float(np.clip((skin / modulus) ** (2 / 3), *_ADHESION))
    return ContactMechanics(modulus, float(patch**3 * modulus / 0.75), adhesion)
