"""Whether an air microphone hears something that is no touch: speech, rain, typing,
claps.

A hard tip's model takes their clicks for strikes. Where it says rough, a logistic
regression on its features tells them from touch. Such a window counts as unknown; once
they prevail, touch is smooth until the sound is a touch again.

The weights stand in the card of the model whose features they weigh, so every copy of
the file brings them. ``benchmarks/no_touch.py --fit`` writes them there.
"""

import math

import msgspec
import numpy as np

from tactophone.core.errors import ModelError
from tactophone.core.types import FloatArray, Touch
from tactophone.signal.perception.model_file import FEATURES, Model

SCORE_LIMIT = 4.0
"""Greatest score of a window for or against: no single one decides."""

NOTICE_MEMORY = 40
"""Windows, 0.4 s, after which the weight of one has fallen to 1/e, before a notice."""

END_MEMORY = 200
"""Windows, 2 s, after which it has during a notice."""

NOTICE_FROM = -1.5
"""Mean score of rough windows from which it is noticed; touch is near -4."""

END_UNDER = -3.0
"""Mean score of all windows under which a notice ends."""

NO_TOUCH_TEXT = (
    "this sounds like speech, rain or typing, not like touch, so rough is not "
    "rendered: move the air microphone to the "
    "tip and away from people, or turn its gain down"
)


class NoTouchCheck:
    """Scores the windows of one detector; ``noticed``: whether the sound of late is no
    touch."""

    def __init__(self, weights: FloatArray, bias: float) -> None:
        self._weights = np.asarray(weights, np.float32)
        self._bias = bias
        self.reset()

    def reset(self) -> None:
        """Return to the initial state: whatever sounds is touch."""
        self.noticed = False
        self._mean = END_UNDER

    def push(
        self,
        features: FloatArray,
        probabilities: tuple[float, float, float],
        *,
        loud: bool,
    ) -> bool:
        """Take a window and what the model makes of it; return whether it, or the sound
        of late, is no touch."""
        rough = probabilities[Touch.ROUGH] > probabilities[Touch.SMOOTH]
        if not (loud and (rough or self.noticed) and np.isfinite(features).all()):
            return self.noticed
        evidence = float(features @ self._weights) + self._bias
        score = min(max(evidence, -SCORE_LIMIT), SCORE_LIMIT)
        # A notice comes soon and goes late.
        memory = END_MEMORY if self.noticed else NOTICE_MEMORY
        limit = END_UNDER if self.noticed else NOTICE_FROM
        self._mean += (score - self._mean) / memory
        self.noticed = self._mean >= limit
        return self.noticed or score > 0


NO_TOUCH = "no_touch"
"""Entry of a card's settings that holds the weights."""


class NoTouchWeights(msgspec.Struct, frozen=True):
    """The logistic regression, as a card holds it."""

    weights: tuple[float, ...]
    """One for each feature of the model."""
    bias: float


def read_no_touch(model: Model) -> NoTouchCheck | None:
    """Return the check that a model's card brings; ``None`` where it brings none.

    Raises `ModelError` if what it brings is not a weight for each feature.
    """
    entry = model.card.settings.get(NO_TOUCH)
    if entry is None:
        return None
    sizes = {each.name: each.shape[-1] for each in model.session.get_outputs()}
    try:
        fitted = msgspec.convert(entry, NoTouchWeights)
        finite = all(map(math.isfinite, (*fitted.weights, fitted.bias)))
        if not finite or len(fitted.weights) != sizes[FEATURES]:
            raise ValueError(
                f"{len(fitted.weights)} weights, but it needs a finite one for each of "
                f"{sizes[FEATURES]} features"
            )
    except ValueError as error:
        raise ModelError(
            f"model {model.card.name}: {NO_TOUCH} in its card cannot be used "
            f"({error}); copy the file or train it again"
        ) from None
    return NoTouchCheck(np.array(fitted.weights, np.float32), fitted.bias)
