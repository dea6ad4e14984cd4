"""Contact gate and window detector together: predictions at every window and whenever contact begins or ends."""

import math
from dataclasses import replace

from tactophone.perception.batching import Processing, process_together
from tactophone.perception.contact import Contact, ContactGate
from tactophone.perception.noise_floor import NoiseFloor
from tactophone.types import AudioBlock, Detector, Prediction, Touch

MAX_INTERVAL = 0.02
"""Longest time, in s, without a prediction: where windows come more rarely, the newest one is repeated."""

WINDOW_MARGIN_DB = 6.0
"""How far under the threshold the level of a window full of contact may lie for its prediction still to be used: a
window covers eight times the sound that the gate does, so that single impacts, loud enough for the gate, count less."""

FULL_OF_CONTACT = 0.5
"""Share of a window from which its prediction is used whatever its level. Before that the window must be as loud as
contact: else the noise in it would be classified."""

PAUSE = 0.01
"""Seconds of held silence for which the last decision stands where sound stopped at once: with the 32 ms over which the
gate measures, rough ends within about 40 ms of its sound."""

FADED_PAUSE = 0.04
"""The same where sound faded, as it does where a stroke turns; that silence lasts for 25 ms (p50) to 58 (p90)."""

FADING, FADED_DB = 0.03, 10.0
"""Sound has faded where no window of the last 30 ms was 10 dB over the threshold. Where it stops at once, 19 in 20 are
louder by 16 dB; where a stroke turns, nine in ten are not (`benchmarks/demo_scores.py`, seeds 100 to 300)."""

LONG_WINDOW = 0.1
"""Seconds from which a window counts as longer than what the gate measures, 32 ms."""

LONGEST_GAP = 0.25
"""Seconds of lost sound, about a window, across which windows are still joined."""

_NO_PREDICTION = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, start=0.0, end=0.0)


