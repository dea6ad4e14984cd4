"""Detection with microphones that may fail: each sensor fault has a safe fallback, used
as soon as it is found.

What still works is used as far as it can be trusted. Without a good air microphone the
one-channel model predicts; with a contact microphone that clips, roughness is unknown
but contact is not; where contact itself is in doubt, the output is silent. When the
fault has healed, all is as before.
"""

import copy
import enum
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType

from msgspec.structs import replace

from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.types import AudioBlock, ContactRule, Prediction, Touch
from tactophone.signal.perception.contact import ContactGate
from tactophone.signal.perception.detector import (
    Processing,
    TouchDetector,
    process_together,
)
from tactophone.signal.perception.fit import Misfit
from tactophone.signal.perception.health import (
    FaultDetector,
    FaultKind,
    Reference,
    SensorFault,
)
from tactophone.signal.perception.models import fallback_model, open_detector
from tactophone.signal.perception.noise_floor import NoiseFloor

REMEMBERED_CELLS = 12
"""Measures, 1.5 s, for which noise floors are kept: a fault is found within a second of
its beginning."""


class FallbackMode(enum.IntEnum):
    """How much of the sound is still used, from all to nothing."""

    FULL = 0
    ONE_CHANNEL = 1
    CONTACT_ONLY = 2
    SILENCE = 3


FALLBACK_MESSAGES: Mapping[FallbackMode, str] = MappingProxyType(
    {
        FallbackMode.FULL: "",
        FallbackMode.ONE_CHANNEL: "predictions use the contact microphone alone",
        FallbackMode.CONTACT_ONLY: "only contact is rendered",
        FallbackMode.SILENCE: "nothing is rendered",
    }
)
"""What each fallback does, for people."""

_ON_CONTACT: Mapping[FaultKind, FallbackMode] = MappingProxyType(
    {FaultKind.CLIPPED: FallbackMode.CONTACT_ONLY}
)
_UNKNOWN = (0.0, 0.5, 0.5)


def fallback_mode(faults: Iterable[SensorFault], *, spare: bool) -> FallbackMode:
    """Return the safe fallback for the present faults: that of the worst, given whether
    there is a ``spare`` model.

    >>> fallback_mode([SensorFault(FaultKind.DEAD, AIR), SensorFault(FaultKind.CLIPPED, 0)], spare=True).name
    'CONTACT_ONLY'
    """
    alone = FallbackMode.ONE_CHANNEL if spare else FallbackMode.CONTACT_ONLY
    modes = [
        alone
        if fault.channel == AIR
        else _ON_CONTACT.get(fault.kind, FallbackMode.SILENCE)
        for fault in faults
    ]
    return max(modes, default=FallbackMode.FULL)


def with_fallback(
    detector: TouchDetector,
    *,
    sample_rate: int,
    channels: int,
    model: str = "paper",
    reference: Reference | None = None,
    contact: ContactRule = "bands",
) -> "FallbackDetector":
    """Add fallbacks to a detector of a model; with two microphones, one for the contact
    microphone alone stands by.

    Without the reference of the set-up's calibration, faults are found less sharply.
    """
    name = fallback_model(model) if channels > 1 else None
    follows = detector.threshold.follows_floor
    spare = (
        open_detector(
            name, sample_rate=sample_rate, contact=contact, follow_floor=follows
        )
        if name
        else None
    )
    return FallbackDetector(detector, spare, FaultDetector(sample_rate, reference))


