"""A simulated finger that explores five stones without end: a live source that needs no hardware."""

from collections.abc import Iterator

import numpy as np

from tactophone.simulation.content.movement import Script, Visit, explore
from tactophone.simulation.content.stone_order import shuffled
from tactophone.simulation.physics.scene import five_stones
from tactophone.simulation.physics.session_variation import SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger
from tactophone.types import DEFAULT_TIP, LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock, Touch

AHEAD = 1.0
"""Seconds of movement that are queued in advance."""


class StrokingFinger(AlwaysOpen):
    """The simulated finger, stroking one of five stones after another; a :class:`~tactophone.types.Source`.

    The seed is of the order of the stones, the strokes and the noise; with a tip other than the default one, its
    radius, mass and microphone are drawn by it too.
    """

    channels = 2
    sample_rate = LIVE_SAMPLE_RATE

    def __init__(self, block_size: int, *, seed: int = 0, tip: str = DEFAULT_TIP) -> None:
        self._rng = np.random.default_rng([0x57, seed])
        self._scene = five_stones(shuffled(seed))
        place = self._scene.placed[0].centre
        session = SessionVariation.of_tip(tip, seed)
        self._finger = SimulatedFinger(self._scene, session=session, seed=seed, block_size=block_size, place=place)
        self._script = Script(self._rng, x=place[0], y=place[1])

    def __iter__(self) -> Iterator[AudioBlock]:
        for block in self._finger:
            yield block
            if self._script.time < block.end / LIVE_SAMPLE_RATE + AHEAD:
                self._queue_visit()

    def rehearse(self) -> None:
        """Compile the simulation, so that it need not be compiled while it runs; takes up to a minute once."""
        SimulatedFinger(self._scene).render(64)

    def truth_of(self, finger: int = 0) -> int:
        """Return the true touch at the end of the last block."""
        touch = self._finger.truth.touch
        return int(touch[-1]) if len(touch) else int(Touch.NONE)

    def _queue_visit(self) -> None:
        stone = self._scene.placed[self._rng.integers(len(self._scene.placed))]
        force, speed = self._rng.uniform(0.8, 2.5), self._rng.uniform(0.04, 0.12)
        visit = Visit(self._rng.uniform(1.5, 3.0), force, speed, slips=bool(self._rng.random() < 0.2))
        explore(self._script, stone, visit)
        for move in self._script.moves:
            self._finger.move(move.x, move.y, move.force, move.time)
        # The finger has its own queue: kept here, the moves would grow by 100 MB an hour.
        self._script.moves.clear()
