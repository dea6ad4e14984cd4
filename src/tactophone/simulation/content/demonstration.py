"""The demonstration: a finger strokes a smooth stone, then a rough one, and slips off its edge."""

import numpy as np

from tactophone.simulation.content.catalogue import find
from tactophone.simulation.content.movement import Script, Visit, explore
from tactophone.simulation.physics.scene import row
from tactophone.simulation.physics.session_variation import COMPETITION, SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger

STROKING = 3.0
"""Seconds on each stone."""

_START = (-0.03, 0.035)


def demonstration(seed: int = 0) -> SimulatedFinger:
    """Make the finger, with all that it will do in about ten seconds; the same seed does the same.

    The stones are those of the competition, which no model that ships has been trained on.
    """
    rng = np.random.default_rng([0xDE30, seed])
    scene = row([find("smooth competition stone"), find("rough competition stone")])
    script = Script(rng, x=_START[0], y=_START[1])
    script.hover(0.6)
    for placed, slips in zip(scene.placed, (False, True), strict=True):
        explore(script, placed, Visit(STROKING, force=1.8, speed=0.18, slips=slips))
    script.hover(0.5)
    setup = SessionVariation.draw(seed, COMPETITION)
    return SimulatedFinger(scene, script.moves, setup=setup, seed=seed, duration=script.time, place=_START)