class FallbackDetector:
    """A detector that never relies on a faulty microphone.

    ``main`` is for microphones without faults; ``spare`` uses the contact microphone
    alone, for when the air microphone is faulty; ``None`` if there is none, or only one
    microphone.

    - ``active``: which of the two is in use: name, latency, bandwidth and faults are its own.
    - ``mode``, ``sensor_faults``: the fallback in use, and the faults of the microphones now.
    """

    def __init__(
        self,
        main: TouchDetector,
        spare: TouchDetector | None,
        fault_detector: FaultDetector,
    ) -> None:
        self._main, self._spare, self._fault_detector = main, spare, fault_detector
        self.threshold = main.threshold
        self._spare_in_use = False
        self._floors: deque[NoiseFloor] = deque(maxlen=REMEMBERED_CELLS)
        self._left = (
            fault_detector.cell_size
        )  # samples until the fault detector measures again
        self._next = 0
        self._choose()

    def _choose(self) -> None:
        """Choose the fallback for the faults that are present now, and the detector
        that it uses."""
        # A model of one channel does without the second, which with a microphone on
        # both inputs is the first again.
        single = self._main.detector.card.channels == 1
        faults = self._fault_detector.faults
        self.sensor_faults = tuple(
            each for each in faults if not (single and each.kind is FaultKind.ALIKE)
        )
        self.mode = fallback_mode(self.sensor_faults, spare=self._spare is not None)
        spare = self._spare if self.mode is FallbackMode.ONE_CHANNEL else None
        active = self.active = spare or self._main
        self.name, self.latency = active.name, active.latency
        self.bandwidth, self.faults = active.bandwidth, active.faults

    @property
    def misfit(self) -> Misfit | None:
        """What about the sound does not fit the model now; unlike a fault, it changes
        nothing."""
        return self._main.misfit

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound; return the predictions that it completes, oldest first."""
        return process_together([self.process(block)])[0]

    def process(self, block: AudioBlock) -> Processing:
        """Do as :meth:`push`, one of several detectors
        (`tactophone.signal.perception.detector`)."""
        if block.start != self._next:
            self._fault_detector.reset()
            self._left = self._fault_detector.cell_size
            self._choose()
        self._next = block.end
        if block.concealed or block.size < self._left:
            self._left -= 0 if block.concealed else block.size
            return (yield from self._process(block))
        predictions = []
        for part in self._parts(block):
            predictions += yield from self._process(part)
        return predictions

    @property
    def due(self) -> int:
        """As of `TouchDetector`; only while no microphone is faulty may sound wait."""
        return (
            min(self._main.due, self._next + self._left)
            if self.active is self._main
            else self._next
        )

    @property
    def gate(self) -> ContactGate | None:
        return self._main.gate

    def flush(self) -> list[Prediction]:
        return [self._revised(prediction) for prediction in self.active.flush()]

    def reset(self) -> None:
        """Return to the initial state; fault counts stay."""
        self._fault_detector.reset()
        self._floors.clear()
        self._spare_in_use = False
        self._left, self._next = self._fault_detector.cell_size, 0
        self._choose()
        for detector in filter(None, (self._main, self._spare)):
            detector.reset()

    def _parts(self, block: AudioBlock) -> Iterator[AudioBlock]:
        """Cut a block where the fault detector measures, so that the mode changes at
        the same sample at any size."""
        start = 0
        while start < block.size:
            size = min(self._left, block.size - start)
            yield block.part(start, start + size)
            start += size
            self._left = self._left - size or self._fault_detector.cell_size

    def _process(self, part: AudioBlock) -> Processing:
        active = self.active
        if active is not self._main:
            if not self._spare_in_use and active.floor and self._main.floor:
                # The spare has not run until now, so it knows nothing of the noise yet.
                active.floor.adopt(self._main.floor)
            if not self.threshold.follows_floor:
                active.threshold.dbfs = self.threshold.dbfs
        self._spare_in_use = active is not self._main
        # The main detector gets all sound, so that once the fault has healed it goes on
        # as if there had been none.
        predictions = yield from self._main.process(part)
        if active is not self._main:
            predictions = yield from active.process(part.select([CONTACT]))
        revised = (
            [self._revised(prediction) for prediction in predictions]
            if self.mode
            else predictions
        )
        # Concealment of lost sound says nothing about the microphones.
        if not part.concealed and self._fault_detector.push(part):
            self._choose()
            # While the contact microphone is faulty, the noise floor stays what it was
            # before the fault was found.
            if floor := self.active.floor:
                if self.mode <= FallbackMode.ONE_CHANNEL:
                    self._floors.append(copy.copy(floor))
                elif self._floors:
                    floor.adopt(self._floors[0])
        return revised

    def _revised(self, prediction: Prediction) -> Prediction:
        if self.mode is FallbackMode.SILENCE:
            return replace(prediction, touch=Touch.NONE, roughness=0.0, faulty=True)
        if self.mode is FallbackMode.CONTACT_ONLY:
            touch = Touch.NONE if prediction.touch is Touch.NONE else Touch.SMOOTH
            return replace(
                prediction, touch=touch, roughness=0.0, probabilities=_UNKNOWN
            )
        return prediction
