"""Fits a shipped model to one set-up from a minute of its own sound: `tactophone
setup`.

The shipped boundary stays unless the objects just recorded prove it wrong
(`proves_wrong`): objects differ more than set-ups do, and a boundary fitted to a pair
of them is often the worse one for others. Otherwise little is fitted, which score to
use and its boundary. There are three scores: the shipped model's own logit; the
*impulses*, crest and clicks, which under a hard tip grow with roughness by geometry
(docs/reference/simulator.md), whatever the room and the gain; and their mean. The tip
says which to use; another is taken only if it is clearly better on objects left out one
at a time, as two objects of a kind say little. Weights on all features, from two smooth
and two rough objects, learn those objects (docs/research/set-up.md).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import ModelProto, helper, numpy_helper

from tactophone.core.errors import ModelError
from tactophone.core.tips import TIPS
from tactophone.core.types import AudioBlock, FloatArray, Prediction
from tactophone.signal.perception.decision import NEVER_ABSTAIN
from tactophone.signal.perception.model_file import Gate, Model
from tactophone.signal.perception.window_detector import WindowDetector
from tactophone_lab.training.onnx_export import Floats, write_graph
from tactophone_lab.training.recipe_options import BAND_VALUES, CREST_INDEX
from tactophone_lab.training.sets import HARD_TIPS

SCORES = {"impulses": (2.0, 0.0), "both": (1.0, 1.0), "model": (0.0, 2.0)}
"""Weights of the standardised impulses and of the shipped model's standardised
logit."""

LARGEST_SHIFT = 4.0
"""Standard deviations at which features are cut off: a knock must not decide."""

LOGIT_LIMIT = 6.0
"""Bound of the shipped model's logit, which is far too certain where everything is
strange to it."""

MOST_UNKNOWN = 0.05
"""Share of a finger's own sound that may be unknown to the shipped model before its
abstention is switched off."""

BOUNDARY_MARGIN = 0.1
"""By which the share that is right on objects left out must be larger for another score
than the tip's own."""

BOUNDARY_ERROR = 0.02
"""Probability, at most, that a set-up changes a boundary that is right for half of each
object's pieces or more."""

MOST_WRONG = 0.75
"""Share of pieces that must be wrong besides: with more seconds less is proven, but a
boundary that is wrong for little more than half of an object is seldom wrong for others
(docs/research/set-up.md)."""

FIT_PIECE = 50
"""Windows that are one piece of evidence: half a second, twice the memory of the
running statistics."""

SHIPPED_BOUNDARY = "shipped"
"""Score of a set-up that keeps the shipped boundary."""

FIT_TAIL = 0.1
"""Share of an object's windows that lies beyond the quantile that faces the other
class."""

MIN_SCALE = 1e-3
"""Least deviation of a feature within an object: steadier sound is not known more
precisely."""

