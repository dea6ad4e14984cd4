"""The demonstration: a finger strokes a smooth stone, then a rough one, and slips off
its edge.

`StrokingFinger` and `StrokingHand` explore five stones without end: live sources that
need no hardware.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.core.processes import atomic_write
from tactophone.core.recordings.metadata import add_to_metadata, read_to_rewrite
from tactophone.core.recordings.values import Recording
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock, FloatArray
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.microphone_models import COMPETITION, SessionVariation
from tactophone_lab.simulation.motion import Scene, five_stones, row
from tactophone_lab.simulation.render import touch_segments
from tactophone_lab.simulation.source import SimulatedFinger, SimulatedHand
from tactophone_lab.simulation.strokes import Script, Visit, explore
from tactophone_lab.simulation.takes import shuffled

STROKING = 3.0
"""Seconds on each stone."""

DEMONSTRATION_GAIN_DB = -9.0
"""Of the contact preamplifier: at 0 dB the finger that slips off the rough stone clips
for half a second."""

DEMONSTRATION_BLOCK = 4800
"""Samples rendered at once."""

_START = (-0.03, 0.035)
"""Where the finger starts in m, x and y: left of the first stone."""


def demonstration(
    seed: int = 0, *, tip: str = DEFAULT_TIP, place: int | None = None
) -> SimulatedFinger:
    """Return a finger with this tip and a script of about ten seconds, drawn from the
    seed.

    The stones are the competition's, which no shipped model was trained on. ``place``
    is the finger's place in a hand: each begins a moment after the one before.
    """
    stream = [seed] if place is None else [seed, place]
    scene = row([find("smooth competition stone"), find("rough competition stone")])
    script = Script(np.random.default_rng([0xDE30, *stream]), x=_START[0], y=_START[1])
    script.hover(0.6 + 0.15 * (place or 0))
    for placed, slips in zip(scene.placed, (False, True), strict=True):
        explore(script, placed, Visit(STROKING, force=1.8, speed=0.18, slips=slips))
    script.hover(0.5)
    session = SessionVariation.draw(
        seed, COMPETITION.amplified(DEMONSTRATION_GAIN_DB), tip=tip
    )
    return SimulatedFinger(
        scene,
        script.moves,
        session=session,
        seed=stream,
        duration=script.time,
        place=_START,
    )


def write_demonstration(
    folder: Path, names: Sequence[str] = ("",), *, seed: int, tip: str = DEFAULT_TIP
) -> list[Path]:
    """Write the demonstration of each finger of a hand, or of a single one, and its
    labels; return the recordings.

    All stroke the same stones, and each sounds faintly in the microphones of the others
    (`SimulatedHand`). Other lines of the folder's ``metadata.csv`` stay; raises
    `DatasetError` where it could not be written again.
    """
    read_to_rewrite(folder)
    fingers = [
        demonstration(seed, tip=tip, place=place if any(names) else None)
        for place in range(len(names))
    ]
    hand = SimulatedHand(fingers)
    size = max(finger.end or 0 for finger in fingers)
    blocks: list[FloatArray] = []
    touched: list[list[NDArray[np.int16]]] = []
    for start in range(0, size, DEMONSTRATION_BLOCK):
        blocks.append(hand.render(min(DEMONSTRATION_BLOCK, size - start)).samples)
        touched.append([finger.truth.object_index for finger in fingers])
    samples = np.concatenate(blocks)
    recordings = []
    for place, name in enumerate(names):
        path = folder / f"{'-'.join(filter(None, ('microphones', name)))}.wav"
        with atomic_write(path) as part:
            soundfile.write(
                part,
                samples[:, 2 * place : 2 * place + 2],
                hand.sample_rate,
                "PCM_24",
                format="WAV",
            )
        segments = touch_segments(
            np.concatenate([found[place] for found in touched]), fingers[place].scene
        )
        recordings.append(
            Recording(
                path,
                "competition stones",
                channels=("contact", "air"),
                segments=segments,
            )
        )
    add_to_metadata(folder, recordings)
    return [recording.path for recording in recordings]


AHEAD = 1.0
"""Seconds of movement that are queued in advance."""


LIFT_TIME = 0.3
"""Share of visits that a finger of a hand spends in the air, while the others
stroke."""


class _Stroking(AlwaysOpen):
    """Fingers that explore five stones without end, a visit at a time; a
    :class:`~tactophone.core.types.Source`."""

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(
        self,
        scene: Scene,
        hand: SimulatedHand,
        scripts: Sequence[Script],
        block_size: int,
    ) -> None:
        self._scene = scene
        self._hand = hand
        self._scripts = scripts
        self._block_size = block_size
        self.channels = hand.channels

    def __iter__(self) -> Iterator[AudioBlock]:
        while True:
            block = self._hand.render(self._block_size)
            yield block
            if self._scripts[0].time < block.end / LIVE_SAMPLE_RATE + AHEAD:
                self._queue_visit()

    def rehearse(self) -> None:
        """Compile the simulation, so that it need not be compiled while it runs; takes
        up to a minute once."""
        SimulatedHand([SimulatedFinger(self._scene)]).render(64)

    def truth_of(self, finger: int = 0) -> int:
        """Return the true touch of a finger at the end of the last block."""
        return self._hand.truth_of(finger)

    def _queue_visit(self) -> None:
        raise NotImplementedError

    def _move(self) -> None:
        for script, finger in zip(self._scripts, self._hand.fingers, strict=True):
            for move in script.moves:
                finger.move(move.x, move.y, move.force, move.time)
            # The finger has its own queue: kept here, the moves would grow by 100 MB an
            # hour.
            script.moves.clear()


class StrokingFinger(_Stroking):
    """The simulated finger, stroking one of five stones after another.

    The seed draws the order of the stones, the strokes and the noise; with a tip other
    than the default one, also its radius, mass and microphone.
    """

    def __init__(
        self, block_size: int, *, seed: int = 0, tip: str = DEFAULT_TIP
    ) -> None:
        self._rng = np.random.default_rng([0x57, seed])
        scene = five_stones(shuffled(seed))
        place = scene.placed[0].centre
        finger = SimulatedFinger(
            scene, session=SessionVariation.of_tip(tip, seed), seed=seed, place=place
        )
        super().__init__(
            scene,
            SimulatedHand([finger]),
            [Script(self._rng, x=place[0], y=place[1])],
            block_size,
        )

    def _queue_visit(self) -> None:
        stone = self._scene.placed[self._rng.integers(len(self._scene.placed))]
        force = self._rng.uniform(0.8, 2.5)
        speed = self._rng.uniform(0.04, 0.12)
        visit = Visit(
            self._rng.uniform(1.5, 3.0),
            force,
            speed,
            slips=bool(self._rng.random() < 0.2),
        )
        explore(self._scripts[0], stone, visit)
        self._move()


class StrokingHand(_Stroking):
    """Several fingers on the same stone, one after another, all drawn by ``seed``."""

    def __init__(
        self, fingers: int, block_size: int, *, seed: int = 0, tip: str = DEFAULT_TIP
    ) -> None:
        self._rng = np.random.default_rng([0x4A4D, seed])
        scene = five_stones(shuffled(seed))
        place = scene.placed[0].centre
        streams = [
            np.random.default_rng([0x4A4D, seed, number]) for number in range(fingers)
        ]
        scripts = [Script(rng, x=place[0], y=place[1]) for rng in streams]
        sessions = [
            SessionVariation.of_tip(tip, seed + 1000 * number)
            for number in range(fingers)
        ]
        hand = [
            SimulatedFinger(scene, session=session, seed=[seed, number], place=place)
            for number, session in enumerate(sessions)
        ]
        super().__init__(scene, SimulatedHand(hand), scripts, block_size)
        self._queue_visit()

    def _queue_visit(self) -> None:
        stone = self._scene.placed[self._rng.integers(len(self._scene.placed))]
        visit = Visit(
            self._rng.uniform(1.5, 3.0),
            self._rng.uniform(0.8, 2.5),
            self._rng.uniform(0.04, 0.12),
        )
        for script in self._scripts:
            if script.rng.random() < LIFT_TIME:
                script.hover(visit.duration)
            else:
                explore(script, stone, visit)
        end = max(script.time for script in self._scripts)
        for script in self._scripts:
            if end > script.time:
                script.hover(end - script.time)  # all begin the next visit together
        self._move()
