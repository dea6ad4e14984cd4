"""The detector: sound in; predictions out at every window, and whenever contact begins
or ends.

`WindowDetector` resamples, cuts windows, compares the level, runs the model's graph,
decides. The paper classifies the last 256 ms of both microphones at every sound buffer
(section III); this does so at the hop of the model's card. `TouchDetector` joins it
with the contact gate. Predictions are bit-equal at any block size.

Several fingers share the calls of the graph, with a window of each. A detector takes a
block of sound as a generator. Where windows fall due it yields them, and it is sent
their predictions. So whoever has several detectors collects what all of them wait for
(`process_together`), and a single detector is the case of one. Batching other fingers
into the same call changes a finger's result only in the last bits.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from typing import TypeAlias

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from tactophone.core.errors import ModelError
from tactophone.core.microphones import AIR, CONTACT, check_channels
from tactophone.core.types import (
    AudioBlock,
    ContactThreshold,
    Detector,
    FloatArray,
    Prediction,
    Touch,
)
from tactophone.signal.perception.contact import Contact, ContactGate
from tactophone.signal.perception.decision import Decision, Probabilities, rough_share
from tactophone.signal.perception.fit import FitCheck, Misfit
from tactophone.signal.perception.levels import loudness
from tactophone.signal.perception.model_file import (
    KINDS,
    SUPPORTS_MISSING_CHANNEL,
    Engine,
    Model,
    Samples,
)
from tactophone.signal.perception.no_touch import NO_TOUCH_TEXT, NoTouchCheck
from tactophone.signal.perception.noise_floor import NoiseFloor, RecordingFloor
from tactophone.signal.perception.resample import (
    RESAMPLER_LOWEST_RATE,
    Resampler,
    Windower,
)
from tactophone.signal.perception.touch_state import (
    ANSWERS,
    Answer,
    Moment,
    TouchState,
    next_state,
)

PendingWindows: TypeAlias = "tuple[WindowDetector, list[tuple[int, FloatArray]]]"
"""A detector and the windows that it waits for, oldest first: the sample after the
last, and the sound."""

Processing: TypeAlias = Generator[PendingWindows, list[Prediction], list[Prediction]]
"""A detector at work on a block: yields windows, is sent their predictions, and returns
those of the block."""


def push_together(
    detectors: Sequence[Detector], blocks: Sequence[AudioBlock]
) -> list[list[Prediction]]:
    """Let several detectors process a block each, their windows together; returns the
    predictions of each."""
    return process_together(
        [_processing(*each) for each in zip(detectors, blocks, strict=True)]
    )


def _processing(detector: Detector, block: AudioBlock) -> Processing:
    # A detector of a user's own need not have this method, and computes its windows
    # alone.
    process: Callable[[AudioBlock], Processing] | None = getattr(
        detector, "process", None
    )
    if process:
        return (yield from process(block))
    return detector.push(block)


def process_together(processings: Sequence[Processing]) -> list[list[Prediction]]:
    """Let several detectors process their blocks; returns the predictions of each."""
    results: list[list[Prediction]] = []
    waiting: dict[int, PendingWindows] = {}
    for number, processing in enumerate(processings):
        try:
            waiting[number] = next(processing)
            results.append([])
        except StopIteration as end:
            results.append(end.value)
    while waiting:
        answers, pending = _predict(list(waiting.values())), waiting
        waiting = {}
        for number, answer in zip(pending, answers, strict=True):
            try:
                waiting[number] = processings[number].send(answer)
            except StopIteration as end:
                results[number] = end.value
    return results


def _predict(pending: Sequence[PendingWindows]) -> list[list[Prediction]]:
    results: list[list[Prediction]] = [[] for _ in pending]
    by_network: dict[object, list[int]] = {}
    for number, (detector, _) in enumerate(pending):
        by_network.setdefault(detector.network, []).append(number)
    for numbers in by_network.values():
        # A window of each finger at a time: what the graph remembers of a touch depends
        # on the windows before.
        for place in range(max(len(pending[number][1]) for number in numbers)):
            due = [number for number in numbers if place < len(pending[number][1])]
            found = _predict_one_each(
                [(pending[number][0], *pending[number][1][place]) for number in due]
            )
            for number, prediction in zip(due, found, strict=True):
                results[number].append(prediction)
    return results


def _predict_one_each(
    due: Sequence[tuple["WindowDetector", int, FloatArray]],
) -> list[Prediction]:
    """Return the prediction of a window of each detector, all of one network."""
    sound = [window.T for _, _, window in due]
    levels = loudness(due[0][0].card.gate.rule, [each[CONTACT] for each in sound])
    measured = [
        detector.measure(each, level_dbfs, end)
        for each, level_dbfs, (detector, end, _) in zip(sound, levels, due, strict=True)
    ]
    found = due[0][0].classify(
        sound,
        [loud for _, loud in measured],
        [detector.state for detector, _, _ in due],
    )
    return [
        detector.decide(end, *level, *each)
        for (detector, end, _), level, each in zip(due, measured, found, strict=True)
    ]


CERTAINLY_NONE: Probabilities = (1.0, 0.0, 0.0)

_NOWHERE = np.empty(0, np.intp)


class InvalidPositions:
    """Remembers where in a stream samples were removed as invalid.

    >>> invalid = InvalidPositions()
    >>> invalid.push(3, np.array([[False], [True], [False]]))
    >>> invalid.any_between(0, 2), invalid.any_between(2, 3)
    (True, False)
    """

    def __init__(self) -> None:
        self._found = _NOWHERE
        self._count = 0

    def push(self, size: int, invalid: NDArray[np.bool_] | None) -> None:
        """Take the mask of the next samples, as many as ``size``; ``None`` where all
        are valid."""
        if invalid is not None:
            here = np.flatnonzero(invalid.any(axis=1))
            self._found = np.concatenate((self._found, self._count + here))
        self._count += size

    def any_between(self, start: int, end: int) -> bool:
        """Whether any sample from ``start`` to before ``end`` was invalid.

        Call it in ascending order of ``start``: positions before it are dropped.
        """
        if self._found is _NOWHERE:
            return False
        self._found = self._found[np.searchsorted(self._found, start) :]
        return bool(len(self._found)) and bool(self._found[0] < end)


class WindowDetector:
    """Classifies a stream of sound, window by window, with a model of any kind.

    - ``model``: with one channel it uses the contact microphone, channel 0, unless its
      card says air. Some kinds are trained to do without the air channel; for them, one
      channel less counts as digital silence.
    - ``sample_rate``: of the sound to come, in Hz.
    - ``faults``: predictions withheld, by cause: ``sound`` (invalid samples in the
      window), ``model`` (its output was not a probability distribution).
    - ``threshold``: level from which there is contact; the model's own, until another
      is assigned.
    - ``margin_db``: how far under the threshold a window still counts as contact.
    - ``contact_at``: returns the state of the contact gate at a time in s, where there
      is a gate.
    - ``hop``, ``bandwidth``, ``latency``: seconds between two predictions; the highest
      frequency, in Hz, that the model uses; seconds from a window's end until it can be
      classified.
    - ``missing``: samples until the next window is complete.
    - ``fit``: says whether the sound fits the model, where it is not ``None``; it
      changes no prediction.
    - ``no_touch``: says whether the sound is no touch, where it is not ``None``; then
      rough is not rendered.
    - ``trace``: called with the features and the prediction of each window, where it is
      not ``None``: for fitting.

    Raises `ModelError` if the rate is too low, or this version cannot run the model.
    """

    def __init__(self, model: Model, *, sample_rate: int) -> None:
        if sample_rate < RESAMPLER_LOWEST_RATE:
            raise ModelError(
                f"sound at {sample_rate} Hz, but models need {RESAMPLER_LOWEST_RATE} "
                "Hz or more; "
                "record at a higher rate"
            )
        card = self.card = model.card
        if card.kind not in KINDS:
            raise ModelError(
                f"model {card.name} is of kind {card.kind}, but this version runs "
                f"{', '.join(KINDS)}; update Tactophone"
            )
        self.name, self.hop, self.bandwidth = (
            card.name,
            float(card.hop / card.sample_rate),
            card.sample_rate / 2,
        )
        self.faults: Counter[str] = Counter()
        self.threshold, self.margin_db = ContactThreshold(card.gate.threshold_dbfs), 0.0
        self.contact_at: Callable[[float], Contact] | None = None
        self.fit: FitCheck | None = None
        self.no_touch: NoTouchCheck | None = None
        self.trace: Callable[[FloatArray, Prediction], None] | None = None
        self._sample_rate = sample_rate
        self._decision = Decision(card.decision)
        self.network = model
        """Detectors of one network compute their windows together."""
        engine = Engine(model.session)
        self.classify, self.state = engine.run, engine.new_state()
        """`state`: what the graph remembers of the touch."""
        self.reset()
        # Half the length of the low-pass, less a sample: the window ends *after* its
        # last sample, which is known once the low-pass has all around it.
        self.latency: float = (
            self._resampler.latency + 1 / sample_rate - 1 / card.sample_rate
        )

    @property
    def threshold_dbfs(self) -> float:
        """Level of a window from which there is contact now."""
        return self.threshold.dbfs - self.margin_db

    def reset(self) -> None:
        """Return to the initial state; the fault counts stay."""
        card = self.card
        self._invalid = InvalidPositions()
        self._resampler = Resampler(
            self._sample_rate, card.sample_rate, channels=card.channels
        )
        self._windower = Windower(card.window_size, card.hop, channels=card.channels)
        self._arrived: list[FloatArray] = []
        self.missing = self._resampler.missing_until(self._windower.next_end)
        self._decision.reset()
        self.state[:] = 0
        if self.fit:
            self.fit.reset()
        if self.no_touch:
            self.no_touch.reset()

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound; return the predictions that it completes.

        Raises `ModelError` if the block has fewer channels than the model needs or over
        two, or another rate.
        """
        return process_together([self.process(block)])[0]

    def process(self, block: AudioBlock) -> Processing:
        """Do as :meth:`push`, one of several detectors
        (`tactophone.signal.perception.detector`)."""
        if block.sample_rate != self._sample_rate:
            raise ModelError(
                f"sound at {block.sample_rate} Hz, but {self._sample_rate} Hz was "
                "announced; reopen the source"
            )
        samples = block.samples
        size, channels = samples.shape
        if channels > 2:
            check_channels(channels)
        if (
            channels < self.card.channels
            and self.card.kind not in SUPPORTS_MISSING_CHANNEL
        ):
            raise ModelError(
                f"sound with {channels} channel, but the model {self.card.name} needs "
                f"{self.card.channels} "
                "(contact and air); choose a one-channel model, such as paper-mono"
            )
        if self._arrived and self._arrived[0].shape[1] != channels:
            self._complete_windows()  # none: they fall due below
        invalid = block.invalid
        self._invalid.push(
            size, None if invalid is None else self._select_channels(invalid)
        )
        # Kept as it is until a window falls due: a packet is a quarter of a hop, and
        # each call on it costs.
        self._arrived.append(samples)
        self.missing -= size
        if self.missing > 0 or not (windows := self._complete_windows()):
            return []
        return (yield self, windows)

    def flush(self) -> list[Prediction]:
        windows = self._complete_windows() if self._arrived else []
        windows += self._windower.push(self._resampler.flush())
        return _predict([(self, windows)])[0] if windows else []

    def _complete_windows(self) -> list[tuple[int, FloatArray]]:
        """Resample all that arrived; return the windows that it completes."""
        samples = (
            self._arrived[0]
            if len(self._arrived) == 1
            else np.concatenate(self._arrived)
        )
        self._arrived = []
        samples = self._resampler.push(self._select_channels(samples))
        windows = self._windower.push(samples)
        self.missing = self._resampler.missing_until(self._windower.next_end)
        return windows

    def _select_channels(self, samples: Samples) -> Samples:
        missing = self.card.channels - samples.shape[1]
        if missing > 0:
            return np.pad(samples, ((0, 0), (0, missing)))
        return self.card.heard(samples)

    def measure(
        self, sound: FloatArray, level_dbfs: float, end: int
    ) -> tuple[float, bool]:
        """Return the level of a window, ``(channels, samples)``, and whether that is
        contact.

        ``end`` is the sample after its last one.
        """
        # As the gate stood when this window could be known, however many blocks later
        # it is read.
        gate = (
            self.contact_at(end / self.card.sample_rate + self.latency)
            if self.contact_at
            else None
        )
        threshold_dbfs = (
            gate.threshold_dbfs - self.margin_db if gate else self.threshold_dbfs
        )
        loud = level_dbfs >= threshold_dbfs
        if self.fit:
            self.fit.push(sound, touching=gate.touching if gate else loud)
        return level_dbfs, loud

    def decide(
        self,
        end: int,
        level_dbfs: float,
        loud: bool,
        probabilities: Probabilities,
        features: FloatArray,
    ) -> Prediction:
        """Return the prediction of the next window, from its level and what the graph
        returned."""
        faulty = self._is_faulty(end, probabilities)
        if faulty or (
            self.no_touch and self.no_touch.push(features, probabilities, loud=loud)
        ):
            probabilities = CERTAINLY_NONE
        if self.fit and loud:
            self.fit.hear(probabilities)
        touch, roughness = self._decision.decide(
            probabilities, contact=loud and not faulty
        )
        start, until = (
            (end - self.card.window_size) / self.card.sample_rate,
            end / self.card.sample_rate,
        )
        prediction = Prediction(
            probabilities, touch, roughness, level_dbfs, start, until, faulty=faulty
        )
        if self.trace:
            self.trace(features, prediction)
        return prediction

    def _is_faulty(self, end: int, probabilities: Probabilities) -> bool:
        # The input samples that contribute to the window that ends before sample `end`
        # at the model's rate.
        ratio, reach = self._sample_rate / self.card.sample_rate, self._resampler.reach
        first, last = (
            int((end - self.card.window_size) * ratio) - reach,
            int((end - 1) * ratio) + reach,
        )
        if self._invalid.any_between(first, last + 1):
            self.faults["sound"] += 1
            return True
        # Both comparisons with NaN are false; exp(log-softmax) in float32 sums to 1
        # within 1e-5.
        if not (abs(sum(probabilities) - 1) < 1e-3 and min(probabilities) >= 0):
            self.faults["model"] += 1
            return True
        return False


