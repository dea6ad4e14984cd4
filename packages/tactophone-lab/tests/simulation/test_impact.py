"""Energy at impact: a tip that bounces on a body keeps it, and loses of it what Hunt
and Crossley's damping takes."""

import numpy as np
import pytest

from tactophone_lab.simulation.contact import (
    BODY,
    CONTACT_STATE,
    OVERSAMPLING,
    ContactSignals,
    Ground,
    Motion,
    Ringing,
    slide,
)
from tactophone_lab.simulation.finger import Finger
from tactophone_lab.simulation.modes import MODE

RATE, SIZE = 48_000, 4800
STIFFNESS = 4 / 3 * 3e9 * np.sqrt(1e-3)
SPEED = 0.05

ELASTIC = Finger(
    arm_rest=1.0,
    arm_damping=0.0,
    pad_damping=0.0,
    shear_damping=0.0,
    link_loss=0.0,
    restitution=0.0,
    bristle_damping=0.0,
)
"""A finger that loses nothing, its end stop far away."""


def bounce(finger: Finger) -> tuple[np.ndarray, np.ndarray]:
    """Drop the finger at `SPEED` on a rigid plate; return the final state and the force
    over time."""
    state = np.zeros(1, CONTACT_STATE)
    state["arm"] = state["pad"] = 1e-4
    state["arm_speed"] = state["pad_speed"] = -SPEED
    bodies = np.zeros(1, BODY)
    bodies["stiffness"], bodies["kinetic"], bodies["static"] = STIFFNESS, 0.3, 0.3
    bodies["stribeck_speed"], bodies["hiss_share"] = 0.01, 0.1
    flat = np.zeros((1, 8), np.float32)
    ground = Ground(flat, flat, flat, 1e-6, bodies, np.zeros((2, 1), MODE), 0)
    signals = ContactSignals(*(np.empty(SIZE) for _ in ContactSignals._fields))
    motion = Motion(
        np.zeros(SIZE),
        np.zeros(SIZE),
        np.zeros(SIZE),
        np.zeros(SIZE, np.int64),
        np.zeros(SIZE),
    )
    ringing = Ringing(np.zeros((2, 1)), np.zeros((2, 1)))
    slide(
        motion,
        np.zeros((SIZE, OVERSAMPLING)),
        ground,
        finger,
        state,
        ringing,
        signals,
        float(RATE),
    )
    return state[0], signals.force


def energy(state: np.ndarray, finger: Finger) -> float:
    """Of the finger off the plate: two masses and the silicone between them."""
    return float(
        0.5 * finger.arm_mass * state["arm_speed"] ** 2
        + 0.5 * finger.pad_mass * state["pad_speed"] ** 2
        + 0.5 * finger.pad_stiffness * (state["arm"] - state["pad"]) ** 2
    )


def test_an_elastic_impact_keeps_the_energy() -> None:
    state, force = bounce(ELASTIC)
    assert force.max() > 1.0
    assert force[-480:].max() == 0.0
    before = 0.5 * (ELASTIC.arm_mass + ELASTIC.pad_mass) * SPEED**2
    assert energy(state, ELASTIC) == pytest.approx(before, rel=0.01)


def test_the_momentum_changes_by_the_impulse() -> None:
    state, force = bounce(ELASTIC)
    after = (
        ELASTIC.arm_mass * state["arm_speed"] + ELASTIC.pad_mass * state["pad_speed"]
    )
    before = -(ELASTIC.arm_mass + ELASTIC.pad_mass) * SPEED
    assert force.sum() / RATE == pytest.approx(after - before, rel=0.01)


@pytest.mark.parametrize("damping", [2.0, 8.0, 14.0])
def test_damping_takes_what_hunt_and_crossley_say(damping: float) -> None:
    """A lone mass keeps a share ``e`` of its speed, by ``c v (1 + e) = ln((1 + c v) /
    (1 - e c v))``."""
    state, _ = bounce(ELASTIC._replace(pad_stiffness=0.0, restitution=damping))
    share, number = state["pad_speed"] / SPEED, damping * SPEED
    assert np.log((1 + number) / (1 - share * number)) == pytest.approx(
        number * (1 + share), rel=0.02
    )
