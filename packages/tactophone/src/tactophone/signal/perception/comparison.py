"""Which of two objects is rougher, by touches on each, and how sure that is.

Two objects are put in order far better than one alone is named: what the microphones,
the gain and the finger do to the sound, they do to both. What is compared is the mean
evidence of all windows that are heard of an object (`evidence`). How often that order
is right was counted on pairs of simulated objects, by the difference.
"""

import math

from tactophone.core.types import Prediction, Touch
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.evidence import WindowEvidence

LEAST_HEARD = 1.0
"""Seconds of touch that must be heard of each object: less is a stroke or two, and the
next ones may say otherwise."""

EVEN_TO_SURE = 1.3
"""Nats of difference from even odds to odds of e, that is from 0.50 to 0.73 of pairs in
the right order: fitted to 48 random simulated objects under the pad
(``benchmarks/comparison.py --fit``). Other tips are taken to be alike."""


class MeanEvidence:
    """The mean evidence of all that is heard of one object, by a model's rule.

    Attributes
    ----------
    value
        The mean, from -3 (smooth) to 3 (rough) nats; 0 before anything was heard.
    seconds
        How much sound the mean was taken over, overlapping windows once.
    """

    def __init__(self, rule: DecisionRule) -> None:
        self.value = 0.0
        self.seconds = 0.0
        self._window = WindowEvidence(rule)
        self._end = -math.inf

    def push(self, prediction: Prediction) -> None:
        """Take the next prediction; one that says nothing of the surface does not
        count."""
        if not is_heard(prediction):
            return
        evidence = self._window.of(prediction.probabilities)
        new = min(prediction.end - self._end, prediction.end - prediction.start)
        if math.isnan(evidence) or new <= 0:
            return
        self._end = prediction.end
        self.seconds += new
        self.value += (evidence - self.value) * new / self.seconds


def is_heard(prediction: Prediction) -> bool:
    """Whether a prediction is of sound that touch makes now, not of a silence over
    which contact is held."""
    if prediction.touch is Touch.NONE or prediction.faulty:
        return False
    # The contact gate says smooth, without any roughness, where it hears nothing.
    return prediction.roughness > 0 or prediction.touch is Touch.ROUGH


def probability_rougher(difference: float) -> float:
    """Return the probability that the first of two objects is the rougher one, by the
    difference of its mean evidence to the other's, in nats.

    >>> probability_rougher(0.0), round(probability_rougher(5.0), 2)
    (0.5, 0.98)
    """
    return 1 / (1 + math.exp(-difference / EVEN_TO_SURE))
