"""A simulated hand that explores five stones without end: each finger by strokes, and lifted now and then."""

from collections.abc import Iterator

import numpy as np

from tactophone.simulation.content.movement import Script, Visit, explore
from tactophone.simulation.content.stone_order import shuffled
from tactophone.simulation.physics.hand import STRUCTURE_DB, SimulatedHand
from tactophone.simulation.physics.scene import Scene, five_stones
from tactophone.simulation.physics.session_variation import SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger
from tactophone.types import DEFAULT_TIP, LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock

AHEAD = 1.0
"""Seconds of movement that are queued in advance."""

LIFTED = 0.3
"""Share of visits that a finger spends in the air, while the others stroke."""


class StrokingHand(AlwaysOpen):
    """Several fingers on the same stone, one after another, all drawn by ``seed``; a `tactophone.types.Source`."""

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(
        self,
        fingers: int,
        block_size: int,
        *,
        seed: int = 0,
        tip: str = DEFAULT_TIP,
        structure_db: float = STRUCTURE_DB,
    ) -> None:
        self._rng = np.random.default_rng([0x4A4D, seed])
        self._scene = five_stones(shuffled(seed))
        place = self._scene.placed[0].centre
        self._scripts = [
            Script(np.random.default_rng([0x4A4D, seed, finger]), x=place[0], y=place[1]) for finger in range(fingers)
        ]
        self._hand = SimulatedHand(
            [_finger(self._scene, place, seed=seed, number=number, tip=tip) for number in range(fingers)],
            structure_db=structure_db,
        )
        self._block_size = block_size
        self._position = 0

    @property
    def channels(self) -> int:
        """Contact and air of each finger in turn."""
        return self._hand.channels

    def __iter__(self) -> Iterator[AudioBlock]:
        while True:
            if self._scripts[0].time < self._position / LIVE_SAMPLE_RATE + AHEAD:
                self._queue_visit()
            block = self._hand.render(self._block_size)
            self._position = block.end
            yield block

    def rehearse(self) -> None:
        """Compile the simulation, so that it need not be compiled while it runs; takes up to a minute once."""
        SimulatedHand([SimulatedFinger(self._scene)]).render(64)

    def truth_of(self, finger: int = 0) -> int:
        """Return the true touch of a finger at the end of the last block."""
        return self._hand.truth_of(finger)

    def _queue_visit(self) -> None:
        stone = self._scene.placed[self._rng.integers(len(self._scene.placed))]
        visit = Visit(self._rng.uniform(1.5, 3.0), self._rng.uniform(0.8, 2.5), self._rng.uniform(0.04, 0.12))
        for script in self._scripts:
            if script.rng.random() < LIFTED:
                script.hover(visit.duration)
            else:
                explore(script, stone, visit)
        end = max(script.time for script in self._scripts)
        for script, finger in zip(self._scripts, self._hand.fingers, strict=True):
            if end > script.time:
                script.hover(end - script.time)  # all begin the next visit together
            for move in script.moves:
                finger.move(move.x, move.y, move.force, move.time)
            script.moves.clear()


def _finger(scene: Scene, place: tuple[float, float], *, seed: int, number: int, tip: str) -> SimulatedFinger:
    session = SessionVariation.of_tip(tip, seed + 1000 * number)
    return SimulatedFinger(scene, session=session, seed=[seed, number], place=place)
