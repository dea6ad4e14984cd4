"""Sound to belief, at every window and whenever contact begins or ends: the detector and the contact gate as one."""

import math
from dataclasses import replace

from tactophone.perception.contact import Contact, ContactGate
from tactophone.perception.debounce import ContactDebounce
from tactophone.types import AudioBlock, Detector, Prediction, Touch

BEAT = 0.02
"""Longest time, in s, without a belief: where windows come more rarely, the newest is told again."""

WINDOW_MARGIN_DB = 6.0
"""How far under the threshold a window may lie and still be told, once it is full of contact: it looks back over eight
times the sound that the gate does, so that single impacts, loud enough for the gate, count for less in it."""

FULL_OF_CONTACT = 0.128
"""Seconds of touch, half a window, from which a window is told whatever its level. Before that it must be as loud as
contact is: else it would be the noise in it that is judged."""

LONGEST_GAP = 0.25
"""Seconds of lost sound, about a window, over which what was heard before still counts."""

_NOTHING_HEARD = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, start=0.0, end=0.0)


class TouchDetector:
    """Sound to belief, at every window and whenever contact begins or ends.

    With a contact gate, contact is the gate's word: a touch is believed at once, as plain contact (smooth, which a
    false bump is worse than) until the detector's window is full enough of it to tell; a touch that ended is
    believed no longer, though the window still holds it. Without one, contact is the window's, as in the paper, or
    that of steady windows.

    Parameters
    ----------
    detector, gate
        For sound of the same rate; both are fed by this judge alone.
    steady
        What windows are held to where there is no gate.

    Notes
    -----
    Beliefs are the same to the bit in whatever blocks the sound comes. Lost sound (a jump of a block's ``start``) is
    closed up: windows join what was before it and what is after, and times follow the stream.
    """

    def __init__(
        self, detector: Detector, gate: ContactGate | None = None, *, steady: ContactDebounce | None = None
    ) -> None:
        self.detector, self._gate, self._steady = detector, gate, steady
        self.latency = detector.latency
        """Seconds from the end of a belief's window to the moment of the belief."""
        self.threshold_dbfs = detector.threshold_dbfs
        self._begin(0)

    @property
    def threshold_dbfs(self) -> float:
        """Level of contact; may be set at any time."""
        return self._threshold_dbfs

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None:
        self._threshold_dbfs = level_dbfs
        self.detector.threshold_dbfs = level_dbfs - WINDOW_MARGIN_DB * bool(self._gate)
        if self._gate:
            self._gate.threshold_dbfs = level_dbfs

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound in; give the beliefs that it leads to, oldest first."""
        self._follow(block)
        predictions = self.detector.push(block)
        contacts = self._gate.push(block) if self._gate else []
        return self._merge(predictions, contacts, block.sample_rate)

    def flush(self) -> list[Prediction]:
        """Give what the end of the stream still completes."""
        return [self._believe(self._shifted(prediction)) for prediction in self.detector.flush()]

    def reset(self) -> None:
        """Become as new; fault counts stay."""
        self.detector.reset()
        if self._gate:
            self._gate.reset()
        if self._steady:
            self._steady.reset()
        self._begin(0)

    def _begin(self, start: int) -> None:
        self._first = self._next = start
        self._shift = 0.0
        self._belief = _NOTHING_HEARD
        self._touching, self._since = self._gate is None, 0.0
        self._told = -math.inf

    def _follow(self, block: AudioBlock) -> None:
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
        events: list[tuple[int, Contact | Prediction]] = [(round(one.time * rate), one) for one in contacts]
        # A thousandth of a sample covers the rounding of times; at odd rates windows end between two samples.
        events += [(math.floor((one.end + self.latency) * rate + 1e-3), one) for one in predictions]
        events.sort(key=lambda event: event[0])
        told = (self._hear(one) if isinstance(one, Contact) else self._believe(self._shifted(one)) for _, one in events)
        return [belief for belief in told if belief]

    def _hear(self, contact: Contact) -> Prediction | None:
        changed = contact.touching is not self._touching
        if changed:
            self._touching, self._since = contact.touching, contact.time + self._shift
        end = contact.time + self._shift - self.latency
        if not changed and end - self._told < BEAT:
            return None
        # Told between two windows: the newest belief, revised by contact, its bounds moved up to this moment.
        return self._believe(replace(self._belief, start=self._belief.start + end - self._belief.end, end=end))

    def _believe(self, prediction: Prediction) -> Prediction:
        self._belief, self._told = prediction, prediction.end
        if self._gate is None:
            return self._steadied(prediction)
        if not self._touching or prediction.faulty:
            return _overruled(prediction, Touch.NONE)
        if prediction.touch is Touch.NONE or not self._tells(prediction):
            return _overruled(prediction, Touch.SMOOTH)
        return prediction

    def _steadied(self, prediction: Prediction) -> Prediction:
        if not self._steady or self._steady.hear(prediction, threshold_dbfs=self._threshold_dbfs):
            return prediction
        return _overruled(prediction, Touch.NONE)

    def _tells(self, prediction: Prediction) -> bool:
        lasted = prediction.end + self.latency - self._since
        return prediction.level_dbfs >= self._threshold_dbfs or lasted >= FULL_OF_CONTACT

    def _shifted(self, prediction: Prediction) -> Prediction:
        if not self._shift:
            return prediction
        return replace(prediction, start=prediction.start + self._shift, end=prediction.end + self._shift)


def _overruled(prediction: Prediction, touch: Touch) -> Prediction:
    # Written out, as `replace` looks at every field by name, which an update feels.
    return Prediction(
        prediction.probabilities, touch, 0.0, prediction.level_dbfs, prediction.start, prediction.end, prediction.faulty
    )
