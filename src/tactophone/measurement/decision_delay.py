"""How long the decision takes: from a touch to the first vibration, from an edge to a changed feel.

The simulated finger strokes to and fro over a smooth and a rough stone that lie side by side, and taps them now and
then. Its sound goes through the same walk as live sound does, in virtual time, and the oscillator renders the result:
what the line and the devices add is measured elsewhere (`tactophone.measurement.latency`) and comes on top.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from tactophone.endpoints import Pipeline
from tactophone.haptics import Limits, Oscillator
from tactophone.haptics.mapping import ROUGH, SMOOTH
from tactophone.simulation import SimulatedFinger, find, row
from tactophone.simulation.content.movement import Script
from tactophone.types import FloatArray, Touch

RATE = 48_000
BLOCK = 120
"""Samples of a packet of 2.5 ms."""

MIDDLE = sqrt(SMOOTH.frequency * ROUGH.frequency)
"""Hz at which the feel changes sides, half way by ratio."""

FIRST = 1e-4
"""Amplitude from which a sample vibrates, as for clicks."""

CHANGED_FOR = 0.03
"""Seconds that a changed feel must last to count: the shortest burst that is felt (Sci. Rep. 2025, 15:5057)."""

LONGEST = 0.6
"""Seconds after which a change counts as missed."""

HOP = 0.06
"""Seconds without contact that are no lift."""

PITCH = 0.085
"""Metres from stone to stone: their own width, so that the finger slides from one to the next."""


@dataclass(slots=True)
class Delays:
    """Seconds from what happened to what was felt of it, and how often nothing was.

    Parameters
    ----------
    touch
        From contact to the first sample that vibrates.
    edge
        From the edge between smooth and rough to the frequency's crossing of `MIDDLE`.
    """

    touch: list[float] = field(default_factory=list)
    edge: list[float] = field(default_factory=list)
    missed_touches: int = 0
    missed_edges: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    touch: NDArray[np.int8]
    waveform: FloatArray
    frequency: NDArray[np.float64]
    """Of the newest command, after each sample's block; NaN while nothing is felt."""


def measure_decisions(walk: Pipeline, *, passes: int = 20, seed: int = 0) -> Delays:
    """Stroke, judge and feel, and take the times.

    Parameters
    ----------
    walk
        For two channels at 48 kHz, as new.
    passes
        Strokes over the edge; a lift and a new touch come after every fourth.
    """
    run = _felt(walk, passes, seed)
    run = replace(run, touch=_without_hops(run.touch))
    delays = Delays()
    touching = run.touch != Touch.NONE
    for onset in _onsets(touching):
        loud = np.flatnonzero(np.abs(run.waveform[onset : onset + int(LONGEST * RATE)]) > FIRST)
        if len(loud):
            delays.touch.append(float(loud[0]) / RATE)
        else:
            delays.missed_touches += 1
    for edge in np.flatnonzero((run.touch[1:] != run.touch[:-1]) & touching[1:] & touching[:-1]) + 1:
        delay = _time_to_change(run, int(edge))
        if delay is None:
            delays.missed_edges += 1
        else:
            delays.edge.append(delay)
    return delays


def _without_hops(touch: NDArray[np.int8]) -> NDArray[np.int8]:
    """Let a touch last over moments too short to be a lift: over an edge, the finger hops."""
    bridged = touch.copy()
    starts = np.flatnonzero(np.diff(touch, prepend=np.int8(-1)))
    ends = np.append(starts[1:], len(touch))
    for start, end in zip(starts, ends, strict=True):
        if start and touch[start] == Touch.NONE and end - start < HOP * RATE:
            bridged[start:end] = bridged[start - 1]
    return bridged


def _felt(walk: Pipeline, passes: int, seed: int) -> _Run:
    finger, duration = _finger(passes, seed)
    oscillator = Oscillator(Limits())
    # What a block leads to can be felt from the block's end on: hence a silent block before the first.
    touch, waveform = [], [np.zeros(BLOCK, np.float32)]
    frequency = [np.nan]
    for _ in range(int(duration * RATE / BLOCK)):
        tick = walk.push(finger.render(BLOCK))
        for command in tick.commands:
            oscillator.submit(command)
        out = np.empty(BLOCK, np.float32)
        oscillator.render(out)
        newest = tick.command
        touch.append(finger.truth.touch)
        waveform.append(out)
        frequency.append(frequency[-1] if newest is None else newest.frequency if newest.amplitude else np.nan)
    return _Run(np.concatenate(touch), np.concatenate(waveform[:-1]), np.repeat(np.array(frequency[:-1]), BLOCK))


def _finger(passes: int, seed: int) -> tuple[SimulatedFinger, float]:
    scene = row([find("smooth competition stone"), find("20")], pitch=PITCH)
    rng = np.random.default_rng([0xED6E, seed])
    depth = scene.placed[0].centre[1]
    script = Script(rng, x=PITCH * 0.7, y=depth)
    script.hover(0.8)
    for number in range(passes):
        force = rng.uniform(1.0, 2.0)
        if number % 4 == 0:
            script.hover(0.6)
            script.land(force)
        reach = rng.uniform(0.2, 0.35) * PITCH
        script.stroke(PITCH + (reach if number % 2 == 0 else -reach), rng.uniform(0.7, 1.1), force)
    script.hover(0.5)
    return SimulatedFinger(scene, script.moves, seed=seed, place=(PITCH * 0.7, depth)), script.time


def _onsets(touching: NDArray[np.bool_]) -> Iterator[int]:
    """Give each beginning of a touch that lasts, after a time without any."""
    for onset in np.flatnonzero(touching[1:] & ~touching[:-1]) + 1:
        before, after = touching[max(0, onset - RATE // 5) : onset], touching[onset : onset + RATE // 10]
        if not before.any() and after.mean() > 0.8:
            yield int(onset)


def _time_to_change(run: _Run, edge: int) -> float | None:
    """Seconds until the frequency lies on the new surface's side and stays there."""
    rough = run.touch[edge] == Touch.ROUGH
    frequency = run.frequency[edge : edge + int(LONGEST * RATE)]
    right = (frequency < MIDDLE) if rough else (frequency > MIDDLE)
    size = int(CHANGED_FOR * RATE)
    lasting = np.convolve(right, np.ones(size), mode="valid") == size
    found = np.flatnonzero(lasting)
    return float(found[0]) / RATE if len(found) else None
