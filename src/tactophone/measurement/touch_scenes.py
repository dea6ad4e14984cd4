"""Simulated scenes of taps, strokes and knocks in the air, with the moment of each: truth for touch events.

A tap is a touch of under 0.12 s without sliding; a stroke begins where the finger lands to slide and ends in a
lift-off. A knock in the air reaches the air microphone alone, but for the little that the finger passes on.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.simulation import SessionVariation, SimulatedFinger, find, single
from tactophone.simulation.content.movement import Script
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray

KNOCK_TO_CONTACT_DB = -20.0
"""What the finger passes on of a knock in the air to its contact microphone: a guess, as nobody measured it."""


@dataclass(frozen=True, slots=True)
class TouchScene:
    """Sound of two microphones, shape ``(samples, 2)``, and the time in s of each tap, stroke, lift-off and knock."""

    sound: FloatArray
    taps: tuple[float, ...]
    strokes: tuple[float, ...]
    lift_offs: tuple[float, ...]
    knocks: tuple[float, ...]


def touch_scene(name: str, *, seed: int, duration: float = 12.0, taps: bool = True, knocks: bool = True) -> TouchScene:
    """Render a scene on an object of the catalogue.

    Parameters
    ----------
    name
        Of the object, or its number.
    seed
        Of everything random: session, forces, places, motors.
    duration
        In s.
    taps, knocks
        Whether there are any; without taps the finger only slides.
    """
    rng = np.random.default_rng([0x7A9, seed])
    scene = single(find(name))
    placed = scene.placed[0]
    middle, depth = placed.centre
    script = Script(rng, x=middle, y=depth)
    script.hover(0.6)
    while script.time < duration - 1.0:
        if taps and rng.random() < 0.6:
            script.hover(0.15, x=middle + rng.uniform(-0.2, 0.2) * placed.width)
            script.tap(float(rng.uniform(0.7, 3.0)))
        else:
            script.hover(0.3, x=middle - 0.25 * placed.width)
            force = float(rng.uniform(0.5, 2.5))
            script.land(force)
            for target in (0.25, -0.2):
                script.stroke(middle + target * placed.width, float(rng.uniform(0.3, 0.7)), force)
    script.hover(0.4)
    finger = SimulatedFinger(scene, script.moves, session=SessionVariation.draw(seed), seed=seed)
    sound = finger.render(round(script.time * LIVE_SAMPLE_RATE)).samples.copy()
    begins, ends = _touches(finger.truth.object_index >= 0)
    is_tap = [end - begin < 0.12 for begin, end in zip(begins, ends, strict=True)]
    made = _add_knocks(sound, begins, ends, rng) if knocks else ()
    return TouchScene(
        sound,
        tuple(begin for begin, tap in zip(begins, is_tap, strict=True) if tap),
        tuple(begin for begin, tap in zip(begins, is_tap, strict=True) if not tap),
        tuple(end for end, tap in zip(ends, is_tap, strict=True) if not tap),
        made,
    )


def _touches(contact: NDArray[np.bool_]) -> tuple[list[float], list[float]]:
    """Return when touches begin and end, in s; bounces of under 60 ms are one touch."""
    edges = np.flatnonzero(np.diff(contact, prepend=False, append=False)).reshape(-1, 2) / LIVE_SAMPLE_RATE
    begins: list[float] = []
    ends: list[float] = []
    for begin, end in edges:
        if ends and begin - ends[-1] < 0.06:
            ends[-1] = float(end)
        else:
            begins.append(float(begin))
            ends.append(float(end))
    return begins, ends


def _add_knocks(
    sound: FloatArray, begins: list[float], ends: list[float], rng: np.random.Generator
) -> tuple[float, ...]:
    """Add a knock into each second gap between touches: a decaying burst of air, and a little of it by contact."""
    knocks = []
    for end, begin in list(zip(ends, begins[1:], strict=False))[::2]:
        if begin - end < 0.25:
            continue
        knock = (end + begin) / 2
        size = round(0.03 * LIVE_SAMPLE_RATE)
        envelope = np.exp(-np.arange(size) / (0.004 * LIVE_SAMPLE_RATE))
        burst = rng.normal(0, 0.25, size) * envelope
        place = slice(round(knock * LIVE_SAMPLE_RATE), round(knock * LIVE_SAMPLE_RATE) + size)
        sound[place, 1] += burst
        sound[place, 0] += 10 ** (KNOCK_TO_CONTACT_DB / 20) * burst
        knocks.append(knock)
    np.clip(sound, -1, 1, out=sound)
    return tuple(knocks)
