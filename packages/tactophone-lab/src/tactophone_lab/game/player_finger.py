"""The stone box's finger: another process moves it and replaces the stones, while the
sound never stops."""

import dataclasses
import threading
from collections.abc import Iterator
from multiprocessing.connection import Connection

import msgspec

from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock, Touch
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.motion import LIFT, five_stones
from tactophone_lab.simulation.source import SimulatedFinger

GAME_BLOCK = 128
"""Default number of samples per block: messages are read every 2.7 ms."""

FINGER_WARM_UP = 480
"""Samples rendered before a finger is used; the very first ones also compile the
kernels, which takes seconds."""


class StoneBoxSource(AlwaysOpen):
    """A `tactophone.core.types.Source` whose finger follows messages.

    ``("lay", touches, seed)`` replaces the five stones under the curtain, which takes
    about half a second; ``("move", x, y, force)`` moves the finger (m, N; negative
    force lifts). The sender never waits for the finger, nor the finger for the sender.

    >>> from multiprocessing import Pipe
    >>> inbox, outbox = Pipe(duplex=False)
    >>> outbox.send(("move", 0.04, 0.03, 1.5))
    >>> block = next(iter(StoneBoxSource(inbox)))
    >>> block.size, block.start
    (128, 0)
    """

    sample_rate = LIVE_SAMPLE_RATE
    channels = 2

    def __init__(
        self, inbox: Connection, *, block_size: int = GAME_BLOCK, tip: str = DEFAULT_TIP
    ) -> None:
        self._inbox = inbox
        self._block_size = block_size
        self._tip = tip
        self._finger = _finger_over((Touch.SMOOTH,) * 3 + (Touch.ROUGH,) * 2, 0, tip)
        self._next: SimulatedFinger | None = None
        self._position = 0

    def __iter__(self) -> Iterator[AudioBlock]:
        while True:
            while self._inbox.poll():
                action, *arguments = self._inbox.recv()
                if action == "lay":
                    # This takes longer than a block, so a thread does it; the old
                    # stones stay until it is done.
                    threading.Thread(
                        target=self._lay, args=arguments, daemon=True
                    ).start()
                else:
                    self._finger.move(*arguments)
            if self._next is not None:
                self._finger = self._next
                self._next = None
            # Each finger counts its samples from 0; the stream goes on counting.
            block = msgspec.structs.replace(
                self._finger.render(self._block_size), start=self._position
            )
            yield block
            self._position += block.size

    def rehearse(self) -> None:
        """Compile the simulation, so that it need not be compiled while it runs; takes
        up to a minute once."""
        _finger_over((Touch.SMOOTH,) * 5, 0, self._tip).render(64)

    def truth_of(self, finger: int = 0) -> int:
        touch = self._finger.truth.touch
        return int(touch[-1]) if touch.size else int(Touch.NONE)

    def _lay(self, touches: tuple[int, ...], seed: int) -> None:
        self._next = _finger_over(tuple(map(Touch, touches)), seed, self._tip)


HOVER = 3e-4
"""Metres between the lifted finger and a stone. The simulated set-up's 3 mm take 80 ms
from press to touch, most of what a player waits for; with this it is 40 ms, and the
lifted finger stays clear of the stones."""


def _finger_over(order: tuple[Touch, ...], seed: int, tip: str) -> SimulatedFinger:
    scene = five_stones(order)
    x, y = scene.placed[2].centre
    session = SessionVariation.of_tip(tip, seed)
    session = dataclasses.replace(
        session, finger=session.finger._replace(arm_rest=HOVER)
    )
    finger = SimulatedFinger(scene, seed=seed, place=(x, y), session=session)
    finger.move(x, y, LIFT)
    finger.render(FINGER_WARM_UP)
    return finger