MAX_INTERVAL = 0.02
"""Longest time, in s, without a prediction: where windows come more rarely, the newest
one is repeated."""

WINDOW_MARGIN_DB = 6.0
"""How far under the threshold the level of a window full of contact may lie for its
prediction still to be used: a window covers eight times the sound that the gate does,
so that single impacts, loud enough for the gate, count less."""

FULL_OF_CONTACT = 0.5
"""Share of a window from which its prediction is used whatever its level. Before that
the window must be as loud as contact: else the noise in it would be classified."""

PAUSE = 0.01
"""How long (s) the last decision survives an abrupt silence. With the gate's 32 ms
window, rough ends at most about 40 ms after its sound."""

FADED_PAUSE = 0.08
"""As `PAUSE` (s), after a fade-out. At the turn of a stroke the silence lasts 29 ms
(median) to 71 ms (p90)."""

FADING, FADED_DB = 0.03, 12.0
"""Sound has faded where no window of the last 30 ms was 12 dB over the threshold."""

LANDED = 0.04
"""Seconds of a touch without rough: a landing clicks on a smooth surface too, and is
silent afterwards."""

EVIDENCE, EVIDENCE_RATE = 12.0, 10.0
"""Evidence of smooth that ends rough within a touch: at most 12, and 10 for each second
for which it has been rough, because rough that has lasted is likely to go on, while a
false bump must not be prolonged."""

