"""The stone box's finger: stones laid and moves made from another process, while the sound never stops."""

import dataclasses
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection
from typing import Any

from tactophone.simulation.physics.motion import LIFT
from tactophone.simulation.physics.scene import five_stones
from tactophone.simulation.physics.source import RATE, SimulatedFinger
from tactophone.types import AlwaysOpen, AudioBlock, Touch

BLOCK_SIZE = 128
"""Samples a block, unless told otherwise: moves are taken every 2.7 ms."""


SETTLE = 480
"""Samples rendered before a finger is used; the first ever also compile the kernels, which takes seconds."""


class StoneBox(AlwaysOpen):
    """A `tactophone.types.Source` whose finger is led by messages.

    ``("lay", touches, seed)`` lays five other stones under the curtain, which takes about half a second;
    ``("move", x, y, force)`` leads the finger (m, N; negative force lifts).

    Parameters
    ----------
    inbox
        Where the messages come from; whoever writes there never waits for the finger, nor it for them.

    Examples
    --------
    >>> from multiprocessing import Pipe
    >>> inbox, hand = Pipe(duplex=False)
    >>> hand.send(("move", 0.04, 0.03, 1.5))
    >>> block = next(iter(StoneBox(inbox)))
    >>> block.size, block.start
    (128, 0)
    """

    sample_rate = RATE
    channels = 2

    def __init__(self, inbox: Connection, *, block_size: int = BLOCK_SIZE) -> None:
        self._inbox, self._block_size = inbox, block_size
        self._finger = _over((Touch.SMOOTH,) * 3 + (Touch.ROUGH,) * 2, 0)
        self._laid: SimulatedFinger | None = None
        self._position = 0

    def __iter__(self) -> Iterator[AudioBlock]:
        while True:
            while self._inbox.poll():
                self._obey(*self._inbox.recv())
            if self._laid is not None:
                self._finger, self._laid = self._laid, None
            block = self._finger.render(self._block_size)
            yield dataclasses.replace(block, start=self._position)
            self._position += block.size

    def truth_now(self) -> int:
        """What the finger truly touched at the end of the last block."""
        touch = self._finger.truth.touch
        return int(touch[-1]) if touch.size else int(Touch.NONE)

    def _obey(self, word: str, *arguments: Any) -> None:
        if word == "lay":
            # Laying takes longer than a block, so a thread does it; the stones before it serve meanwhile.
            threading.Thread(target=self._lay, args=arguments, daemon=True).start()
        else:
            self._finger.move(*arguments)

    def _lay(self, touches: tuple[int, ...], seed: int) -> None:
        finger = _over(tuple(map(Touch, touches)), seed)
        self._laid = finger


def _over(order: tuple[Touch, ...], seed: int) -> SimulatedFinger:
    scene = five_stones(order)
    middle, depth = scene.placed[2].centre
    finger = SimulatedFinger(scene, seed=seed, place=(middle, depth))
    finger.move(middle, depth, LIFT)
    finger.render(SETTLE)
    return finger
