"""How rough a touch is within its class, in steps that a finger can tell apart.

Through one microphone the order of two surfaces is nearly always right where the
boundary between the classes is not (docs/research/detector.md). So what is drawn
follows the logit of the detector: P(rough) saturates, and two smooth surfaces have the
same.
"""

import math
from typing import NamedTuple

from tactophone.core.types import Prediction, Touch
from tactophone.signal.silences import LONGEST_TURN

GRADE_MEMORY = 0.7
"""Seconds over which the evidence is averaged, and since a touch began at most: slow
enough to compare two surfaces, and at once at a touch's start."""


class Span(NamedTuple):
    """The grades of a class by the logit: steep about its centre, and ever flatter
    beyond, so that no two are equal."""

    centre: float
    """Logit in the middle of the span."""
    width: float
    """Logits from the centre to where the slope has fallen to a third."""
    bottom: float
    """Lowest grade of the class."""
    top: float
    """Highest grade of the class."""
    start: float
    """Grade of a touch before its first window has been classified."""

    def at(self, logit: float) -> float:
        off = (logit - self.centre) / self.width
        # The factor is a little over a half, so that both ends are reached, seven
        # widths from the centre.
        share = 0.5 + 0.505 * off / math.sqrt(1 + off * off)
        return self.bottom + (self.top - self.bottom) * min(max(share, 0.0), 1.0)


SMOOTH_GRADE = 0.46
"""Grade at which the paper's smooth stimulus is drawn; its rough one is drawn at 1, and
what is smoother below this."""

SPANS = {
    Touch.SMOOTH: Span(-1.6, 1.0, 0.0, 0.68, SMOOTH_GRADE),
    Touch.ROUGH: Span(1.0, 2.0, 0.72, 1.0, 1.0),
}
"""A just-noticeable difference of `GradedProfile`'s vibration is 0.056: near the centre
a unit of the logit is four of them in smooth and one in rough. A smooth touch stays
weaker than any rough one, so a false bump cannot outdo it."""


class Grade:
    """Grades the touches of one pipeline: 0 is as smooth as can be, 1 as rough.

    Examples
    --------
    >>> grade = Grade()
    >>> even = Prediction((0.0, 0.5, 0.5), Touch.SMOOTH, 0.49, -20.0, 0.0, end=0.032)
    >>> round(grade.push(even), 2)
    0.63
    """

    def __init__(self) -> None:
        self._mean = 0.0
        """Mean logit of the touch, over `GRADE_MEMORY` at most."""
        self._heard = 0.0
        """Seconds of sound that the mean is taken over; 0 before the first window."""
        self._touched = -math.inf
        """End of the newest window in contact, in s."""
        self._end = -math.inf
        """End of the newest window that the mean took, in s."""

    def push(self, prediction: Prediction) -> float:
        """Take the next prediction; return the grade of its touch, 0 without
        contact."""
        if prediction.touch is Touch.NONE:
            return 0.0
        span = SPANS[prediction.touch]
        if prediction.start == prediction.end:
            # A prediction without a window asks what would be drawn, and is no part of
            # any touch.
            return span.at(_logit(prediction))
        # Another touch begins after a pause, and where a stream is restarted, so that
        # time begins anew.
        if not 0 <= prediction.end - self._touched <= LONGEST_TURN:
            self._heard = 0.0
            self._end = -math.inf
        self._touched = prediction.end
        # The contact gate says smooth, without any roughness, before a window is full
        # of touch and at the end of a touch: that is no evidence on the surface.
        if prediction.roughness > 0 or prediction.touch is Touch.ROUGH:
            passed = min(prediction.end - self._end, prediction.end - prediction.start)
            self._end = prediction.end
            self._heard = min(self._heard + passed, GRADE_MEMORY)
            if self._heard > 0:
                self._mean += (_logit(prediction) - self._mean) * passed / self._heard
        return span.at(self._mean) if self._heard else span.start


def _logit(prediction: Prediction) -> float:
    """Return the logit of rough against smooth, as far as float32 probabilities hold
    it."""
    _, smooth, rough = prediction.probabilities
    return math.log((rough + 1e-7) / (smooth + 1e-7))
