"""The demonstration: a finger strokes a smooth stone, then a rough one, and slips off its edge."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset import Recording, write_metadata
from tactophone.simulation.content.catalogue import find
from tactophone.simulation.content.movement import Script, Visit, explore
from tactophone.simulation.content.render_store import touch_segments
from tactophone.simulation.physics.hand import SimulatedHand
from tactophone.simulation.physics.scene import Scene, row
from tactophone.simulation.physics.session_variation import COMPETITION, SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger
from tactophone.types import DEFAULT_TIP, AudioBlock

STROKING = 3.0
"""Seconds on each stone."""

_START = (-0.03, 0.035)


def demonstration(seed: int = 0, *, tip: str = DEFAULT_TIP) -> SimulatedFinger:
    """Return a finger with this tip and a script of about ten seconds, drawn from the seed.

    The stones are those of the competition, on which no shipped model was trained.
    """
    script, scene = _script(delay=0.0, stream=[seed])
    session = SessionVariation.draw(seed, COMPETITION, tip=tip)
    return SimulatedFinger(scene, script.moves, session=session, seed=seed, duration=script.time, place=_START)


def demonstrate_hand(folder: Path, names: Sequence[str], *, seed: int, tip: str = DEFAULT_TIP) -> list[Path]:
    """Write the demonstration by the fingers of a hand, each a moment after the one before; one recording for each.

    All stroke the same stones, and each sounds faintly in the microphones of the others (`SimulatedHand`).
    """
    scripts = [_script(delay=0.15 * place, stream=[seed, place]) for place in range(len(names))]
    longest = max(script.time for script, _ in scripts)
    session = SessionVariation.draw(seed, COMPETITION, tip=tip)
    hand = SimulatedHand(
        [
            SimulatedFinger(scene, script.moves, session=session, seed=[seed, place], place=_START)
            for place, (script, scene) in enumerate(scripts)
        ]
    )
    blocks: list[AudioBlock] = []
    touched: list[list[NDArray[np.int16]]] = []
    while not blocks or blocks[-1].end < longest * hand.sample_rate:
        blocks.append(hand.render(4800))
        touched.append([truth.object_index for truth in hand.truths])
    samples = np.concatenate([block.samples for block in blocks])
    recordings = []
    for place, name in enumerate(names):
        path = folder / f"microphones-{name}.wav"
        soundfile.write(path, samples[:, 2 * place : 2 * place + 2], hand.sample_rate, subtype="PCM_24")
        segments, _ = touch_segments(np.concatenate([found[place] for found in touched]), hand.fingers[place].scene)
        recordings.append(Recording(path, "competition stones", channels=("contact", "air"), segments=segments))
    write_metadata(folder, recordings)
    return [recording.path for recording in recordings]


def _script(*, delay: float, stream: Sequence[int]) -> tuple[Script, Scene]:
    """Return the strokes over a smooth and a rough stone, and the scene."""
    rng = np.random.default_rng([0xDE30, *stream])
    scene = row([find("smooth competition stone"), find("rough competition stone")])
    script = Script(rng, x=_START[0], y=_START[1])
    script.hover(0.6 + delay)
    for placed, slips in zip(scene.placed, (False, True), strict=True):
        explore(script, placed, Visit(STROKING, force=1.8, speed=0.18, slips=slips))
    script.hover(0.5)
    return script, scene


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
