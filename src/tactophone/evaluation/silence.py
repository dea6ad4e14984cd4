"""How long a vibration outlives its cause: the link, the robot, the operator's process or the sound server ends.

A client of the JACK graph plays an endless stroke into the robot's ports and listens at the operator's. Something is
ended, and the time is taken until the vibration has sunk to -60 dB of full drive.
"""

import math
import time
from collections.abc import Callable

import numpy as np

from tactophone.config import Settings
from tactophone.devices import JackClient
from tactophone.errors import TactophoneError
from tactophone.evaluation.latency import PEAK, RATE, TONE, Graph, Sides, running_sides, wires
from tactophone.types import FloatArray

SILENT = 1e-3
"""Amplitude that counts as silent: -60 dB of full drive."""

STROKE = 1.0
"""Seconds of vibration before the end."""

AFTERMATH = 0.6
"""Seconds listened after the end."""

_LONGEST = 60.0


class Listener:
    """Strokes without end, and notes the peak of each period; ``process`` is for a JACK client."""

    def __init__(self) -> None:
        self._phase = 0
        self._rows = np.zeros((int(_LONGEST * RATE / 16), 2))
        self._count = 0

    def process(self, inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        """Be the JACK callback."""
        size = len(inputs[0])
        tone = PEAK * np.sin(2 * np.pi * TONE / RATE * np.arange(self._phase, self._phase + size))
        self._phase = (self._phase + size) % RATE  # a whole number of the tone's periods
        for output in outputs:
            output[:] = tone
        if self._count < len(self._rows):
            self._rows[self._count] = time.monotonic(), np.abs(inputs[0]).max()
            self._count += 1

    @property
    def peak(self) -> float:
        """Of the newest period."""
        return float(self._rows[self._count - 1, 1]) if self._count else 0.0

    def outlived(self, moment: float) -> float:
        """Seconds from a moment to the end of the last period that was not silent; infinite if it never ended."""
        rows = self._rows[: self._count]
        loud = rows[(rows[:, 0] > moment) & (rows[:, 1] > SILENT), 0]
        if not len(loud):
            return 0.0
        return math.inf if loud[-1] == rows[-1, 0] else float(loud[-1] - moment)


def outlive(settings: Settings, graph: Graph, end: Callable[[Sides], None]) -> float:
    """Let a stroke be felt, end something, and give the seconds until silence.

    Parameters
    ----------
    end
        Ends something of the two sides.

    Raises
    ------
    TactophoneError
        When nothing is felt to begin with.
    """
    listener = Listener()
    with running_sides(settings, graph) as sides:
        client = JackClient("tactophone-listener", listener.process, server=graph.server, **wires(graph, sides))
        client.open()
        try:
            _await_vibration(listener)
            time.sleep(STROKE)
            moment = time.monotonic()
            end(sides)
            time.sleep(AFTERMATH)
            return listener.outlived(moment)
        finally:
            client.close()


def _await_vibration(listener: Listener) -> None:
    for _ in range(500):
        if listener.peak > SILENT:
            return
        time.sleep(0.01)
    raise TactophoneError("nothing was felt within 5 s: try `tactophone latency --dummy` to see what fails")
