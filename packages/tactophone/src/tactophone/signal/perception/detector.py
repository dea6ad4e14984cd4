"""Sound to touch: the way of a block.

::

    block ─┬─▶ contact gate: level, bands ─▶ changes of contact ────────┐
           └─▶ windows ─▶ model: probabilities ─▶ decision ─▶ answers ──┴─▶ touch

`push_together` is that way, for one finger or several. The first phase, `take`, decides
on contact (`contact`) and cuts windows (`window_detector`). Between the phases the
model classifies the windows of all fingers in one call. The second phase, `complete`,
puts windows and changes of contact in the order in which they became known, gathers
what the windows say as evidence (`evidence`), and lets the states of a touch
(`touch_state`) decide what is felt. Predictions come at every window, and whenever
contact begins or ends. They are bit-equal at any block size.

`TouchDetector` is one finger's detector. `fallback.FallbackDetector` stands in front of
it where the microphones are checked: it cuts a block at the checks, and replaces what
must not be felt.
"""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from msgspec.structs import replace

from tactophone.core.microphones import AIR
from tactophone.core.types import (
    AudioBlock,
    Detector,
    Prediction,
    Touch,
)
from tactophone.signal.perception.contact import Contact, ContactGate
from tactophone.signal.perception.evidence import TouchEvidence
from tactophone.signal.perception.fit import Misfit
from tactophone.signal.perception.no_touch import NO_TOUCH_TEXT
from tactophone.signal.perception.noise_floor import NoiseFloor, RecordingFloor
from tactophone.signal.perception.resample import Window
from tactophone.signal.perception.touch_state import (
    ANSWERS,
    Moment,
    TouchState,
    next_state,
)
from tactophone.signal.perception.window_detector import (
    WindowDetector,
    classify_windows,
)
from tactophone.signal.silences import FADED_PAUSE, PAUSE

MAX_INTERVAL = 0.02
"""Longest time, in s, without a prediction: where windows come more rarely, the newest
one is repeated."""

WINDOW_MARGIN_DB = 6.0
"""How far under the threshold the level of a window full of contact may lie for its
prediction still to be used: a window covers eight times the sound that the gate does,
so that single impacts, loud enough for the gate, count less."""

FULL_OF_CONTACT = 0.5
"""Share of a window from which it is evidence though its level lies under the gate's
threshold, by up to `WINDOW_MARGIN_DB`. Before that it must be as loud as contact: else
the noise in it would be classified. Windows shorter than `LONG_WINDOW` have no such
margin, so this concerns the paper's alone."""

FADING = 0.03
"""Seconds before a silence in which no window may have been loud if the sound has faded
out."""

FADED_DB = 12.0
"""From so far over the threshold a window is loud, and what follows has not faded."""

LONG_WINDOW = 0.1
"""Seconds from which a window counts as longer than what the gate measures, 32 ms."""

LONGEST_GAP = 0.25
"""Seconds of lost sound, about a window, across which windows are still joined."""


def begins_anew(lost: int, sample_rate: int) -> bool:
    """Whether a stream begins anew after a jump of so many samples: back in time, or
    too far ahead to be joined."""
    return not 0 <= lost <= LONGEST_GAP * sample_rate


