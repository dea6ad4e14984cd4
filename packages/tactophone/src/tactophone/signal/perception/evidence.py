"""Evidence that a touch is rough or smooth, gathered over the whole touch.

One window is right in nine of ten cases, the windows of a stroke together nearly
always. So what counts is a sum: each window adds its log odds of rough, less a
reference that lies between what smooth and rough surfaces give. The sum is bounded on
both sides, and the verdict turns where it crosses a limit (Page, "Continuous inspection
schemes", Biometrika 41, 100, 1954). Windows in which nothing is heard, or only what the
model does not know, add nothing, and the verdict stands.

The two errors do not cost the same. A false bump is felt as a mistake, rough that comes
a twentieth of a second late is not. So a new touch begins as smooth, as far from rough
as it can be, and windows near even odds count as smooth.

A touch is new after `LIFT` without one. Until then the verdict outlasts a lift, because
the next stroke is usually on the same thing: it is rough from its first moment if the
last one was. Who lands on another thing sooner feels the last one until the new windows
have outweighed it.

Where durations are stated, a window comes every 10 ms and adds 2 nats over or under the
reference, which is the median of strokes.
"""

import math

from tactophone.core.types import Touch
from tactophone.signal.perception.decision import (
    HIGHEST_SMOOTH,
    DecisionRule,
    Probabilities,
    logit,
    rough_share,
    roughness_of,
)
from tactophone.signal.silences import LIFT

LEAST = -4.0
"""Least evidence, in nats; a touch begins there, and rough ends there. Windows overlap,
so three of them in a row are wrong together, and must not turn a touch by
themselves."""

ROUGH_FROM = 6.0
"""Evidence, in nats, from which a touch is rough: 10 above `LEAST`, five usual windows
of a rough surface, 50 ms. A landing on a smooth thing clicks for 20 to 40 ms."""

MOST = 12.0
"""Most evidence, in nats: from there to `LEAST` it takes eight usual windows of a
smooth surface, 80 ms. With less, rough had holes where a finger turns."""

GREATEST_STEP = 3.0
"""What one window can add, in nats: no single one turns a touch, however sure it is."""

CAUTION = 0.3
"""Nats by which each window counts less for rough. A false bump costs more than missed
rough of the same length, so windows near even odds are to say smooth; with 0.3, no
tip's model renders more smooth as rough than by streaks of sure windows."""


class WindowEvidence:
    """What one window says for rough or smooth, by a model's rule: its two thresholds
    give the reference, and `abstain_from` says what is unlike all training.

    >>> window = WindowEvidence(DecisionRule())
    >>> round(window.of((0.0, 0.3, 0.7)), 2), window.of((0.0, 0.0, 1.0))
    (0.55, 3.0)
    """

    def __init__(self, rule: DecisionRule) -> None:
        self._reference = rule.reference + CAUTION
        self._abstain_from = rule.abstain_from

    def of(self, probabilities: Probabilities) -> float:
        """Return the evidence for rough in nats, at most `GREATEST_STEP` either way;
        NaN where the sound is unlike all training, which says nothing."""
        if probabilities[Touch.NONE] >= self._abstain_from:
            return math.nan
        evidence = logit(rough_share(probabilities)) - self._reference
        return min(max(evidence, -GREATEST_STEP), GREATEST_STEP)


class TouchEvidence:
    """The sum of one finger, and the verdict.

    ``rule``: the model's, as of `WindowEvidence`.

    >>> evidence = TouchEvidence(DecisionRule())
    >>> for window in range(6):
    ...     evidence.hear((0.0, 0.1, 0.9), 0.01 * window)
    >>> evidence.is_rough(0.06), evidence.is_rough(0.06 + LIFT)
    (True, False)
    """

    def __init__(self, rule: DecisionRule) -> None:
        self._window = WindowEvidence(rule)
        self._even_share = rule.even_share
        self.reset()

    def reset(self) -> None:
        """Forget the touch."""
        self._sum = LEAST
        self._rough = False
        self._roughness = 0.0
        self._heard_at = -math.inf
        self._is_known = False

    def hear(self, probabilities: Probabilities, now: float) -> None:
        """Take a window of touch; ``now`` in s, ascending."""
        if now - self._heard_at > LIFT:
            self.reset()
        self._heard_at = now
        evidence = self._window.of(probabilities)
        if math.isnan(evidence):
            self._is_known = False
            return
        self._roughness = roughness_of(rough_share(probabilities), self._even_share)
        total = self._sum + evidence
        # A new touch begins at a bound, but only evidence makes it known.
        self._is_known = not LEAST < total < MOST
        self._sum = min(max(total, LEAST), MOST)
        # Between the two limits the verdict stands.
        if self._sum >= ROUGH_FROM:
            self._rough = True
        elif self._sum <= LEAST:
            self._rough = False

    def is_rough(self, now: float) -> bool:
        """Whether the touch is rough at this time, in s."""
        return self._rough and self._lasts(now)

    def is_unknown(self, now: float) -> bool:
        """Whether the verdict is a toss-up: the sum is at neither of its bounds, or no
        window has brought it there yet, or the newest one is unlike all training."""
        return not (self._is_known and self._lasts(now))

    def roughness(self, now: float) -> float:
        """How rough the newest window is, 0 to 1: at least 0.5 where the touch is
        rough, and less where it is smooth."""
        if not self._lasts(now):
            return 0.0
        if self._rough:
            return max(self._roughness, 0.5)
        return min(self._roughness, HIGHEST_SMOOTH)

    def _lasts(self, now: float) -> bool:
        return now - self._heard_at <= LIFT
