"""From probabilities and a level to what is believed: the contact gate, the threshold and its hysteresis."""

import math
from dataclasses import dataclass

from tactophone.types import Touch

Probabilities = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class DecisionRule:
    """When to believe *rough*; the defaults are the paper's: the likelier of smooth and rough, at once.

    Parameters
    ----------
    rough_on
        Share of rough in rough and smooth, above 0 and below 1, from which a smooth belief turns rough.
    rough_off
        Share under which a rough belief turns smooth again; at most ``rough_on``.
    confirm
        How many updates in a row must reach ``rough_on`` before the belief turns rough.
    abstain_from
        Probability of *none* from which a touch, though there is contact, is unlike any that the model knows: it is
        felt as plain contact, smooth. Over 1 for models, like the paper's, whose *none* is trained but not asked.
    """

    rough_on: float = 0.5
    rough_off: float = 0.5
    confirm: int = 1
    abstain_from: float = 2.0

    def __post_init__(self) -> None:
        if not (0 < self.rough_off <= self.rough_on < 1 and self.confirm >= 1):
            raise ValueError(f"{self}: wanted 0 < rough_off <= rough_on < 1 and confirm >= 1")


class Decision:
    """Turns each update's probabilities into a touch and a roughness, remembering the last belief."""

    def __init__(self, rule: DecisionRule) -> None:
        self._rule = rule
        self.reset()

    def reset(self) -> None:
        """Become as new: nothing is believed rough."""
        self._rough = False
        self._streak = 0

    def decide(self, probabilities: Probabilities, *, contact: bool) -> tuple[Touch, float]:
        """Give the touch and the roughness, 0 to 1, where 0.5 is the threshold in force.

        *No contact* overrides the network, whose own *none* is trained but not asked (paper, section III).
        """
        unknown = probabilities[Touch.NONE] >= self._rule.abstain_from
        share = 0.0 if unknown else rough_share(probabilities)
        threshold = self._rule.rough_off if self._rough else self._rule.rough_on
        self._streak = self._streak + 1 if share >= self._rule.rough_on else 0
        self._rough = contact and share >= threshold and (self._rough or self._streak >= self._rule.confirm)
        if not contact:
            return Touch.NONE, 0.0
        if self._rough:
            return Touch.ROUGH, _around(share, threshold)
        # A share over the threshold that is not confirmed yet must not be felt as rough either.
        return Touch.SMOOTH, min(_around(share, threshold), math.nextafter(0.5, 0))


def rough_share(probabilities: Probabilities) -> float:
    """Probability of rough given that it is rough or smooth.

    Examples
    --------
    >>> rough_share((0.5, 0.125, 0.375))
    0.75
    """
    _, smooth, rough = probabilities
    return rough / (smooth + rough) if smooth + rough > 0 else 0.5


def _around(share: float, threshold: float) -> float:
    """Stretch a share piecewise so that the threshold lies at 0.5, and 0 and 1 stay where they are."""
    if share < threshold:
        return 0.5 * share / threshold
    return 0.5 + 0.5 * (share - threshold) / (1 - threshold)
