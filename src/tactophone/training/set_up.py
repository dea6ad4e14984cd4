"""Fits a shipped model to one set-up from a minute of its own sound: `tactophone setup`.

On a new finger the boundary is what is wrong, so little is fitted: which score to use, and its boundary. There are
three scores: the shipped model's own logit; the *impulses*, crest and clicks and how much they vary, which under a
hard tip grow with roughness by geometry (docs/reference/simulator.md), whatever the room and the gain; and their mean.
The score is the one that is right on objects left out one at a time. Weights on all features, from two smooth and two
rough objects, learn those objects (docs/research/set-up.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactophone.errors import ModelError
from tactophone.perception import BAND_VALUES, Model, WindowDetector
from tactophone.training.features.examples import even_weights
from tactophone.training.features.linear_classifier import IMPULSES
from tactophone.types import AudioBlock, FloatArray, Prediction

Floats = NDArray[np.float64]

SCORES = {"impulses": (2.0, 0.0), "both": (1.0, 1.0), "model": (0.0, 2.0)}
"""Weights of the standardised impulses and of the shipped model's standardised logit."""

SOFT_TIP = "rubber"
"""Under it rough surfaces average and smooth ones stick and slip: impulses are no sign of roughness there."""

LARGEST = 4.0
"""Standard deviations at which features are cut off: a knock must not decide."""

LOGIT_LIMIT = 6.0
"""Bound of the shipped model's logit, which is far too certain where everything is strange to it."""

MOST_UNKNOWN = 0.05
"""Share of a finger's own sound that may be unknown to the shipped model before its abstention is switched off."""

BOUNDARY = 20.0
"""The boundary is looked for within this of the mean of the objects."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectSound:
    """The windows in contact of one object.

    Parameters
    ----------
    name, rough
        Of the object, and whether it is rough.
    features
        Shape ``(windows, features)``; NaN where a channel is missing.
    logit
        Of the shipped model, rough against smooth, shape ``(windows,)``.
    unknown
        Share of the windows that are unlike the shipped model's training.
    """

    name: str
    rough: bool
    features: FloatArray
    logit: Floats
    unknown: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """The logit of a set-up: ``slope * shipped logit + weights @ standardised features + bias``."""

    centre: Floats
    scale: Floats
    weights: Floats
    slope: float
    bias: float

    def logit(self, sound: ObjectSound) -> Floats:
        """Return the logit of each window."""
        standard = np.nan_to_num(np.clip((sound.features - self.centre) / self.scale, -LARGEST, LARGEST))
        return np.asarray(self.slope * _bounded(sound.logit) + standard @ self.weights + self.bias)


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Share of an object's windows that are right: by the shipped model, and fitted without this object (or NaN)."""

    name: str
    rough: bool
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class SetUpFit:
    """A correction, the score chosen, the estimate for each object left out, and the share of unknown sound."""

    correction: Correction
    score: str
    left_out: tuple[LeftOut, ...]
    unknown: float = 0.0

    @property
    def abstains(self) -> bool:
        """Whether the model may still call sound unknown: not where this finger's own sound mostly is."""
        return self.unknown <= MOST_UNKNOWN

    @property
    def balanced_accuracy(self) -> float:
        """Mean over both classes of the objects left out; NaN where a class has one object only."""
        return _balanced([(entry.rough, entry.after) for entry in self.left_out])

    @property
    def balanced_accuracy_before(self) -> float:
        """The same of the shipped model."""
        return _balanced([(entry.rough, entry.before) for entry in self.left_out])


def collect(
    model: Model, samples: FloatArray, *, sample_rate: int, threshold_dbfs: float, name: str, rough: bool
) -> ObjectSound:
    """Return the windows in contact of one object.

    Parameters
    ----------
    model, samples, sample_rate
        The shipped model, and sound of shape ``(samples, channels)`` at a rate in Hz.
    name, rough
        Of the object.
    threshold_dbfs
        Of contact.

    Raises
    ------
    ModelError
        If there is no contact.
    """
    detector = WindowDetector(model, sample_rate=sample_rate)
    detector.threshold_dbfs = threshold_dbfs
    features: list[FloatArray] = []
    logits: list[float] = []
    unknown = 0

    def keep(window: FloatArray, prediction: Prediction) -> None:
        if prediction.level_dbfs >= threshold_dbfs and not prediction.faulty:
            nonlocal unknown
            unknown += prediction.probabilities[0] >= model.card.decision.abstain_from
            _, p_smooth, p_rough = (max(probability, 1e-9) for probability in prediction.probabilities)
            features.append(window.copy())
            logits.append(math.log(p_rough / p_smooth))

    detector.trace = keep
    detector.push(AudioBlock(samples, sample_rate))
    if not features:
        raise ModelError(
            f"{name}: no contact in it; slide faster or press harder, or turn the contact microphone's gain up"
        )
    return ObjectSound(name, rough, np.array(features), np.array(logits), unknown / len(logits))


