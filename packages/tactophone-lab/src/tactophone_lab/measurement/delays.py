"""Decision delay: from contact to the first vibration, and from an edge between
surfaces to the changed vibration.

The simulated finger strokes to and fro over a smooth and a rough stone side by side,
and taps them now and then. Its sound goes through the same pipeline as live sound, in
virtual time, and the oscillator renders the result. Network and devices are measured
separately (`tactophone_lab.measurement.impulses`) and add to these delays.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray, Touch
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.haptics.profiles import ROUGH_STIMULUS, SMOOTH_STIMULUS
from tactophone.signal.pipeline import Pipeline
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.motion import row
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import Script

BLOCK = 120
"""Samples of a packet of 2.5 ms."""

MIDDLE = sqrt(SMOOTH_STIMULUS.frequency * ROUGH_STIMULUS.frequency)
"""Hz that separate the smooth from the rough vibration: their geometric mean."""

FIRST_VIBRATION = 1e-4
"""Amplitude above which a sample vibrates, as in `impulses`."""

CHANGED_FOR = 0.03
"""Seconds that a changed vibration must last to count: the shortest burst that is felt
(Sci. Rep. 2025, 15:5057)."""

MAX_DECISION_DELAY = 0.6
"""Seconds after which a change counts as missed."""

HOP = 0.06
"""Seconds without contact that are not a lift."""

STONE_PITCH = 0.085
"""Metres between the centres of the stones: their width, so that the finger slides from
one to the next."""


@dataclass(slots=True)
class DecisionDelays:
    """Seconds from each event to the vibration that it caused, and the number of events
    that caused none."""

    touch: list[float] = field(default_factory=list)
    """From contact to the first sample that vibrates."""
    edge: list[float] = field(default_factory=list)
    """From the edge between smooth and rough until the frequency crosses `MIDDLE`."""
    missed_touches: int = 0
    missed_edges: int = 0


def measure_decisions(
    pipeline: Pipeline, *, passes: int = 20, seed: int = 0
) -> DecisionDelays:
    """Stroke, detect and render, and measure the delays.

    The pipeline is for two channels at 48 kHz. Of ``passes`` over the edge, a lift and
    a new touch follow every fourth.
    """
    touch, waveform, frequency = _render(pipeline, passes, seed)
    touch = _without_hops(touch)
    delays = DecisionDelays()
    touching = touch != Touch.NONE
    longest = int(MAX_DECISION_DELAY * LIVE_SAMPLE_RATE)
    lasting = int(CHANGED_FOR * LIVE_SAMPLE_RATE)
    for onset in _onsets(touching):
        loud = np.flatnonzero(
            np.abs(waveform[onset : onset + longest]) > FIRST_VIBRATION
        )
        if len(loud):
            delays.touch.append(float(loud[0]) / LIVE_SAMPLE_RATE)
        else:
            delays.missed_touches += 1
    for edge in (
        np.flatnonzero((touch[1:] != touch[:-1]) & touching[1:] & touching[:-1]) + 1
    ):
        # The vibration has changed once its frequency is on the new surface's side of
        # `MIDDLE` and stays there.
        after = frequency[edge : edge + longest]
        changed = after < MIDDLE if touch[edge] == Touch.ROUGH else after > MIDDLE
        # The convolution counts the changed samples in each stretch of `lasting`.
        found = np.flatnonzero(
            np.convolve(changed, np.ones(lasting), mode="valid") == lasting
        )
        if len(found):
            delays.edge.append(float(found[0]) / LIVE_SAMPLE_RATE)
        else:
            delays.missed_edges += 1
    return delays


def _without_hops(touch: NDArray[np.int8]) -> NDArray[np.int8]:
    """Fill moments without contact that are too short to be a lift: over an edge, the
    finger hops."""
    filled = touch.copy()
    starts = np.flatnonzero(np.diff(touch, prepend=np.int8(-1)))
    ends = np.append(starts[1:], len(touch))
    for start, end in zip(starts, ends, strict=True):
        if (
            start
            and touch[start] == Touch.NONE
            and end - start < HOP * LIVE_SAMPLE_RATE
        ):
            filled[start:end] = filled[start - 1]
    return filled


def _render(
    pipeline: Pipeline, passes: int, seed: int
) -> tuple[NDArray[np.int8], FloatArray, NDArray[np.float64]]:
    """Return, sample by sample, the true touch, the waveform, and the frequency of the
    newest command in Hz.

    The frequency is that after each sample's block, and NaN while the command's
    amplitude is 0.
    """
    finger, duration = _finger(passes, seed)
    oscillator = Oscillator(Limits())
    # The vibration caused by a block starts at the block's end at the earliest: hence a
    # silent block before the first.
    touch = []
    waveform = [np.zeros(BLOCK, np.float32)]
    frequency = [np.nan]
    for _ in range(int(duration * LIVE_SAMPLE_RATE / BLOCK)):
        step = pipeline.push(finger.render(BLOCK))
        for command in step.commands:
            oscillator.submit(command)
        out = np.empty(BLOCK, np.float32)
        oscillator.render(out)
        touch.append(finger.truth.touch)
        waveform.append(out)
        newest = frequency[-1]
        if step.command is not None:
            newest = step.command.frequency if step.command.amplitude else np.nan
        frequency.append(newest)
    return (
        np.concatenate(touch),
        np.concatenate(waveform[:-1]),
        np.repeat(np.array(frequency[:-1]), BLOCK),
    )


def _finger(passes: int, seed: int) -> tuple[SimulatedFinger, float]:
    scene = row([find("smooth competition stone"), find("20")], pitch=STONE_PITCH)
    rng = np.random.default_rng([0xED6E, seed])
    depth = scene.placed[0].centre[1]
    script = Script(rng, x=STONE_PITCH * 0.7, y=depth)
    script.hover(0.8)
    for number in range(passes):
        force = rng.uniform(1.0, 2.0)
        if number % 4 == 0:
            script.hover(0.6)
            script.land(force)
        reach = rng.uniform(0.2, 0.35) * STONE_PITCH
        script.stroke(
            STONE_PITCH + (reach if number % 2 == 0 else -reach),
            rng.uniform(0.7, 1.1),
            force,
        )
    script.hover(0.5)
    return SimulatedFinger(
        scene, script.moves, seed=seed, place=(STONE_PITCH * 0.7, depth)
    ), script.time


def _onsets(touching: NDArray[np.bool_]) -> Iterator[int]:
    """Yield the first sample of each touch that follows 0.2 s without contact and lasts
    most of 0.1 s."""
    for onset in np.flatnonzero(touching[1:] & ~touching[:-1]) + 1:
        before = touching[max(0, onset - LIVE_SAMPLE_RATE // 5) : onset]
        after = touching[onset : onset + LIVE_SAMPLE_RATE // 10]
        if not before.any() and after.mean() > 0.8:
            yield int(onset)