_NO_PREDICTION = Prediction(
    (1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, start=0.0, end=0.0
)


class Heard(NamedTuple):
    """What a detector made of a block before the model is asked."""

    block: AudioBlock
    """The block."""
    contacts: list[Contact]
    """The changes of contact in it, oldest first."""
    windows: list[Window]
    """The windows that it completes, which the model has to classify."""


class PhasedDetector(ABC):
    """A detector that takes sound in two phases, with the model between them, so that
    the windows of several fingers can be classified in one call of it.

    The second phase of a block comes before the first of the next.
    """

    window_detector: WindowDetector
    """Cuts the windows, and has the model that classifies them."""

    gate: ContactGate | None
    """Decides on contact, where there is one."""

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound; return the predictions that it completes, oldest first."""
        [predictions] = _push_in_phases([self], [block])
        return predictions

    @abstractmethod
    def parts(self, block: AudioBlock) -> Sequence[AudioBlock]:
        """Cut a block into the parts that it is to be taken in."""

    @abstractmethod
    def take(self, part: AudioBlock) -> Heard:
        """Take a part of the sound: decide on contact, and cut the windows that the
        model is to classify."""

    @abstractmethod
    def complete(self, heard: Heard, answers: list[Prediction]) -> list[Prediction]:
        """Return the predictions of a part, given what the model says of each of its
        windows."""

    @property
    @abstractmethod
    def due(self) -> int:
        """Position in the stream up to which sound may wait, as long as contact does
        not change."""


def push_together(
    detectors: Sequence[Detector], blocks: Sequence[AudioBlock]
) -> list[list[Prediction]]:
    """Let each detector take a block, their windows classified in one call; returns the
    predictions of each.

    A detector that another package registered need not have two phases: then each takes
    its block alone.
    """
    phased = [each for each in detectors if isinstance(each, PhasedDetector)]
    if len(phased) == len(detectors):
        return _push_in_phases(phased, blocks)
    return [
        detector.push(block) for detector, block in zip(detectors, blocks, strict=True)
    ]


def _push_in_phases(
    detectors: Sequence[PhasedDetector], blocks: Sequence[AudioBlock]
) -> list[list[Prediction]]:
    predictions: list[list[Prediction]] = [[] for _ in detectors]
    parts_of = [
        detector.parts(block) for detector, block in zip(detectors, blocks, strict=True)
    ]
    for place in range(max(map(len, parts_of))):
        # All are cut alike, unless some look for faults of microphones and some do not.
        fingers = [n for n, parts in enumerate(parts_of) if place < len(parts)]
        heard = [detectors[n].take(parts_of[n][place]) for n in fingers]
        answers = classify_windows(
            [detectors[n].window_detector for n in fingers],
            [each.windows for each in heard],
        )
        for n, own, answer in zip(fingers, heard, answers, strict=True):
            predictions[n] += detectors[n].complete(own, answer)
    return predictions


class TouchDetector(PhasedDetector):
    """Returns a prediction at every window and whenever contact begins or ends.

    With a contact gate, the gate decides on contact, by a threshold that is given or
    follows the noise. The start of a touch is reported at once. Whether it is rough is
    said by the evidence of all its windows (`evidence`). The end of a touch is reported
    at once, though the window still contains it. Without a gate, contact is that of the
    window, as in the paper. Detector and gate are for sound of the same rate, and fed
    by this object alone; ``window`` is the length of the detector's windows in s.

    Predictions are bit-equal at any block size. Lost sound (a jump of a block's
    ``start``) is closed up: windows join what was before it and what is after, and
    times follow the stream.
    """

    def __init__(
        self,
        detector: WindowDetector,
        gate: ContactGate | None = None,
        *,
        window: float = 0.256,
    ) -> None:
        self.window_detector = detector
        self.gate = gate
        self._window = window
        self.name = detector.name
        self.bandwidth = detector.bandwidth
        self.faults = detector.faults
        self.latency = detector.latency
        # From here on all three share one threshold. While it follows the noise, it is
        # the gate that moves it.
        follows = gate is not None and gate.threshold.follows_floor
        self.threshold = gate.threshold if gate and follows else detector.threshold
        detector.threshold = self.threshold
        if gate:
            gate.threshold = self.threshold
            if detector.card.channels == 1 and detector.card.microphone == "air":
                gate.microphone = AIR  # it hears what the model does
            detector.contact_at = self._contact_at
            detector.margin_db = WINDOW_MARGIN_DB if window > LONG_WINDOW else 0.0
        # As it was at the event that is being applied.
        self._threshold_dbfs = self.threshold.dbfs
        self._evidence = TouchEvidence(detector.card.decision)
        self._first = self._next = 0
        self._begin(0)

    @property
    def misfit(self) -> Misfit | None:
        """What about the sound does not fit the model now."""
        if self.window_detector.no_touch and self.window_detector.no_touch.noticed:
            return Misfit("no-touch", NO_TOUCH_TEXT)
        return self.window_detector.fit.misfit if self.window_detector.fit else None

    @property
    def floor(self) -> NoiseFloor | None:
        """The noise floor that gate and windows follow; none where the threshold was
        given."""
        return self.gate.floor if self.gate and self.threshold.follows_floor else None

    def begin(self, recording: RecordingFloor) -> None:
        """Begin at the floor of the recording that is to come; without a gate, with its
        threshold."""
        if self.gate:
            self.gate.begin(recording)
        else:
            self.threshold.dbfs = recording.threshold_dbfs
        self._begin(self._next)

    def parts(self, block: AudioBlock) -> Sequence[AudioBlock]:
        return (block,)

    def take(self, part: AudioBlock) -> Heard:
        self._follow_stream(part)
        # The gate first: windows read what it said at their time.
        contacts = self.gate.push(part) if self.gate else []
        self._contacts.extend(contacts)
        windows = self.window_detector.take(part)
        return Heard(part, contacts, windows)

    def complete(self, heard: Heard, answers: list[Prediction]) -> list[Prediction]:
        if self.gate is None:
            return [self._revise(self._shifted(answer)) for answer in answers]
        if not answers and not heard.contacts:
            return []
        return self._merge(answers, heard.contacts, heard.block.sample_rate)

    def _follow_stream(self, block: AudioBlock) -> None:
        """Find where in the stream a block lies, and begin anew where too much is lost.

        Gate and windows count the samples that they were given; predictions carry the
        time of the stream. So lost sound, a jump of a block's start, shifts all times
        after it.
        """
        lost = block.start - self._next
        if begins_anew(lost, block.sample_rate):
            self.reset()
            self._begin(block.start)
        elif lost:
            self._first += lost
        self._shift = self._first / block.sample_rate
        self._next = block.end
        if not self.threshold.follows_floor:
            self._threshold_dbfs = self.threshold.dbfs

    @property
    def due(self) -> int:
        if self.gate is None:
            return self._next
        return self._next + min(self.window_detector.missing, self.gate.longest_wait)

    def flush(self) -> list[Prediction]:
        return [
            self._revise(self._shifted(prediction))
            for prediction in self.window_detector.flush()
        ]

    def reset(self) -> None:
        """Return to the initial state; fault counts stay."""
        self.window_detector.reset()
        if self.gate:
            self.gate.reset()
        self._begin(0)

    def _contact_at(self, time: float) -> Contact:
        # Windows come in order, so what is older than the one asked for is asked for no
        # more.
        contacts = self._contacts
        while len(contacts) > 1 and contacts[1].time <= time:
            contacts.popleft()
        return contacts[0]

    def _begin(self, start: int) -> None:
        self._contacts = deque(
            [Contact(0.0, False, threshold_dbfs=self.threshold.dbfs)]
        )
        self.state = TouchState.ABSENT
        # Where in the stream the first sample lies, as if none had been lost, and where
        # the next one is expected; and the first in seconds.
        self._first = start
        self._next = start
        self._shift = 0.0
        # The prediction of the newest window, and the end of what was told last.
        self._newest = _NO_PREDICTION
        self._reported_until = -math.inf
        # What the gate last said, and since when.
        self._touching = self.gate is None
        self._since = 0.0
        self._held = False
        self._held_since = 0.0
        # Until when windows were loud, and how long the verdict is felt over a silence
        # that follows.
        self._loud_until = -math.inf
        self._pause = PAUSE
        self._evidence.reset()

    def _merge(
        self, predictions: list[Prediction], contacts: list[Contact], rate: int
    ) -> list[Prediction]:
        """Put windows and changes of contact in the order in which they became known,
        to the sample."""
        events: list[tuple[int, Contact | Prediction]] = [
            (round(contact.time * rate), contact) for contact in contacts
        ]
        # A thousandth of a sample covers the rounding of times; at odd rates windows
        # end between two samples.
        events += [
            (math.floor((window.end + self.latency) * rate + 1e-3), window)
            for window in predictions
        ]
        events.sort(key=lambda event: event[0])
        found: list[Prediction] = []
        for _, event in events:
            if isinstance(event, Contact):
                if prediction := self._apply_contact(event):
                    found.append(prediction)
            else:
                found.append(self._apply_window(self._shifted(event)))
        return found

    def _apply_window(self, window: Prediction) -> Prediction:
        """Let a window count; return what is felt of it."""
        if window.level_dbfs >= self._threshold_dbfs + FADED_DB:
            self._loud_until = window.end + self.latency
        self._weigh(window)
        return self._revise(window)

    def _weigh(self, window: Prediction) -> None:
        """Let a window be evidence, if it is one of sound that is heard now."""
        now = window.end + self.latency
        full_of_contact = (
            window.level_dbfs >= self._threshold_dbfs
            or now - self._since >= FULL_OF_CONTACT * self._window
        )
        # Of what the window itself decided, only that it was loud enough counts here.
        classified = window.touch is not Touch.NONE and not window.faulty
        heard = self._touching and not self._held
        if classified and heard and full_of_contact:
            self._evidence.hear(window.probabilities, now)

    def _apply_contact(self, contact: Contact) -> Prediction | None:
        """Let contact change; return what is felt from then on, or nothing where it has
        not changed and predictions come often enough."""
        now = contact.time + self._shift
        changed = (contact.touching, contact.held) != (self._touching, self._held)
        if self.threshold.follows_floor:
            # As it was at that time, however many blocks later this is read.
            self._threshold_dbfs = contact.threshold_dbfs
        if contact.held and not self._held:
            # Silence begins: a stroke that fades out is likely to turn and go on.
            self._held_since = now
            faded = now - self._loud_until >= FADING
            self._pause = FADED_PAUSE if faded else PAUSE
        self._held = contact.held
        if contact.touching is not self._touching:
            self._touching = contact.touching
            self._since = now
        end = now - self.latency
        if not changed and end - self._reported_until < MAX_INTERVAL:
            return None
        # Between two windows: the newest window's prediction, revised by contact, its
        # bounds moved up to this moment.
        start = self._newest.start + end - self._newest.end
        return self._revise(replace(self._newest, start=start, end=end))

    def _revise(self, prediction: Prediction) -> Prediction:
        """Let the states of `touch_state` decide what is felt of a prediction."""
        self._newest = prediction
        self._reported_until = prediction.end
        if self.gate is None:
            return prediction
        now = prediction.end + self.latency
        no_touch = self.window_detector.no_touch
        sounds_like_touch = not (no_touch and no_touch.noticed)
        moment = Moment(
            touching=self._touching,
            faulty=prediction.faulty,
            silent=self._held and now - self._held_since >= self._pause,
            sounds_like_touch=sounds_like_touch,
            rough=self._evidence.is_rough(now),
        )
        self.state = next_state(moment)
        is_evident = self.state in (TouchState.ROUGH, TouchState.SMOOTH)
        return replace(
            prediction,
            touch=ANSWERS[self.state],
            roughness=(
                self._evidence.roughness(now)
                if is_evident and sounds_like_touch
                else 0.0
            ),
            unknown=(
                ANSWERS[self.state] is not Touch.NONE and self._evidence.is_unknown(now)
            ),
        )

    def _shifted(self, prediction: Prediction) -> Prediction:
        if not self._shift:
            return prediction
        return replace(
            prediction,
            start=prediction.start + self._shift,
            end=prediction.end + self._shift,
        )
