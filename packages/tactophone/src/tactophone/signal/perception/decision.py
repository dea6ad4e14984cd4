"""From the probabilities and contact of single windows to a touch: the threshold, its
hysteresis and its confirmation.

This decides where there is no contact gate, as in the paper. With the gate, which is
the default, the evidence of the whole touch decides (`evidence`), and takes of a rule
its reference and ``abstain_from``.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import Touch

Probabilities = tuple[float, float, float]


NEVER_ABSTAIN = 2.0
"""A probability that no *none* reaches."""

MOST_CONFIRM = 1000
"""Predictions of ten seconds: no touch waits longer to be rough."""

FORGET_AFTER = 25
"""Predictions without contact after which the next one is a new touch: as many as come
during `signal.silences.LONGEST_TURN`, one every 10 ms. Graphs of the kind ``texture``
are trained with it."""


@dataclass(frozen=True, slots=True)
class DecisionRule:
    """When a prediction is *rough*; the defaults are the paper's: the likelier of
    smooth and rough, at once.

    - ``rough_on``: rough share (see :func:`rough_share`), over 0 and under 1, from
      which the decision turns from smooth to rough.
    - ``rough_off``: rough share under which it turns back to smooth; at most
      ``rough_on``.
    - ``confirm``: consecutive predictions in contact that must reach ``rough_on``
      before the decision turns rough. A touch that was rough before the still point of
      a stroke, of up to `FORGET_AFTER` predictions, is confirmed already.
    - ``abstain_from``: probability of *none* from which a touch is unlike any in
      training: it is rendered as plain contact, smooth. :data:`NEVER_ABSTAIN` for
      models, like the paper's, whose *none* is trained but not used.

    Raises `ValueError` if a value is out of range.
    """

    rough_on: float = 0.5
    rough_off: float = 0.5
    confirm: int = 1
    abstain_from: float = NEVER_ABSTAIN

    def __post_init__(self) -> None:
        if not 0 < self.rough_off <= self.rough_on < 1:
            raise ValueError(f"{self}: must have 0 < rough_off <= rough_on < 1")
        if not 1 <= self.confirm <= MOST_CONFIRM:
            raise ValueError(f"{self}: confirm must be 1 to {MOST_CONFIRM}")
        if not 0 <= self.abstain_from <= NEVER_ABSTAIN:
            raise ValueError(f"{self}: abstain_from must be 0 to {NEVER_ABSTAIN:g}")

    @property
    def reference(self) -> float:
        """Log odds of rough that speak for neither class: midway between the two
        thresholds."""
        return (logit(self.rough_on) + logit(self.rough_off)) / 2

    @property
    def even_share(self) -> float:
        """The rough share whose log odds are the reference.

        >>> DecisionRule(0.8, 0.5).even_share
        0.6666666666666666
        """
        return share_of(self.reference)


class Decision:
    """Turns the probabilities of each prediction into a touch and a roughness; keeps
    the last decision."""

    def __init__(self, rule: DecisionRule) -> None:
        self._rule = rule
        self.reset()

    def reset(self) -> None:
        self._rough = False
        self._streak = self._quiet = 0

    def decide(
        self, probabilities: Probabilities, *, contact: bool
    ) -> tuple[Touch, float]:
        """Return the touch and the roughness, 0 to 1, where 0.5 is the threshold in
        force.

        Missing contact overrides the network, whose own *none* is trained but not used
        (paper, section IV-C).
        """
        if not contact or probabilities[Touch.NONE] >= self._rule.abstain_from:
            # A window without contact, or with unknown sound, neither counts towards
            # confirmation nor, for up to `FORGET_AFTER` windows, resets the decision.
            self._streak = 0
            self._quiet = self._quiet + 1
            self._rough = self._rough and self._quiet < FORGET_AFTER
            return (Touch.SMOOTH if contact else Touch.NONE), 0.0
        self._quiet = 0
        share = rough_share(probabilities)
        # Hysteresis: the threshold in force depends on the last decision.
        threshold = self._rule.rough_off if self._rough else self._rule.rough_on
        self._streak = self._streak + 1 if share >= self._rule.rough_on else 0
        self._rough = share >= threshold and (
            self._rough or self._streak >= self._rule.confirm
        )
        roughness = roughness_of(share, threshold)
        if self._rough:
            return Touch.ROUGH, roughness
        # A share over the threshold that is not confirmed yet must not be rendered as
        # rough either.
        return Touch.SMOOTH, min(roughness, HIGHEST_SMOOTH)


HIGHEST_SMOOTH = math.nextafter(0.5, 0)
"""Greatest roughness of what is smooth."""


def roughness_of(share: float, threshold: float) -> float:
    """Return the roughness of a rough share: piecewise linear, so that the threshold
    lies at 0.5, and 0 and 1 stay where they are.

    >>> roughness_of(0.4, 0.8), roughness_of(0.9, 0.8)
    (0.25, 0.75)
    """
    if share < threshold:
        return 0.5 * share / threshold
    return 0.5 + 0.5 * (share - threshold) / (1 - threshold)


def logit(share: float) -> float:
    """Return the log odds of a share; of 0 and 1 as of a millionth and its opposite.

    >>> round(logit(0.8), 2), round(logit(1.0), 1)
    (1.39, 13.8)
    """
    share = min(max(share, 1e-6), 1 - 1e-6)
    return math.log(share / (1 - share))


def share_of(log_odds: float) -> float:
    """Return the share of these log odds.

    >>> share_of(logit(0.8))
    0.8
    """
    return 1 / (1 + math.exp(-log_odds))


def rough_share(probabilities: Probabilities) -> float:
    """Return the probability of rough given that it is rough or smooth.

    >>> rough_share((0.5, 0.125, 0.375))
    0.75
    """
    _, smooth, rough = probabilities
    return rough / (smooth + rough) if smooth + rough > 0 else 0.5


def count_bumps(rough: NDArray[np.bool_], smooth: NDArray[np.bool_]) -> int:
    """Count the false bumps of predictions: stretches with rough while a smooth surface
    is touched.

    >>> count_bumps(np.array([1, 1, 0, 1, 1], bool), np.array([1, 1, 1, 1, 0], bool))
    2
    """
    return int((np.diff((rough & smooth).astype(np.int8), prepend=0) > 0).sum())


def count_dips(rough: NDArray[np.bool_], touching: NDArray[np.bool_]) -> int:
    """Count the dips of predictions: stretches without rough between two with it,
    within one touch of a rough surface.

    >>> rough = np.array([1, 0, 0, 1, 0, 1], bool)
    >>> touching = np.array([1, 1, 1, 1, 0, 1], bool)
    >>> count_dips(rough, touching)
    1
    """
    touches = np.flatnonzero(
        np.diff(touching.astype(np.int8), prepend=0, append=0)
    ).reshape(-1, 2)
    begun = [
        int((np.diff(rough[first:end].astype(np.int8), prepend=0) > 0).sum())
        for first, end in touches
    ]
    return sum(max(0, count - 1) for count in begun)
