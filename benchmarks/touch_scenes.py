"""Simulated scenes of taps, strokes, slips and knocks in the air, with the moment of
each: truth for touch events.

A tap is a landing of the finger, whether it slides afterwards or not. Sliding that
follows a landing begins with a stroke; sliding of a finger that rested begins with a
slip; either ends in a lift-off. A knock in the air reaches the air microphone alone,
but for the little that the finger passes on.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray, TouchEvent
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.microphone_models import COMPETITION, SessionVariation
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger, Truth
from tactophone_lab.simulation.strokes import Script

KNOCK_TO_CONTACT_DB = -20.0
"""What the finger passes on of a knock in the air to its contact microphone: a guess,
as nobody measured it."""

BOUNCE = 0.06
"""Seconds; touches closer than this are one."""

TURN = 0.12
"""Seconds; sliding that pauses for less, as where it reverses its direction, is one."""

SLIDING_SPEED = 0.01
"""Metres a second from which a finger slides."""

SHORTEST_SLIDE = 0.05
"""Seconds; what the finger moves while it lands is no sliding."""


@dataclass(frozen=True, slots=True)
class TouchScene:
    """Sound of two microphones, shape ``(samples, 2)``, and what happens in it, oldest
    first."""

    sound: FloatArray
    events: tuple[TouchEvent, ...]

    def times(self, kind: str) -> NDArray[np.float64]:
        """Return the times in s of one kind of event: tap, stroke, slip, lift-off or
        knock."""
        return np.array([event.time for event in self.events if event.kind == kind])


def touch_scene(
    name: str,
    *,
    seed: int,
    duration: float = 12.0,
    taps: bool = True,
    knocks: bool = True,
    motors: bool = False,
    tip: str = DEFAULT_TIP,
) -> TouchScene:
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
    motors
        Whether it takes place in the competition's noise: a hall full of people, and
        running motors.
    tip
        What touches, one of `tactophone.core.tips.TIP_NAMES`.
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
            rests = rng.random() < 0.4
            for target in (0.25, -0.2):
                script.stroke(
                    middle + target * placed.width, float(rng.uniform(0.3, 0.7)), force
                )
                if rests:
                    script.stroke(script.x, 0.5, force)
    script.hover(0.4)
    session = SessionVariation.draw(seed, COMPETITION if motors else None, tip=tip)
    finger = SimulatedFinger(scene, script.moves, session=session, seed=seed)
    sound = finger.render(round(script.time * LIVE_SAMPLE_RATE)).samples.copy()
    events, gaps = _events(finger.truth)
    if knocks:
        events += [TouchEvent("knock", time) for time in _add_knocks(sound, gaps, rng)]
    return TouchScene(sound, tuple(sorted(events, key=lambda event: event.time)))


def _events(truth: Truth) -> tuple[list[TouchEvent], list[tuple[float, float]]]:
    """Return the events of touch, and the gaps between touches."""
    contact = truth.object_index >= 0
    touches = _stretches(contact)
    speed = np.abs(np.gradient(truth.x)) * LIVE_SAMPLE_RATE
    events = [TouchEvent("tap", begin) for begin, _ in touches]
    slid = -1.0
    for begin, end in _stretches(contact & (speed > SLIDING_SPEED), TURN):
        if end - begin >= SHORTEST_SLIDE:
            landed = max((time for time, _ in touches if time <= begin), default=0.0)
            events += [
                TouchEvent("stroke" if slid < landed else "slip", begin),
                TouchEvent("lift-off", end),
            ]
            slid = end
    return events, [(before[1], after[0]) for before, after in pairwise(touches)]


def _stretches(
    on: NDArray[np.bool_], closer: float = BOUNCE
) -> list[tuple[float, float]]:
    """Return begin and end of each stretch, in s; stretches less than ``closer`` (s)
    apart are one."""
    edges = (
        np.flatnonzero(np.diff(on, prepend=False, append=False)).reshape(-1, 2)
        / LIVE_SAMPLE_RATE
    )
    found: list[tuple[float, float]] = []
    for begin, end in edges:
        if found and begin - found[-1][1] < closer:
            found[-1] = found[-1][0], float(end)
        else:
            found.append((float(begin), float(end)))
    return found


def _add_knocks(
    sound: FloatArray, gaps: list[tuple[float, float]], rng: np.random.Generator
) -> list[float]:
    """Add a knock into each second gap between touches: a decaying burst of air, and a
    little of it by contact."""
    knocks = []
    for end, begin in gaps[::2]:
        if begin - end < 0.25:
            continue
        knock = (end + begin) / 2
        size = round(0.03 * LIVE_SAMPLE_RATE)
        envelope = np.exp(-np.arange(size) / (0.004 * LIVE_SAMPLE_RATE))
        burst = rng.normal(0, 0.25, size) * envelope
        place = slice(
            round(knock * LIVE_SAMPLE_RATE), round(knock * LIVE_SAMPLE_RATE) + size
        )
        sound[place, 1] += burst
        sound[place, 0] += 10 ** (KNOCK_TO_CONTACT_DB / 20) * burst
        knocks.append(knock)
    np.clip(sound, -1, 1, out=sound)
    return knocks
