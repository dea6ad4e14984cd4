"""Scores of what is rendered: contact gate, abstention and decision rule inside, as the operator's finger gets it.

Over true contact, by the labels. A moment in which nothing is rendered is a *gap*, and counts as wrong for either
class; so does a rough touch that is rendered as plain contact, because the sound is unknown or not confirmed yet.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.errors import DatasetError
from tactophone.evaluation.bootstrap import DRAWS, Estimate, draw_surfaces, interval
from tactophone.evaluation.event_metrics import decided_touches
from tactophone.evaluation.predictions import TakePredictions
from tactophone.evaluation.true_contact import true_contact
from tactophone.perception import DecisionRule
from tactophone.types import Touch

Table = NDArray[np.float64]
"""Updates by surface, label (smooth, rough) and what was rendered (none, smooth, rough): ``(surfaces, 2, 3)``."""

RENDERED = ("balanced_accuracy", "rough_as_rough", "smooth_as_smooth", "smooth_as_rough", "wrong", "gaps")
"""Names of the scores, in the order of tables."""


@dataclass(frozen=True, slots=True)
class Rendered:
    """Shares of true contact, each with its 90 % interval over surfaces."""

    balanced_accuracy: Estimate
    """Mean of the two classes' shares that are rendered as that class."""
    rough_as_rough: Estimate
    smooth_as_smooth: Estimate
    smooth_as_rough: Estimate
    """`rough_as_rough`, `smooth_as_smooth` and `smooth_as_rough`: of the contact with rough and with smooth
    surfaces."""
    wrong: Estimate
    """Rendered as the other class, of all contact: the time that false bumps and missed rough last."""
    gaps: Estimate
    """Not rendered at all, of all contact."""


def rendered_scores(
    predictions: Iterable[TakePredictions], rule: DecisionRule, *, draws: int = DRAWS, seed: int = 0
) -> Rendered:
    """Score what is rendered by a decision rule; recordings without the label smooth or rough are left out.

    Raises `DatasetError` if there is no labelled contact.
    """
    takes = [take for take in predictions if take.recording.label in (Touch.SMOOTH, Touch.ROUGH)]
    names = sorted({take.recording.surface for take in takes})
    table = np.zeros((len(names), 2, 3))
    for take in takes:
        rendered = decided_touches(take, rule)[true_contact(take)]
        row = table[names.index(take.recording.surface), int(take.recording.label is Touch.ROUGH)]
        row += np.bincount(rendered, minlength=3)
    if not table.any():
        raise DatasetError("no recording has contact with a surface labelled smooth or rough: nothing can be scored")
    strata = [np.flatnonzero(table[:, label].any(axis=-1)) for label in (0, 1)]
    rng = np.random.default_rng(seed)
    present = [stratum for stratum in strata if len(stratum)]
    times = np.array([draw_surfaces(present, surfaces=len(names), rng=rng) for _ in range(draws)])
    values = _shares(table.sum(axis=0))
    drawn = _shares(np.einsum("ds,slr->dlr", times, table))
    return Rendered(**{name: interval(float(values[name]), drawn[name]) for name in RENDERED})


def _shares(counts: Table) -> Mapping[str, Table]:
    """Compute the scores of counts ``(..., 2, 3)``."""
    with np.errstate(invalid="ignore", divide="ignore"):
        by_label = counts / counts.sum(axis=-1, keepdims=True)
        total = counts.sum(axis=(-2, -1))
        wrong = (counts[..., 0, Touch.ROUGH] + counts[..., 1, Touch.SMOOTH]) / total
        gaps = counts[..., Touch.NONE].sum(axis=-1) / total
    smooth, rough = by_label[..., 0, Touch.SMOOTH], by_label[..., 1, Touch.ROUGH]
    return {
        # Over the classes that are there: a set of one class has the accuracy of that class.
        "balanced_accuracy": np.asarray(np.nanmean(np.stack([smooth, rough]), axis=0)),
        "rough_as_rough": rough,
        "smooth_as_smooth": smooth,
        "smooth_as_rough": by_label[..., 0, Touch.ROUGH],
        "wrong": wrong,
        "gaps": gaps,
    }
