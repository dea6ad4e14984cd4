"""How long a vibration outlives its cause: the link, the robot, the operator's process or the sound server ends.

The robot strokes without end, and a JACK client listens at the operator's port. Something is ended, and the time is
taken until the vibration has sunk to -60 dB.
"""

import itertools
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from tactophone.config import Settings
from tactophone.devices import JackClient
from tactophone.errors import TactophoneError
from tactophone.measurement.impulse_latency import PEAK, RATE, TONE
from tactophone.measurement.latency import Graph, Sides, felt_port, running_sides
from tactophone.types import AlwaysOpen, AudioBlock, FloatArray

BLOCK = 128
"""Samples a block of the stroke."""

SILENT = 1e-3
"""Amplitude that counts as silent: -60 dB of full drive."""

STROKE = 1.0
"""Seconds of vibration before the end."""

AFTERMATH = 0.6
"""Seconds listened after the end."""

_LONGEST = 60.0


class EndlessStroke(AlwaysOpen):
    """A source that strokes without end."""

    sample_rate, channels = RATE, 2

    def __init__(self, _: Settings) -> None:
        self._second = (PEAK * np.sin(2 * np.pi * TONE / RATE * np.arange(RATE + BLOCK))).astype(np.float32)

    def __iter__(self) -> Iterator[AudioBlock]:
        for start in itertools.count(0, BLOCK):
            phase = start % RATE  # a second is a whole number of the tone's periods
            tone = self._second[phase : phase + BLOCK]
            yield AudioBlock(np.stack([tone, tone], axis=1), RATE, start)


class Listener:
    """Notes when each period came and how strong it was; ``process`` is for a JACK client."""

    def __init__(self) -> None:
        self._rows = np.zeros((int(_LONGEST * RATE / 16), 2))
        self._count = 0

    def process(self, inputs: list[FloatArray], _: list[FloatArray]) -> None:
        """Be the JACK callback."""
        if self._count < len(self._rows):
            self._rows[self._count] = time.monotonic(), np.abs(inputs[0]).max()
            self._count += 1

    @property
    def peak(self) -> float:
        """Of the newest period."""
        return float(self._rows[self._count - 1, 1]) if self._count else 0.0

    def outlived(self, moment: float) -> float:
        """Seconds from a moment to the first period from which on all are silent; infinite if there is none.

        Where a sound server stands still for a while, its output is unknown and counts as vibrating.
        """
        rows = self._rows[: self._count]
        loud = np.flatnonzero(rows[:, 1] > SILENT)
        if not len(loud) or loud[-1] == len(rows) - 1:
            return math.inf
        return float(rows[loud[-1] + 1, 0] - moment)


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
    with running_sides(settings, graph, open_source=EndlessStroke) as sides, listening(listener, graph, sides):
        time.sleep(STROKE)
        _await_vibration(listener)  # again: a busy machine may have let it fade for a moment
        moment = time.monotonic()
        end(sides)
        time.sleep(AFTERMATH)
        return listener.outlived(moment)


@contextmanager
def listening(listener: Listener, graph: Graph, sides: Sides) -> Iterator[JackClient]:
    """Listen, from when the stroke is felt; gives the listening client."""
    wires = {"felt": felt_port(graph, sides)}
    client = JackClient("tactophone-listener", listener.process, inputs=wires, outputs={}, server=graph.server)
    client.open()
    try:
        _await_vibration(listener)
        yield client
    finally:
        client.close()


def _await_vibration(listener: Listener) -> None:
    for _ in range(500):
        if listener.peak > SILENT:
            return
        time.sleep(0.01)
    raise TactophoneError("nothing was felt within 5 s: try `tactophone latency --dummy` to see what fails")
