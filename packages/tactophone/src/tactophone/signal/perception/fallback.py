"""Detection with microphones that may fail: each sensor fault has a safe fallback, used
as soon as it is found.

What still works is used as far as it can be trusted. Without a good air microphone, a
model that was trained to do without it hears silence in its place; any other tells
contact alone. With a contact microphone that clips, roughness is unknown but contact is
not. Where contact itself is in doubt, the output is silent. When the fault has healed,
all is as before.
"""

import copy
import enum
import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from msgspec.structs import replace

from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.types import AudioBlock, Prediction, Touch, joined
from tactophone.signal.perception.detector import (
    Heard,
    PhasedDetector,
    TouchDetector,
    begins_anew,
)
from tactophone.signal.perception.fit import Misfit
from tactophone.signal.perception.health import (
    FaultDetector,
    FaultKind,
    SensorFault,
)
from tactophone.signal.perception.model_file import SUPPORTS_MISSING_CHANNEL, ModelCard
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
        FallbackMode.FULL: "predictions do without it",
        FallbackMode.ONE_CHANNEL: "predictions use the contact microphone alone",
        FallbackMode.CONTACT_ONLY: "only contact is rendered",
        FallbackMode.SILENCE: "nothing is rendered",
    }
)
"""What each fallback does, for people."""

_UNKNOWN = (0.0, 0.5, 0.5)


def fallback_mode(
    faults: Iterable[SensorFault], card: ModelCard, *, channels: int = 2
) -> FallbackMode:
    """Return the safe fallback for the present faults: that of the worst, for a model
    and sound of so many channels.

    >>> from tactophone.signal.perception.model_file import read_model
    >>> from tactophone.signal.perception.models import model_path
    >>> card = read_model(model_path("texture")).card
    >>> fallback_mode([SensorFault(FaultKind.DEAD, AIR)], card).name
    'ONE_CHANNEL'
    """
    modes = (_fallback_for(fault, card, channels) for fault in faults)
    return max(modes, default=FallbackMode.FULL)


def _fallback_for(fault: SensorFault, card: ModelCard, channels: int) -> FallbackMode:
    # Contact is heard by the model's only microphone, or else by the contact one.
    hears_air_alone = card.channels_heard(channels) == slice(AIR, AIR + 1)
    decisive = AIR if hears_air_alone else CONTACT
    if card.channels == 1:
        # Such a model does without the other microphone, and without a copy of its own.
        if fault.kind is FaultKind.ALIKE or fault.channel == 1 - decisive:
            return FallbackMode.FULL
    elif fault.channel == AIR:
        # It was trained with silence in place of the air microphone, or it was not.
        if card.kind in SUPPORTS_MISSING_CHANNEL:
            return FallbackMode.ONE_CHANNEL
        return FallbackMode.CONTACT_ONLY
    if fault.kind is FaultKind.CLIPPED:
        return FallbackMode.CONTACT_ONLY
    return FallbackMode.SILENCE


_SILENT_KINDS = (FaultKind.DEAD, FaultKind.OPEN)
"""Faults by which no microphone can be told from none."""