def fit_set_up(sounds: Sequence[ObjectSound], *, channels: int, tip: str) -> SetUpFit:
    """Fit the boundary to the objects of a set-up, by the score that is right on objects left out.

    With one object of a class there is nothing to choose by: impulses are taken, under a soft tip the model's logit.

    Raises
    ------
    ValueError
        If there is no smooth or no rough object.
    """
    if {sound.rough for sound in sounds} != {False, True}:
        raise ValueError("a set-up needs a smooth and a rough object at least")
    names = ["model"] if tip == SOFT_TIP else list(SCORES)
    losses = {name: _held_out_loss(sounds, name, channels) for name in names}
    score = min(names, key=lambda name: losses[name])
    entries = tuple(_leave_out(sounds, sound, score, channels) for sound in sounds)
    unknown = float(np.mean([sound.unknown for sound in sounds]))
    return SetUpFit(fit_boundary(sounds, score, channels=channels), score, entries, unknown)


def fit_boundary(sounds: Sequence[ObjectSound], score: str, *, channels: int) -> Correction:
    """Fit the boundary of a score; every object of a class has the same weight."""
    impulses, model = SCORES[score]
    features = np.concatenate([sound.features for sound in sounds]).astype(np.float64)
    # The mean of objects, so that the one slid over for longest does not pull the centre towards itself.
    centre = np.nan_to_num(np.mean([np.nan_to_num(sound.features).mean(axis=0) for sound in sounds], axis=0))
    scale = np.maximum(np.nan_to_num(features.std(axis=0), nan=1.0), 1e-3)
    columns = impulse_columns(features.shape[1], channels)
    weights = np.zeros(features.shape[1])
    weights[columns] = impulses / len(columns)
    logit = _bounded(np.concatenate([sound.logit for sound in sounds]))
    unbiased = Correction(centre, scale, weights, model / max(float(logit.std()), 0.5), 0.0)
    sizes = [len(sound.logit) for sound in sounds]
    rough = np.repeat([sound.rough for sound in sounds], sizes)
    weight = even_weights(rough, np.repeat(np.arange(len(sounds)), sizes))
    return replace(unbiased, bias=_boundary(np.concatenate([unbiased.logit(sound) for sound in sounds]), rough, weight))


def impulse_columns(features: int, channels: int) -> NDArray[np.intp]:
    """Return the columns of crest and clicks, means and deviations, of the air microphone where there are two.

    >>> impulse_columns(40, 1).tolist()
    [17, 18, 37, 38]

    Raises
    ------
    ModelError
        If the features are not those of the kind texture.
    """
    if features != 2 * BAND_VALUES * channels:
        raise ModelError("only models of kind texture can be fitted to a set-up; choose one with --model")
    return 2 * BAND_VALUES * (channels - 1) + np.array(IMPULSES)


def _held_out_loss(sounds: Sequence[ObjectSound], score: str, channels: int) -> float:
    """Return the mean logistic loss over objects left out; the place in the list where none can be left out."""
    losses = [
        float(
            np.logaddexp(0, -(2 * sound.rough - 1) * fit_boundary(rest, score, channels=channels).logit(sound)).mean()
        )
        for sound in sounds
        if (rest := _others(sounds, sound))
    ]
    return float(np.mean(losses)) if losses else float(list(SCORES).index(score))


def _leave_out(sounds: Sequence[ObjectSound], sound: ObjectSound, score: str, channels: int) -> LeftOut:
    before, after = _share(sound.logit, sound.rough), math.nan
    if rest := _others(sounds, sound):
        after = _share(fit_boundary(rest, score, channels=channels).logit(sound), sound.rough)
    return LeftOut(sound.name, sound.rough, before, after)


def _others(sounds: Sequence[ObjectSound], sound: ObjectSound) -> list[ObjectSound]:
    """Return the other objects; none where they are all smooth or all rough."""
    rest = [other for other in sounds if other is not sound]
    return rest if len({other.rough for other in rest}) == 2 else []


def _boundary(logit: Floats, rough: NDArray[np.bool_], weight: Floats) -> float:
    """Return the bias at which both classes are missed alike: the zero of the logistic loss's slope, by bisection."""
    low, high = -BOUNDARY, BOUNDARY
    for _ in range(60):
        middle = (low + high) / 2
        slope = weight @ (1 / (1 + np.exp(-(logit + middle))) - rough)
        low, high = (low, middle) if slope > 0 else (middle, high)
    return (low + high) / 2


def _balanced(shares: Sequence[tuple[bool, float]]) -> float:
    smooth, rough = (float(np.mean([share for label, share in shares if label is which])) for which in (False, True))
    return (smooth + rough) / 2


def _share(logit: Floats, rough: bool) -> float:
    return float(np.mean((logit > 0) == rough))


def _bounded(logit: Floats) -> Floats:
    return np.clip(logit, -LOGIT_LIMIT, LOGIT_LIMIT)