class TouchDetector:
    """Returns a prediction at every window and whenever contact begins or ends.

    With a contact gate, the gate decides on contact, by a threshold that is given or follows the noise. The start of a
    touch is reported at once, as smooth (a false bump is worse than a missed one), until the window is full enough of
    contact to be classified. Where a window within a touch is too quiet to be classified, the last decision stands. The
    end of a touch is reported at once, though the window still contains it. Without a gate, contact is that of the
    window, as in the paper. Detector and gate are for sound of the same rate, and fed by this object alone; ``window``
    is the length of the detector's windows in s.

    Notes
    -----
    Predictions are bit-equal at any block size. Lost sound (a jump of a block's ``start``) is closed up: windows join
    what was before it and what is after, and times follow the stream.
    """

    def __init__(self, detector: Detector, gate: ContactGate | None = None, *, window: float = 0.256) -> None:
        self.detector, self._gate, self._window = detector, gate, window
        self.latency = detector.latency
        """Seconds from the end of a prediction's window to the moment of the prediction."""
        if gate and gate.floor:
            self._threshold_dbfs = gate.threshold_dbfs
        else:
            self.threshold_dbfs = detector.threshold_dbfs
        self._begin(0)

    @property
    def threshold_dbfs(self) -> float:
        """Level of contact; may be assigned at any time, and then follows the noise no longer."""
        return self._threshold_dbfs

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None:
        self._threshold_dbfs = level_dbfs
        below = WINDOW_MARGIN_DB if self._gate and self._window > LONG_WINDOW else 0.0
        self.detector.threshold_dbfs = level_dbfs - below
        if self._gate:
            self._gate.threshold_dbfs = level_dbfs

    @property
    def floors(self) -> list[NoiseFloor]:
        """The noise floors that gate and window detector follow; none where the threshold was given."""
        floors = (getattr(part, "floor", None) for part in (self._gate, self.detector))
        return [floor for floor in floors if floor]

    @property
    def follows_floor(self) -> bool:
        """Whether the threshold follows the noise floor; not once it was given or calibrated."""
        # Asked for at each packet; as `floors` without the lists.
        return bool(self._gate and self._gate.floor) or getattr(self.detector, "floor", None) is not None

    def adopt_floors(self, other: "TouchDetector") -> None:
        """Take over what another detector, of the same microphone and rule, has measured of the noise."""
        for own, known in zip(self.floors, other.floors, strict=False):
            own.adopt(known)

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound; return the predictions that it completes, oldest first."""
        return process_together([self.process(block)])[0]

    def process(self, block: AudioBlock) -> Processing:
        """Do as :meth:`push`, one of several detectors (`tactophone.perception.batching`)."""
        self._follow(block)
        predictions = yield from self.detector.process(block)
        if self._gate is None:
            return [self._revise(self._shifted(prediction)) for prediction in predictions]
        contacts = self._gate.push(block)
        return self._merge(predictions, contacts, block.sample_rate) if predictions or contacts else []

    def flush(self) -> list[Prediction]:
        """Return the predictions that only the end of the stream completes."""
        return [self._revise(self._shifted(prediction)) for prediction in self.detector.flush()]

    def reset(self) -> None:
        """Return to the initial state; fault counts stay."""
        self.detector.reset()
        if self._gate:
            self._gate.reset()
        self._begin(0)

    def _begin(self, start: int) -> None:
        self._first = self._next = start
        self._shift = 0.0
        self._newest = _NO_PREDICTION
        self._touching, self._since, self._held, self._held_since = self._gate is None, 0.0, False, 0.0
        self._reported_until = -math.inf
        self._loud_until, self._pause = -math.inf, PAUSE
        # The last decision of this touch.
        self._decided, self._roughness = Touch.SMOOTH, 0.0

    def _follow(self, block: AudioBlock) -> None:
        """Account for lost sound: detector and gate count samples received, predictions carry stream time."""
        lost = block.start - self._next
        if lost < 0 or lost > LONGEST_GAP * block.sample_rate:
            self.reset()
            self._begin(block.start)
        elif lost:
            self._first += lost
        self._shift = self._first / block.sample_rate
        self._next = block.end

    def _merge(self, predictions: list[Prediction], contacts: list[Contact], rate: int) -> list[Prediction]:
        """Put windows and changes of contact in the order in which they became known, to the sample."""
        events: list[tuple[int, Contact | Prediction]] = [(round(contact.time * rate), contact) for contact in contacts]
        # A thousandth of a sample covers the rounding of times; at odd rates windows end between two samples.
        events += [(math.floor((window.end + self.latency) * rate + 1e-3), window) for window in predictions]
        events.sort(key=lambda event: event[0])
        revised = (
            self._apply_contact(event) if isinstance(event, Contact) else self._apply_window(self._shifted(event))
            for _, event in events
        )
        return [prediction for prediction in revised if prediction]

    def _apply_window(self, prediction: Prediction) -> Prediction:
        if prediction.level_dbfs >= self._threshold_dbfs + FADED_DB:
            self._loud_until = prediction.end + self.latency
        return self._revise(prediction)

    def _apply_contact(self, contact: Contact) -> Prediction | None:
        changed = (contact.touching, contact.held) != (self._touching, self._held)
        if self._gate and self._gate.floor:
            # As it was at that time, however many blocks later this is read.
            self._threshold_dbfs = contact.threshold_dbfs
        if contact.held and not self._held:
            self._held_since = contact.time + self._shift
            self._pause = FADED_PAUSE if self._held_since - self._loud_until >= FADING else PAUSE
        self._held = contact.held
        if contact.touching is not self._touching:
            self._touching, self._since = contact.touching, contact.time + self._shift
            self._decided, self._roughness = Touch.SMOOTH, 0.0
        end = contact.time + self._shift - self.latency
        if not changed and end - self._reported_until < MAX_INTERVAL:
            return None
        # Between two windows: the newest window's prediction, revised by contact, its bounds moved up to this moment.
        return self._revise(replace(self._newest, start=self._newest.start + end - self._newest.end, end=end))

    def _revise(self, prediction: Prediction) -> Prediction:
        self._newest, self._reported_until = prediction, prediction.end
        if self._gate is None:
            return prediction
        if not self._touching or prediction.faulty:
            return _overruled(prediction, Touch.NONE)
        paused = self._held and prediction.end + self.latency - self._held_since < self._pause
        # A held touch may have ended: it is felt faintly at most, or a rough vibration would outlast it.
        if not paused and (self._held or not self._is_usable(prediction)):
            return _overruled(prediction, Touch.SMOOTH)
        if paused or prediction.touch is Touch.NONE:
            return _overruled(prediction, self._decided, self._roughness)
        self._decided, self._roughness = prediction.touch, prediction.roughness
        return prediction

    def _is_usable(self, prediction: Prediction) -> bool:
        lasted = prediction.end + self.latency - self._since
        return prediction.level_dbfs >= self._threshold_dbfs or lasted >= FULL_OF_CONTACT * self._window

    def _shifted(self, prediction: Prediction) -> Prediction:
        if not self._shift:
            return prediction
        return replace(prediction, start=prediction.start + self._shift, end=prediction.end + self._shift)


def _overruled(prediction: Prediction, touch: Touch, roughness: float = 0.0) -> Prediction:
    # Written out, as `replace` looks up every field by name, which costs measurable time in each update.
    end, faulty = prediction.end, prediction.faulty
    return Prediction(prediction.probabilities, touch, roughness, prediction.level_dbfs, prediction.start, end, faulty)
