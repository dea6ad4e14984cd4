"""Contact mechanics against textbook limits, and the table of tips and surfaces by
which shots differ from noise."""

import numpy as np
import pytest

from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.finger import TIPS
from tactophone_lab.simulation.mechanics import (
    SKIN,
    hertz_patch,
    reduced_modulus,
    tip_on_body,
)
from tactophone_lab.simulation.surface import (
    HEIGHT_SPACING,
    SIZE,
    envelope,
    height_profile,
    mechanics_of,
)

SPEED = 0.1
"""m/s, of the table."""

LENGTH = SIZE * HEIGHT_SPACING


def test_a_smooth_contact_is_hertz() -> None:
    smooth = tip_on_body(1e-3, 220e9, 60e9, rq=0.0)
    assert smooth.modulus == pytest.approx(1 / (1 / 220e9 + 1 / 60e9))
    assert smooth.radius == pytest.approx(1e-3)
    assert smooth.patch(1.0) == pytest.approx(
        (3 * 1e-3 / (4 * smooth.modulus)) ** (1 / 3)
    )


def test_a_very_rough_contact_is_one_crushed_summit() -> None:
    rough = tip_on_body(1e-3, 220e9, 60e9, rq=1e-3)
    hardness = 60e9 / 15
    assert np.pi * rough.patch(1.0) ** 2 * hardness == pytest.approx(1.0, rel=0.05)


def test_rubber_is_not_crushed() -> None:
    modulus = reduced_modulus(4e6, 60e9)
    assert tip_on_body(6e-3, 4e6, 60e9, rq=1e-4).patch(1.0) == pytest.approx(
        hertz_patch(6e-3, modulus)
    )


def test_the_impact_lasts_as_long_as_hertz_says() -> None:
    """Half a period on the loaded spring is near Hertz' 2.87 (m^2 / R E^2 v)^(1/5) for
    an impact of about that load."""
    contact = tip_on_body(1e-3, 220e9, 60e9, rq=0.0)
    mass, speed = 5e-3, 0.02
    free = 2.87 * (mass**2 / (1e-3 * contact.modulus**2 * speed)) ** 0.2
    # The mean load of that impact is its momentum over its duration.
    assert 0.5 / contact.corner(mass, 2 * mass * speed / free) == pytest.approx(
        free, rel=0.25
    )


def test_adhesion_is_one_for_the_default_tip_and_little_for_steel() -> None:
    assert tip_on_body(3e-3, SKIN, 60e9, rq=0.0).adhesion == pytest.approx(1.0)
    assert 0.1 < tip_on_body(1e-3, 220e9, 60e9, rq=0.0).adhesion < 0.3
    assert tip_on_body(6e-3, 4e6, 60e9, rq=0.0).adhesion == 2.0


@pytest.mark.parametrize(
    ("tip", "radius", "name", "patch_um", "corner", "strikes", "strong", "overlap"),
    [
        ("rubber", 6e-3, "3", 1040, 187, 3800, 420, 10.0),
        ("pad", 3e-3, "3", 85, 1490, 5200, 620, 1.7),
        ("pad", 3e-3, "21", 72, 1020, 2400, 160, 1.2),
        ("pad", 3e-3, "20", 50, 840, 750, 25, 0.44),
        ("pad", 3e-3, "0", 47, 1090, 540, 12, 0.25),
        ("stylus", 1e-3, "3", 20, 3080, 7600, 1000, 1.2),
        ("stylus", 1e-3, "11", 30, 1540, 1500, 45, 0.48),
        ("stylus", 1e-3, "24", 34, 1420, 1100, 57, 0.39),
    ],
)
def test_rough_is_a_few_strong_strikes_and_smooth_many_weak_ones(
    tip: str,
    radius: float,
    name: str,
    patch_um: float,
    corner: float,
    strikes: float,
    strong: float,
    overlap: float,
) -> None:
    """The overlap number: strikes a second by the duration of one; under 1 they stand
    alone, over 1 they merge."""
    mass = 5e-3 if tip == "stylus" else 6e-3
    obj = find(name)
    height = height_profile(obj.surface)
    contact = mechanics_of(height, obj.material, radius, TIPS[tip].finger.tip_modulus)
    jumps = strike_jumps(height, radius)
    share = np.cumsum(jumps**2) / np.sum(jumps**2)
    rate = SPEED * len(jumps) / LENGTH
    assert contact.patch(1.0) * 1e6 == pytest.approx(patch_um, rel=0.15)
    assert contact.corner(mass) == pytest.approx(corner, rel=0.15)
    assert rate == pytest.approx(strikes, rel=0.25)
    assert SPEED * (np.searchsorted(share, 0.5) + 1) / LENGTH == pytest.approx(
        strong, rel=0.35
    )
    assert rate * 0.5 / contact.corner(mass) == pytest.approx(overlap, rel=0.25)


def strike_jumps(height: np.ndarray, radius: float) -> np.ndarray:
    """Jumps of slope at the envelope's cusps, largest first; the grid's own are under
    two steps of curvature."""
    jumps = np.diff(np.diff(envelope(height, radius)) / HEIGHT_SPACING)
    return np.sort(jumps[jumps > 2 * HEIGHT_SPACING / radius])[::-1]
