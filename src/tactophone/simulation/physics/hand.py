"""A simulated hand: fingers with contacts of their own, and what of each contact reaches its neighbours.

No published figure for a robot's hand was found, so the levels here are reasoned; docs/guide/hand.md has
false touches over a range of them.

*Through the structure.* A finger's force shakes the palm through its last joint, and the palm shakes the next finger's.
Both joints are suspensions of 48 Hz, above which each transmits 12 dB less an octave, and the palm has some six times
the mass of a link: -16 dB. At 100 Hz that is -16 - 13 = -29 dB and less above. Here: -26 dB, low-passed at 100 Hz, and
6 dB less for each finger further on.

*Through the air.* Pressure falls with the distance: a neighbour's contact is 20 mm down and 25 mm aside of an air
microphone, its own 20 mm down. That is -4 dB for the next finger, -9 dB for the one after it.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactophone.simulation.physics.source import SimulatedFinger, Truth
from tactophone.types import LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock

STRUCTURE_DB = -26.0
"""Level of a neighbour's force at a finger's piezo, relative to the neighbour's own."""

FURTHER_DB = -6.0
"""Additional level for each finger further on."""

CORNER = 100.0
"""Hz above which the structure transmits less."""

PITCH = 0.025
"""Metres from fingertip to fingertip."""


class SimulatedHand(AlwaysOpen):
    """Several simulated fingers in one structure and one air; a `tactophone.types.Source` of two channels for each.

    Parameters
    ----------
    fingers
        From thumb to little finger; each has its own moves, and all have the air microphone at the same distance.
    structure_db
        Level of what reaches the next finger through the hand; -inf is none.
    """

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(
        self, fingers: Sequence[SimulatedFinger], *, structure_db: float = STRUCTURE_DB, air_distance: float = 0.02
    ) -> None:
        self.fingers = list(fingers)
        apart = np.abs(np.subtract.outer(np.arange(len(fingers)), np.arange(len(fingers))))
        self._structure = np.where(apart > 0, 10 ** ((structure_db + FURTHER_DB * (apart - 1)) / 20), 0.0)
        self._air = np.where(apart > 0, air_distance / np.hypot(air_distance, PITCH * apart), 0.0)
        if math.isinf(structure_db):
            self._structure, self._air = np.zeros_like(self._structure), np.zeros_like(self._air)
        self._sections = signal.butter(2, CORNER, fs=LIVE_SAMPLE_RATE, output="sos")
        self._state = np.zeros((len(self._sections), len(fingers), 2))

    @property
    def channels(self) -> int:
        """Contact and air of each finger in turn."""
        return 2 * len(self.fingers)

    @property
    def truths(self) -> list[Truth]:
        """Ground truth of the last block, for each finger."""
        return [finger.truth for finger in self.fingers]

    def __iter__(self) -> Iterator[AudioBlock]:
        while True:
            yield self.render(480)

    def render(self, size: int) -> AudioBlock:
        """Return the next ``size`` samples of all fingers."""
        contacts = [finger.touch(size) for finger in self.fingers]
        strains = self._transmitted(np.stack([each.signals.strain for each in contacts]))
        pressures = self._air @ np.stack([each.signals.finger + each.signals.body for each in contacts])
        blocks = []
        for finger, own, strain, pressure in zip(self.fingers, contacts, strains, pressures, strict=True):
            signals = own.signals._replace(strain=own.signals.strain + strain, finger=own.signals.finger + pressure)
            blocks.append(finger.record(own._replace(signals=signals)))
        samples = np.concatenate([block.samples for block in blocks], axis=1)
        return AudioBlock(samples, LIVE_SAMPLE_RATE, blocks[0].start)

    def truth_of(self, finger: int) -> int:
        """Return the `Touch` of a finger at the end of the last block."""
        touch = self.fingers[finger].truth.touch
        return int(touch[-1]) if len(touch) else 0

    def _transmitted(self, strains: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return what each finger's piezo gets from the others, shape ``(fingers, samples)``."""
        low, self._state = signal.sosfilt(self._sections, self._structure @ strains, axis=1, zi=self._state)
        return np.asarray(low)
