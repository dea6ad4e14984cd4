"""The demonstration: a finger strokes a smooth stone, then a rough one, and slips off its edge."""

from pathlib import Path

import numpy as np
import soundfile

from tactophone.dataset import Recording, write_metadata
from tactophone.simulation.content.catalogue import find
from tactophone.simulation.content.movement import Script, Visit, explore
from tactophone.simulation.content.render_store import touch_segments
from tactophone.simulation.physics.scene import row
from tactophone.simulation.physics.session_variation import COMPETITION, SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger
from tactophone.types import DEFAULT_TIP

STROKING = 3.0
"""Seconds on each stone."""

_START = (-0.03, 0.035)


def demonstration(seed: int = 0, *, tip: str = DEFAULT_TIP) -> SimulatedFinger:
    """Return a finger with this tip and a script of about ten seconds, drawn from the seed.

    The stones are those of the competition, on which no shipped model was trained.
    """
    rng = np.random.default_rng([0xDE30, seed])
    scene = row([find("smooth competition stone"), find("rough competition stone")])
    script = Script(rng, x=_START[0], y=_START[1])
    script.hover(0.6)
    for placed, slips in zip(scene.placed, (False, True), strict=True):
        explore(script, placed, Visit(STROKING, force=1.8, speed=0.18, slips=slips))
    script.hover(0.5)
    session = SessionVariation.draw(seed, COMPETITION, tip=tip)
    return SimulatedFinger(scene, script.moves, session=session, seed=seed, duration=script.time, place=_START)


def write_demonstration(folder: Path, *, seed: int, tip: str = DEFAULT_TIP) -> Path:
    """Write the demonstration's sound and its labels as a data set of one recording; return the path of the sound."""
    path, finger = folder / "microphones.wav", demonstration(seed, tip=tip)
    indices = []
    with soundfile.SoundFile(path, "w", finger.sample_rate, finger.channels, "PCM_24") as file, finger:
        for block in finger:
            file.write(block.samples)
            indices.append(finger.truth.object_index)
    segments, _ = touch_segments(np.concatenate(indices), finger.scene)
    write_metadata(folder, [Recording(path, "competition stones", channels=("contact", "air"), segments=segments)])
    return path
