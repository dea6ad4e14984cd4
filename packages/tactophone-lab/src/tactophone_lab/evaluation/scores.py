"""Scores of a detector on one set of recordings: as rendered and of single windows,
with intervals, by surface and take.

What is rendered is what the operator's finger gets: contact gate, abstention and
decision rule inside, over true contact. A moment in which nothing is rendered is a
*gap*, and counts as wrong for either class; so does a rough touch that is rendered as
plain contact, because the sound is unknown or not confirmed yet.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.types import Touch
from tactophone.signal.perception.decision import DecisionRule
from tactophone_lab.evaluation.bootstrap import (
    DRAWS,
    FEWEST_SURFACES,
    Estimate,
    bootstrap,
    estimate,
)
from tactophone_lab.evaluation.bumps_and_delays import (
    decided_touches,
    dips_per_minute,
    false_bumps_per_minute,
)
from tactophone_lab.evaluation.metrics import (
    Floats,
    balanced_accuracy,
    rough_score,
)
from tactophone_lab.evaluation.predict import (
    TakePredictions,
    in_true_contact,
    scores_of,
    true_contact,
)

RENDERED = (
    "balanced_accuracy",
    "rough_as_rough",
    "smooth_as_smooth",
    "smooth_as_rough",
    "wrong",
    "gaps",
)
"""Names of the scores, in the order of tables."""


@dataclass(frozen=True, slots=True)
class Rendered:
    """Shares of true contact, each with its 90 % interval over surfaces."""

    balanced_accuracy: Estimate
    """Mean of the two classes' shares that are rendered as that class."""
    rough_as_rough: Estimate
    smooth_as_smooth: Estimate
    smooth_as_rough: Estimate
    """`rough_as_rough`, `smooth_as_smooth` and `smooth_as_rough`: of the contact with
    rough and with smooth surfaces."""
    wrong: Estimate
    """Rendered as the other class, of all contact: the time that false bumps and missed
    rough last."""
    gaps: Estimate
    """Not rendered at all, of all contact."""


@dataclass(frozen=True, slots=True)
class GroupScore:
    """Score of one surface or one recording, over true contact; NaN where there is
    none."""

    name: str
    label: str
    updates: int
    contact: float
    """`updates` and `contact`: number of updates, and the share of them with the
    contact gate open."""
    right: float
    """Share of true contact that is rendered right."""
    windows_right: float
    """Share of single windows in true contact that are classified correctly."""


@dataclass(frozen=True, slots=True)
class Report:
    """A detector's scores on a set of recordings."""

    recordings: int
    surfaces: int
    updates: int
    """`recordings`, `surfaces` and `updates`: how many were scored."""
    contact: float
    """Share of updates with the model's contact gate open."""
    rendered: Rendered
    """What the operator gets: contact gate, abstention and decision rule inside."""
    false_bumps: float
    dips: float
    """`false_bumps` and `dips`: per minute of smooth and of rough contact, as rendered;
    NaN without any."""
    unknown: float
    unknown_wrong: float
    known_wrong: float
    """`unknown`, `unknown_wrong` and `known_wrong`: see :func:`unknown_shares`."""
    windows: dict[str, Estimate]
    """Each metric of :func:`tactophone_lab.evaluation.metrics.measure` of single
    windows, by the two-class rule, with its interval; over true contact, whatever the
    model's gate reports, so that all models are scored on the same windows."""
    by_surface: tuple[GroupScore, ...]
    by_recording: tuple[GroupScore, ...]
    """`by_surface` and `by_recording`: scores of single surfaces and recordings."""


def rendered_scores(
    predictions: Iterable[TakePredictions], rule: DecisionRule, *, draws: int = DRAWS
) -> Rendered:
    """Score what is rendered by a decision rule; recordings without the label smooth or
    rough are left out.

    Raises `DatasetError` if there is no labelled contact.
    """
    takes = [take for take in predictions if take.recording.labelled]
    # Updates by surface, label (smooth, rough) and what was rendered (none, smooth,
    # rough).
    names = sorted({take.recording.surface for take in takes})
    table = np.zeros((len(names), 2, 3))
    for take in takes:
        rendered = decided_touches(take, rule)[true_contact(take)]
        row = table[names.index(take.recording.surface), int(take.recording.rough)]
        row += np.bincount(rendered, minlength=3)
    if not table.any():
        raise DatasetError(
            "no recording has contact with a surface labelled smooth or rough: "
            "nothing can be scored"
        )
    strata = [np.flatnonzero(table[:, label].any(axis=-1)) for label in (0, 1)]
    few = any(0 < len(stratum) < FEWEST_SURFACES for stratum in strata)
    return Rendered(
        **bootstrap(table, _shares, strata=strata, draws=0 if few else draws)
    )