MIN_LOGIT_SCALE = 0.5
"""Least deviation of the shipped model's logit within an object, for the same
reason."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectSound:
    """The windows in contact of one object."""

    name: str
    rough: bool
    """`name` and `rough`: of the object, and whether it is rough."""
    features: FloatArray
    """Shape ``(windows, features)``; NaN where a channel is missing."""
    logit: Floats
    """Of the shipped model, rough against smooth, shape ``(windows,)``."""
    unknown: float = 0.0
    """Share of the windows that are unlike the shipped model's training."""


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """The logit of a set-up: ``slope * shipped logit + weights @ standardised features
    + bias``."""

    centre: Floats
    scale: Floats
    weights: Floats
    slope: float
    bias: float

    def logit(self, sound: ObjectSound) -> Floats:
        """Return the logit of each window."""
        standard = np.nan_to_num(
            np.clip(
                (sound.features - self.centre) / self.scale,
                -LARGEST_SHIFT,
                LARGEST_SHIFT,
            )
        )
        return np.asarray(
            self.slope * _bounded(sound.logit) + standard @ self.weights + self.bias
        )


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Share of an object's windows that are right: by the shipped model, and fitted
    without this object (or NaN).

    Where the shipped boundary stays, nothing was fitted: both are the shipped model's
    share.
    """

    name: str
    rough: bool
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class SetUpFit:
    """A correction, the score chosen, the estimate for each object left out, and the
    share of unknown sound."""

    correction: Correction
    score: str
    left_out: tuple[LeftOut, ...]
    unknown: float = 0.0

    @property
    def abstains(self) -> bool:
        """Whether the model may still call sound unknown: not where this finger's own
        sound mostly is."""
        return self.unknown <= MOST_UNKNOWN

    @property
    def keeps(self) -> bool:
        """Whether the shipped boundary stays."""
        return self.score == SHIPPED_BOUNDARY

    @property
    def balanced_accuracy(self) -> float:
        """Mean over both classes of the objects left out; NaN where a class has one
        object only."""
        return _balanced([(entry.rough, entry.after) for entry in self.left_out])

    @property
    def balanced_accuracy_before(self) -> float:
        """The same of the shipped model."""
        return _balanced([(entry.rough, entry.before) for entry in self.left_out])


def collect(
    model: Model,
    samples: FloatArray,
    *,
    sample_rate: int,
    threshold_dbfs: float,
    name: str,
    rough: bool,
) -> ObjectSound:
    """Return the windows in contact of one object, whose sound has the shape
    ``(samples, channels)``.

    Raises `ModelError` if there is no contact.
    """
    detector = WindowDetector(model, sample_rate=sample_rate)
    detector.threshold.dbfs = threshold_dbfs
    features: list[FloatArray] = []
    logits: list[float] = []
    unknown = 0

    def keep(window: FloatArray, prediction: Prediction) -> None:
        if prediction.level_dbfs >= threshold_dbfs and not prediction.faulty:
            nonlocal unknown
            unknown += prediction.probabilities[0] >= model.card.decision.abstain_from
            _, p_smooth, p_rough = (
                max(probability, 1e-9) for probability in prediction.probabilities
            )
            features.append(window.copy())
            logits.append(math.log(p_rough / p_smooth))

    detector.trace = keep
    detector.push(AudioBlock(samples, sample_rate))
    if not features:
        raise ModelError(
            f"{name}: no contact in it; slide faster or press harder, or turn the "
            "contact microphone's gain up"
        )
    return ObjectSound(
        name, rough, np.array(features), np.array(logits), unknown / len(logits)
    )


def fit_set_up(sounds: Sequence[ObjectSound], *, channels: int, tip: str) -> SetUpFit:
    """Fit the boundary to the objects of a set-up, by the tip's own score unless
    another is clearly better.

    A hard tip's score is impulses, a soft tip's the model's logit. With one
    object of a class there is nothing to choose by. The shipped boundary stays if most
    objects of either class do not prove it wrong. Raises `ValueError` if there is no
    smooth or no rough object.
    """
    if {sound.rough for sound in sounds} != {False, True}:
        raise ValueError("a set-up needs a smooth and a rough object at least")
    unknown = float(np.mean([sound.unknown for sound in sounds]))
    wrong = {
        sound.name: proves_wrong(sound, error=BOUNDARY_ERROR / len(sounds))
        for sound in sounds
    }
    by_class = [
        np.mean([wrong[sound.name] for sound in sounds if sound.rough is rough])
        for rough in (False, True)
    ]
    if max(by_class) <= 0.5:
        shares = [(sound, _share(sound.logit, sound.rough)) for sound in sounds]
        kept = tuple(
            LeftOut(sound.name, sound.rough, share, share) for sound, share in shares
        )
        count = sounds[0].features.shape[1]
        unchanged = Correction(
            np.zeros(count), np.ones(count), np.zeros(count), 1.0, 0.0
        )
        return SetUpFit(unchanged, SHIPPED_BOUNDARY, kept, unknown)
    own = "impulses" if tip in HARD_TIPS else "model"
    names = (
        [own]
        if tip in TIPS and not TIPS[tip].impulses
        else [own, *(name for name in SCORES if name != own)]
    )
    left_out = {
        name: tuple(_leave_out(sounds, sound, name, channels) for sound in sounds)
        for name in names
    }
    right = {
        name: [entry.after for entry in left_out[name] if not math.isnan(entry.after)]
        for name in names
    }
    # The first of those that are equal: with nothing to choose by, the tip's own.
    score = max(
        names,
        key=lambda name: (
            (np.mean(right[name]) if right[name] else 0.0)
            + BOUNDARY_MARGIN * (name == own)
        ),
    )
    return SetUpFit(
        fit_boundary(sounds, score, channels=channels), score, left_out[score], unknown
    )


def proves_wrong(sound: ObjectSound, *, error: float) -> bool:
    """Whether more pieces of an object's sound are on the wrong side than chance
    explains, with at most this error.

    A sign test: were the boundary right for this object, no more than every second
    piece would be on the wrong side. `MOST_WRONG` of them must be besides.
    """
    pieces = np.array_split(
        (sound.logit > 0) != sound.rough, max(1, len(sound.logit) // FIT_PIECE)
    )
    wrong = sum(bool(np.mean(piece) > 0.5) for piece in pieces)
    count = len(pieces)
    chance = (
        sum(math.comb(count, more) for more in range(wrong, count + 1)) / 2.0**count
    )
    return bool(chance <= error and wrong >= MOST_WRONG * count)


def fit_boundary(
    sounds: Sequence[ObjectSound], score: str, *, channels: int
) -> Correction:
    """Fit the boundary of a score: midway between the facing tails of the two classes.

    A mean of tails, each over the objects of a class, and deviations within an object:
    neither depends on how long an object was slid over, nor on how far apart the
    objects lie. The tails, and not the middles, because rough sound spreads several
    times as wide as smooth sound.
    """
    impulses, model = SCORES[score]
    features = [np.nan_to_num(sound.features).astype(np.float64) for sound in sounds]
    centre = np.mean([each.mean(axis=0) for each in features], axis=0)
    scale = np.maximum(
        np.sqrt(np.mean([each.var(axis=0) for each in features], axis=0)), MIN_SCALE
    )
    columns = impulse_columns(features[0].shape[1], channels)
    weights = np.zeros(len(centre))
    weights[columns] = impulses / len(columns)
    spread = math.sqrt(np.mean([_bounded(sound.logit).var() for sound in sounds]))
    unbiased = Correction(
        centre, scale, weights, model / max(spread, MIN_LOGIT_SCALE), 0.0
    )
    smooth, rough = (
        np.mean(
            [
                np.quantile(unbiased.logit(sound), tail)
                for sound in sounds
                if sound.rough is label
            ]
        )
        for label, tail in ((False, 1 - FIT_TAIL), (True, FIT_TAIL))
    )
    return replace(unbiased, bias=float(-(smooth + rough) / 2))


def impulse_columns(features: int, channels: int) -> NDArray[np.intp]:
    """Return the columns of crest and clicks, of the air microphone where there are
    two.

    Only their means are returned: the deviations cover 250 ms, too few windows to be
    steady.

    >>> impulse_columns(40, 1).tolist()
    [17, 18]
    >>> impulse_columns(84, 2).tolist()
    [59, 60]

    Raises `ModelError` if the number of features does not fit the kind texture.
    """
    values, rest = divmod(features, 2 * channels)
    if rest or values not in (BAND_VALUES, BAND_VALUES + 1):
        raise ModelError(
            "only models of kind texture can be fitted to a set-up; choose one with "
            "--model"
        )
    return 2 * values * (channels - 1) + np.array([CREST_INDEX, CREST_INDEX + 1])


def _leave_out(
    sounds: Sequence[ObjectSound], sound: ObjectSound, score: str, channels: int
) -> LeftOut:
    before = _share(sound.logit, sound.rough)
    after = math.nan
    rest = [other for other in sounds if other is not sound]
    # Without this object all others may be smooth, or all rough: then there is no
    # boundary to fit.
    if {other.rough for other in rest} == {False, True}:
        after = _share(
            fit_boundary(rest, score, channels=channels).logit(sound), sound.rough
        )
    return LeftOut(sound.name, sound.rough, before, after)


def _balanced(shares: Sequence[tuple[bool, float]]) -> float:
    smooth, rough = (
        float(np.mean([share for label, share in shares if label is which]))
        for which in (False, True)
    )
    return (smooth + rough) / 2


def _share(logit: Floats, rough: bool) -> float:
    return float(np.mean((logit > 0) == rough))


def _bounded(logit: Floats) -> Floats:
    return np.clip(logit, -LOGIT_LIMIT, LOGIT_LIMIT)


def corrected(graph: ModelProto, correction: Correction) -> ModelProto:
    """Return the graph of a classifier of kind texture with a correction in place of
    its logit."""
    changed = ModelProto()
    changed.CopyFrom(graph)
    readers = [node for node in changed.graph.node if "logit" in node.input]
    tensors = {
        "own:centre": correction.centre,
        "own:scale": correction.scale,
        "own:weights": correction.weights[:, None],
        "own:slope": [correction.slope],
        "own:bias": [correction.bias],
        "own:most": LARGEST_SHIFT,
        "own:least": -LARGEST_SHIFT,
        "own:high": LOGIT_LIMIT,
        "own:low": -LOGIT_LIMIT,
    }
    nodes = [
        helper.make_node("Clip", ["logit", "own:low", "own:high"], ["own:bounded"]),
        helper.make_node("Mul", ["own:bounded", "own:slope"], ["own:scaled"]),
        # The features of a missing channel are this set-up's average, so that they add
        # nothing.
        helper.make_node("Where", ["missing", "own:centre", "whole"], ["own:whole"]),
        helper.make_node("Sub", ["own:whole", "own:centre"], ["own:off"]),
        helper.make_node("Div", ["own:off", "own:scale"], ["own:wide"]),
        helper.make_node(
            "Clip", ["own:wide", "own:least", "own:most"], ["own:standard"]
        ),
        helper.make_node("MatMul", ["own:standard", "own:weights"], ["own:shift"]),
        helper.make_node("Add", ["own:scaled", "own:shift"], ["own:sum"]),
        helper.make_node("Add", ["own:sum", "own:bias"], ["own:logit"]),
    ]
    for reader in readers:
        reader.input[:] = [
            "own:logit" if name == "logit" else name for name in reader.input
        ]
    # Nodes must stand in the order of their use.
    place = min(list(changed.graph.node).index(reader) for reader in readers)
    ordered = [*changed.graph.node[:place], *nodes, *changed.graph.node[place:]]
    del changed.graph.node[:]
    changed.graph.node.extend(ordered)
    stored = [
        numpy_helper.from_array(np.asarray(value, np.float32), name)
        for name, value in tensors.items()
    ]
    changed.graph.initializer.extend(stored)
    onnx.checker.check_model(changed)
    return changed


def own_tip(settings: Mapping[str, Any], tip: str) -> dict[str, Any]:
    """Return a card's settings for the user's own tip, which need not sound like the
    simulated one."""
    kept = {name: value for name, value in settings.items() if name != "tip_sound"}
    return {**kept, "tip": tip}


def write_set_up(
    path: Path,
    start: Path,
    model: Model,
    fit: SetUpFit,
    *,
    threshold_dbfs: float,
    tip: str,
) -> None:
    """Write the model of a set-up: a copy of ``start`` with its own tip, contact
    threshold, boundary and scores."""
    card = model.card
    facts = {
        "from": card.name,
        "score": fit.score,
        "objects": [entry.name for entry in fit.left_out],
    }
    estimates = {
        entry.name: round(entry.after, 3)
        for entry in fit.left_out
        if not math.isnan(entry.after)
    }
    card = replace(
        card,
        name=path.stem,
        gate=Gate(round(threshold_dbfs, 2), card.gate.rule),
        decision=card.decision
        if fit.abstains
        else replace(card.decision, abstain_from=NEVER_ABSTAIN),
        settings=own_tip(card.settings, tip),
        training={**card.training, "set_up": facts},
        scores={"objects left out": estimates},
        licence="; ".join(
            filter(None, (card.licence, "fitted to recordings of the user's own"))
        ),
    )
    graph = onnx.load(str(start))
    write_graph(path, graph if fit.keeps else corrected(graph, fit.correction), card)