class FallbackDetector(PhasedDetector):
    """A detector that never relies on a faulty microphone.

    ``fault_detector`` watches the sound, of so many ``channels``.

    One microphone on an interface of two inputs is sound of one channel, whichever
    input it is on. So where no sound came from the contact input since the run began,
    and the other one sounds, that one is the contact microphone. A contact microphone
    that has sounded and fell silent is broken, and then the air microphone never takes
    its place: it hears people talk.

    - ``main``, ``fault_detector``: the detector of the model, and what looks for
      faults.
    - ``mode``, ``sensor_faults``: the fallback in use, and the faults of the
      microphones now.
    """

    def __init__(
        self, main: TouchDetector, fault_detector: FaultDetector, *, channels: int = 2
    ) -> None:
        self.main = main
        self.fault_detector = fault_detector
        self.window_detector = main.window_detector
        self.gate = main.gate
        self._channels = channels
        self.name = main.name
        self.threshold = main.threshold
        self.latency = main.latency
        self.bandwidth = main.bandwidth
        self.faults = main.faults
        # Copies of the noise floor as it was at the newest measures without a fault of
        # the contact microphone, oldest first.
        self._floors: deque[NoiseFloor] = deque(maxlen=REMEMBERED_CELLS)
        card = self.window_detector.card
        # The grid of the checks: windows end on it too.
        self._hop = max(
            1, round(card.hop * fault_detector.sample_rate / card.sample_rate)
        )
        self._turn = 0
        self._next = 0
        self._begin_checks()
        # Channels that have ever sounded, so that a microphone must be there; and the
        # only channel that is heard, where it is one.
        self._sounded: frozenset[int] = frozenset()
        self._only: int | None = None
        self._choose()

    def take_turn(self, turn: int) -> None:
        """Check so many hops after the first of several fingers, each at its own turn,
        as all checks at once would hold up the sound."""
        self._turn = turn
        self.reset()

    @property
    def floor(self) -> NoiseFloor | None:
        """The noise floor that is followed; none where the threshold was given."""
        return self.main.floor

    def _choose(self) -> None:
        """Choose the fallback for the faults that are present now."""
        card = self.window_detector.card
        faults = self.fault_detector.faults
        if self._has_one_microphone_on_the_second_input(faults):
            # Its faults are those of a contact microphone.
            own = [
                SensorFault(fault.kind, CONTACT)
                for fault in faults
                if fault.channel == AIR
            ]
            mode = fallback_mode(own, card, channels=1)
            self._hear_only(AIR)
            self.mode = max(FallbackMode.ONE_CHANNEL, mode)
        else:
            self.mode = fallback_mode(faults, card, channels=self._channels)
            alone = self.mode is FallbackMode.ONE_CHANNEL
            self._hear_only(CONTACT if alone else None)
        # Two equal channels are no fault where the model hears one of them.
        self.sensor_faults = tuple(
            fault
            for fault in faults
            if not (card.channels == 1 and fault.kind is FaultKind.ALIKE)
        )

    def _has_one_microphone_on_the_second_input(
        self, faults: Iterable[SensorFault]
    ) -> bool:
        if self.fault_detector.calibrated or self._shares_levels:
            return False
        silent = {fault.channel for fault in faults if fault.kind in _SILENT_KINDS}
        return CONTACT in silent and self._sounded == {AIR}

    @property
    def _shares_levels(self) -> bool:
        # The fingers of a hand have their levels measured together, from the contact
        # inputs.
        return self.gate is not None and self.gate.is_shared

    def _hear_only(self, channel: int | None) -> None:
        """Hear one channel from now on, or both where it is none."""
        if channel != self._only and AIR in (channel, self._only):
            # Another microphone decides on contact: nothing that is known of the noise
            # and of the touch holds for it.
            self.main.reset()
            self._floors.clear()
        self._only = channel

    @property
    def consequence(self) -> str:
        """What the present fallback does, for people."""
        message = FALLBACK_MESSAGES[self.mode]
        if self._only == AIR:
            return f"{message}, which is on input 2"
        card = self.window_detector.card
        air_alone = all(fault.channel == AIR for fault in self.sensor_faults)
        if self.mode is FallbackMode.CONTACT_ONLY and air_alone:
            return f"{message}, as the model {card.name} needs both microphones"
        return message

    @property
    def misfit(self) -> Misfit | None:
        """What about the sound does not fit the model now; unlike a fault, it changes
        nothing."""
        return self.main.misfit

    def _begin_checks(self) -> None:
        """Lay the grid of checks where the windows begin."""
        # Samples of the stream that are not looked at, until it is this finger's turn.
        self._passed_over = self._turn * self._hop
        # Samples until the cell is full. Lost sound that was concealed fills none.
        self._cell_left = self._passed_over + self.fault_detector.cell_size
        # Samples until the next place of the grid.
        self._hop_left = (self.window_detector.missing - 1) % self._hop + 1
        # Where the blocks that were cut end at a check, and the sound since the last.
        self._checks: deque[int] = deque()
        self._unchecked: list[AudioBlock] = []

    @property
    def _until_check(self) -> int:
        """Samples until the next check: at the first place of the grid where the cell
        is full. A window ends there, so that the check comes with work that cannot wait
        either, and breaks no wait of a packet that has none."""
        beyond = max(0, self._cell_left - self._hop_left)
        return self._hop_left + math.ceil(beyond / self._hop) * self._hop

    def parts(self, block: AudioBlock) -> Sequence[AudioBlock]:
        """Cut a block where the microphones are checked, so that the mode changes at
        the same sample at any block size."""
        if begins_anew(block.start - self._next, block.sample_rate):
            self.restart()
        self._next = block.end
        if block.concealed:
            self._hop_left = (self._hop_left - block.size - 1) % self._hop + 1
            return (block,)
        parts = []
        start = 0
        while block.size - start >= self._until_check:
            size = self._until_check
            parts.append(block.part(start, start + size))
            start += size
            self._checks.append(parts[-1].end)
            self._cell_left += self.fault_detector.cell_size - size
            self._hop_left = self._hop
        if rest := block.size - start:
            parts.append(block.part(start, block.size) if start else block)
            self._cell_left -= rest
            self._hop_left = (self._hop_left - rest - 1) % self._hop + 1
        return parts

    def take(self, part: AudioBlock) -> Heard:
        if self._only is None:
            return self.main.take(part)
        # From here on it is sound of one channel, which the model knows with silence
        # for the other. Once the fault has healed it gets both again.
        heard = self.main.take(part.select([self._only]))
        return heard._replace(block=part)

    def complete(self, heard: Heard, answers: list[Prediction]) -> list[Prediction]:
        predictions = self.main.complete(heard, answers)
        if self.mode is not FallbackMode.FULL:
            predictions = list(map(self._revised, predictions))
        # The microphones are looked at last, so that what is found holds from the next
        # part on. Concealment of lost sound says nothing about them.
        if not heard.block.concealed:
            self._unchecked.append(heard.block)
            if self._checks and heard.block.end == self._checks[0]:
                self._checks.popleft()
                self._check()
        return predictions

    def _check(self) -> None:
        """Look for faults in the sound since the last check."""
        for block in joined(self._unchecked):
            passed_over = min(self._passed_over, block.size)
            self._passed_over -= passed_over
            self.fault_detector.push(block.part(passed_over, block.size))
        self._unchecked = []
        self._sounded |= self.fault_detector.sounding
        self._choose()
        self._keep_floor()

    def _keep_floor(self) -> None:
        """While the contact microphone is faulty, let the noise floor stay what it was
        before the fault was found."""
        floor = self.main.floor
        if floor is None:
            return
        if self.mode <= FallbackMode.ONE_CHANNEL:
            self._floors.append(copy.copy(floor))
        elif self._floors:
            floor.adopt(self._floors[0])

    @property
    def due(self) -> int:
        """As of `TouchDetector`, and only while no microphone is faulty may sound
        wait."""
        if self.mode is not FallbackMode.FULL:
            return self._next
        return min(self.main.due, self._next + self._until_check)

    def flush(self) -> list[Prediction]:
        return [self._revised(prediction) for prediction in self.main.flush()]

    def reset(self) -> None:
        """Return to the initial state; fault counts stay."""
        self.restart()
        self.fault_detector.reset()
        self._floors.clear()
        self._sounded = frozenset()
        self._choose()

    def restart(self) -> None:
        """Begin another stream of the same microphones.

        What was found of them stays known. Else a broken one would be relied on for the
        second that it takes to find the fault again.
        """
        self.fault_detector.restart()
        self.main.reset()
        self._next = 0
        self._begin_checks()

    def _revised(self, prediction: Prediction) -> Prediction:
        if self.mode is FallbackMode.SILENCE:
            return replace(
                prediction,
                touch=Touch.NONE,
                roughness=0.0,
                faulty=True,
                unknown=False,
            )
        if self.mode is FallbackMode.CONTACT_ONLY:
            touch = Touch.NONE if prediction.touch is Touch.NONE else Touch.SMOOTH
            return replace(
                prediction,
                touch=touch,
                roughness=0.0,
                probabilities=_UNKNOWN,
                unknown=touch is Touch.SMOOTH,
            )
        return prediction
