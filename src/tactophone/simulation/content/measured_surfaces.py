"""Objects whose heights were measured, not drawn: extra surfaces from the optional package ``tdw``."""

import functools

from tactophone.simulation.content.catalogue import SimulatedObject
from tactophone.simulation.physics.measured_profile import FILES
from tactophone.simulation.physics.modes import Body, Mounting
from tactophone.simulation.physics.surface import Surface
from tactophone.simulation.physics.track import Material
from tactophone.types import Touch

FIRST_NUMBER = 100

_WOOD, _PLASTIC, _FLOORING, _CERAMIC = 0.8e9, 3.0e9, 0.3e9, 70e9
"""Plane-strain moduli in Pa: wood across the grain, rigid plastics, vinyl flooring, glaze (Ashby, appendix A)."""

_MODULI = {
    "acrylic": 3.6e9, "bass wood": _WOOD, "ceramic": _CERAMIC, "plywood": _WOOD, "polycarbonate": 2.6e9,
    "polyethylene": 1.0e9, "poplar": _WOOD, "pvc": _PLASTIC, "rough wood": _WOOD, "vinyl": _FLOORING,
}  # fmt: skip


@functools.cache
def measured_objects() -> tuple[SimulatedObject, ...]:
    """Return the measured surfaces as plates on a table, without a label of roughness.

    >>> [obj.name for obj in measured_objects()][:3]
    ['measured acrylic', 'measured bass wood', 'measured ceramic']
    """
    return tuple(_plate(FIRST_NUMBER + k, name) for k, name in enumerate(FILES))


def _plate(number: int, name: str) -> SimulatedObject:
    return SimulatedObject(
        number=number,
        name=f"measured {name}",
        surface=Surface(f"measured {name}", seed=1000 + number, rms_height=0.0, rolloff=1e-3, measured=name),
        material=Material(modulus=_MODULI[name]),
        substance=name,
        label=Touch.NONE,
        body=Body.PANE,
        mounting=Mounting.TABLE,
        length=0.1,
        mass=0.2,
    )