def _shares(counts: Floats) -> Mapping[str, Floats]:
    """Compute the scores of counts ``(..., 2, 3)``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        by_label = counts / counts.sum(axis=-1, keepdims=True)
        total = counts.sum(axis=(-2, -1))
        wrong = (counts[..., 0, Touch.ROUGH] + counts[..., 1, Touch.SMOOTH]) / total
        gaps = counts[..., Touch.NONE].sum(axis=-1) / total
    smooth = by_label[..., 0, Touch.SMOOTH]
    rough = by_label[..., 1, Touch.ROUGH]
    return {
        # A set of one class has the accuracy of that class.
        "balanced_accuracy": balanced_accuracy(smooth, rough, either=True),
        "rough_as_rough": rough,
        "smooth_as_smooth": smooth,
        "smooth_as_rough": by_label[..., 0, Touch.ROUGH],
        "wrong": wrong,
        "gaps": gaps,
    }


def make_report(
    predictions: Sequence[TakePredictions],
    *,
    decision: DecisionRule | None = None,
    draws: int = DRAWS,
) -> Report:
    """Score the predictions of one model, or of the folds of one recipe, for labelled
    recordings.

    Raises `DatasetError` if no recording has labelled contact.
    """
    own = decision or DecisionRule()
    labelled = [take for take in predictions if take.recording.labelled]
    windows = scores_of(map(in_true_contact, labelled), "two-class")
    opened = np.concatenate([take.contact for take in labelled])
    surfaces = sorted({take.recording.surface for take in labelled})
    return Report(
        len(labelled),
        len(surfaces),
        len(opened),
        float(opened.mean()),
        rendered_scores(labelled, own, draws=draws),
        false_bumps_per_minute(labelled, own),
        dips_per_minute(labelled, own),
        *unknown_shares(labelled),
        estimate(windows, draws=draws),
        tuple(
            _score(
                name,
                [take for take in labelled if take.recording.surface == name],
                own,
            )
            for name in surfaces
        ),
        tuple(_score(take.recording.path.name, [take], own) for take in labelled),
    )


def unknown_shares(takes: Iterable[TakePredictions]) -> tuple[float, float, float]:
    """Return the share of unknown predictions, the error rate among them, and the
    error rate among all others.

    Counts predictions in contact, both true and rendered, and judges what was rendered.
    A share of nothing is NaN, as where no evidence of a touch decided.
    """
    counts = np.zeros((2, 2))  # known and unknown, right and wrong
    for take in takes:
        if take.touch is None or take.unknown is None:
            continue
        here = take.contact & true_contact(take)
        wrong = (take.touch[here] == Touch.ROUGH) != take.recording.rough
        np.add.at(counts, (take.unknown[here].astype(int), wrong.astype(int)), 1)
    with np.errstate(invalid="ignore"):
        known_wrong, unknown_wrong = (counts[:, 1] / counts.sum(axis=1)).tolist()
        return float(counts[1].sum() / counts.sum()), unknown_wrong, known_wrong


def _score(
    name: str, takes: Sequence[TakePredictions], rule: DecisionRule
) -> GroupScore:
    labels = {take.recording.known("label") for take in takes}
    contact = np.concatenate([take.contact for take in takes])
    right = []
    windows_right = []
    for take in takes:
        touching = true_contact(take)
        rendered = decided_touches(take, rule)[touching]
        right.append(
            rendered == (Touch.ROUGH if take.recording.rough else Touch.SMOOTH)
        )
        share = rough_score(take.probabilities[touching], "two-class")
        windows_right.append((share >= 0.5) == take.recording.rough)
    return GroupScore(
        name,
        labels.pop() if len(labels) == 1 else "mixed",
        len(contact),
        _share(contact),
        _share(np.concatenate(right)),
        _share(np.concatenate(windows_right)),
    )


def _share(each: NDArray[np.bool_]) -> float:
    return float(each.mean()) if len(each) else float("nan")