EVIDENCE_OF_LOGIT, EVIDENCE_OF_UNKNOWN = 2.0, 0.1
"""Evidence of a window, besides 1, for each unit by which its logit is under the
threshold; and that of one whose sound is unknown."""

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


class TouchDetector:
    """Returns a prediction at every window and whenever contact begins or ends.

    With a contact gate, the gate decides on contact, by a threshold that is given or
    follows the noise. The start of a touch is reported at once, as smooth (a false bump
    is worse than a missed one), until the window is full enough of contact to be
    classified. Where a window within a touch is too quiet to be classified, the last
    decision stands, and rough stands until windows are evidence enough of smooth, or it
    would have holes (*dips*). The end of a touch is reported at once, though the window
    still contains it. Without a gate, contact is that of the window, as in the paper.
    Detector and gate are for sound of the same rate, and fed by this object alone;
    ``window`` is the length of the detector's windows in s.

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
        self.detector, self.gate, self._window = detector, gate, window
        self.name, self.bandwidth, self.faults = (
            detector.name,
            detector.bandwidth,
            detector.faults,
        )
        self.latency = detector.latency
        # From here on all three share one threshold. While it follows the noise, it is
        # the gate that moves it.
        self.threshold = (
            gate.threshold
            if gate and gate.threshold.follows_floor
            else detector.threshold
        )
        detector.threshold = self.threshold
        if gate:
            gate.threshold = self.threshold
            if detector.card.channels == 1 and detector.card.microphone == "air":
                gate.microphone = AIR  # it hears what the model does
            detector.contact_at = self._contact_at
            detector.margin_db = WINDOW_MARGIN_DB if window > LONG_WINDOW else 0.0
        self._threshold_dbfs = (
            self.threshold.dbfs
        )  # as it was at the event that is being applied
        self._first = self._next = 0
        self._begin(0)

    @property
    def misfit(self) -> Misfit | None:
        """What about the sound does not fit the model now."""
        if self.detector.no_touch and self.detector.no_touch.noticed:
            return Misfit("no-touch", NO_TOUCH_TEXT)
        return self.detector.fit.misfit if self.detector.fit else None

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

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound; return the predictions that it completes, oldest first."""
        return process_together([self.process(block)])[0]

    def process(self, block: AudioBlock) -> Processing:
        """Do as :meth:`push`, one of several detectors
        (`tactophone.signal.perception.detector`)."""
        # Detector and gate count the samples that they were given; predictions carry
        # the time of the stream. So lost sound, a jump of a block's start, shifts all
        # times after it; too long a gap begins anew.
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
        # The gate first: windows read what it said at their time.
        contacts = self.gate.push(block) if self.gate else []
        self._contacts.extend(contacts)
        predictions = yield from self.detector.process(block)
        if self.gate is None:
            return [
                self._revise(self._shifted(prediction)) for prediction in predictions
            ]
        return (
            self._merge(predictions, contacts, block.sample_rate)
            if predictions or contacts
            else []
        )

    @property
    def due(self) -> int:
        """Position in the stream up to which sound may wait while `gate` is quiet."""
        return (
            self._next + min(self.detector.missing, self.gate.patience)
            if self.gate
            else self._next
        )

    def flush(self) -> list[Prediction]:
        return [
            self._revise(self._shifted(prediction))
            for prediction in self.detector.flush()
        ]

    def reset(self) -> None:
        """Return to the initial state; fault counts stay."""
        self.detector.reset()
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
        self._first = self._next = start
        self._shift = 0.0
        self._newest = _NO_PREDICTION
        self._touching, self._since, self._held, self._held_since = (
            self.gate is None,
            0.0,
            False,
            0.0,
        )
        self._reported_until = -math.inf
        self._loud_until, self._pause = -math.inf, PAUSE
        self._against = self._rough_since = 0.0
        # The last decision of this touch.
        self._decided, self._roughness = Touch.SMOOTH, 0.0

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
        found = []
        for _, event in events:
            if not isinstance(event, Contact):
                window = self._shifted(event)
                if window.level_dbfs >= self._threshold_dbfs + FADED_DB:
                    self._loud_until = window.end + self.latency
                found.append(self._revise(self._persist(window)))
            elif prediction := self._apply_contact(event):
                found.append(prediction)
        return found

    def _persist(self, window: Prediction) -> Prediction:
        """Let rough stand until the windows of this touch are evidence enough against
        it."""
        if window.touch is Touch.ROUGH:
            self._against = 0.0
        if self._decided is not Touch.ROUGH or window.touch is not Touch.SMOOTH:
            return window
        rule = self.detector.card.decision
        under = _logit(rule.rough_off) - _logit(rough_share(window.probabilities))
        if window.probabilities[Touch.NONE] >= rule.abstain_from:
            self._against += EVIDENCE_OF_UNKNOWN
        else:
            self._against = (
                self._against + 1 + EVIDENCE_OF_LOGIT * under if under > 0 else 0.0
            )
        if self._against >= min(
            EVIDENCE, EVIDENCE_RATE * (window.end - self._rough_since)
        ):
            return window
        return replace(window, touch=Touch.ROUGH, roughness=self._roughness)

    def _apply_contact(self, contact: Contact) -> Prediction | None:
        changed = (contact.touching, contact.held) != (self._touching, self._held)
        if self.threshold.follows_floor:
            # As it was at that time, however many blocks later this is read.
            self._threshold_dbfs = contact.threshold_dbfs
        if contact.held and not self._held:
            self._held_since = contact.time + self._shift
            self._pause = (
                FADED_PAUSE if self._held_since - self._loud_until >= FADING else PAUSE
            )
        self._held = contact.held
        if contact.touching is not self._touching:
            self._touching, self._since = contact.touching, contact.time + self._shift
            self._decided, self._roughness = Touch.SMOOTH, 0.0
        end = contact.time + self._shift - self.latency
        if not changed and end - self._reported_until < MAX_INTERVAL:
            return None
        # Between two windows: the newest window's prediction, revised by contact, its
        # bounds moved up to this moment.
        return self._revise(
            replace(
                self._newest, start=self._newest.start + end - self._newest.end, end=end
            )
        )

    def _revise(self, prediction: Prediction) -> Prediction:
        """Let the states of `touch_state` decide what is felt of a prediction."""
        self._newest, self._reported_until = prediction, prediction.end
        if self.gate is None:
            return prediction
        now = prediction.end + self.latency
        no_touch = self.detector.no_touch
        moment = Moment(
            touching=self._touching,
            faulty=prediction.faulty,
            paused=self._held and now - self._held_since < self._pause,
            held=self._held,
            usable=(
                prediction.level_dbfs >= self._threshold_dbfs
                or now - self._since >= FULL_OF_CONTACT * self._window
            ),
            landed=now - self._since >= LANDED,
            sounds_like_touch=not (no_touch and no_touch.noticed),
            window=prediction.touch,
        )
        self.state = next_state(moment)
        match ANSWERS[self.state]:
            case Answer.NOTHING:
                return replace(prediction, touch=Touch.NONE, roughness=0.0)
            case Answer.SMOOTH:
                return replace(prediction, touch=Touch.SMOOTH, roughness=0.0)
            case Answer.LAST_DECISION:
                return replace(
                    prediction, touch=self._decided, roughness=self._roughness
                )
        if not moment.sounds_like_touch:
            prediction = replace(prediction, touch=Touch.SMOOTH, roughness=0.0)
        return self._remember(prediction)

    def _remember(self, prediction: Prediction) -> Prediction:
        """Keep what a window says as the last decision of this touch."""
        if prediction.touch is not self._decided:
            # From here on evidence counts against the new decision.
            self._against, self._rough_since = 0.0, prediction.end
        self._decided, self._roughness = prediction.touch, prediction.roughness
        return prediction

    def _shifted(self, prediction: Prediction) -> Prediction:
        if not self._shift:
            return prediction
        return replace(
            prediction,
            start=prediction.start + self._shift,
            end=prediction.end + self._shift,
        )


def _logit(share: float) -> float:
    share = min(max(share, 1e-6), 1 - 1e-6)
    return math.log(share / (1 - share))
