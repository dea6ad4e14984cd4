"""All that is said of a detector on one set of recordings: both rules, with intervals, by surface and by recording."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tactophone.evaluation.bootstrap import DRAWS, Estimate, estimate
from tactophone.evaluation.metrics import RULES, Rule, rough_score
from tactophone.evaluation.predictions import TakePredictions, scores_of
from tactophone.types import Touch


@dataclass(frozen=True, slots=True)
class Row:
    """How one surface or recording fared; accuracies are NaN where the gate stayed shut.

    Parameters
    ----------
    name, label
        Which, and what a person calls it.
    updates, contact
        How often it was judged, and the share of updates with the contact gate open.
    authors, two_class
        Share of those updates judged rightly, by each rule.
    """

    name: str
    label: str
    updates: int
    contact: float
    authors: float
    two_class: float


@dataclass(frozen=True, slots=True)
class Report:
    """A detector's scores on some recordings.

    Parameters
    ----------
    recordings, surfaces, updates
        How many were judged.
    contact
        Share of updates with the contact gate open.
    rules
        For each rule, each measure of :func:`tactophone.evaluation.metrics.measure` with its interval.
    by_surface, by_recording
        The same, one by one.
    """

    recordings: int
    surfaces: int
    updates: int
    contact: float
    rules: dict[Rule, dict[str, Estimate]]
    by_surface: tuple[Row, ...]
    by_recording: tuple[Row, ...]

    def as_json(self) -> dict[str, Any]:
        """Give plain dictionaries and lists."""
        return asdict(self)


def make_report(judgements: Sequence[TakePredictions], *, draws: int = DRAWS) -> Report:
    """Score judgements in every way that a report has.

    Raises
    ------
    DatasetError
        If the contact gate was never open.
    """
    judged = [one for one in judgements if one.recording.label in (Touch.SMOOTH, Touch.ROUGH)]
    rules = {rule: estimate(scores_of(judged, rule), draws=draws) for rule in RULES}
    surfaces = sorted({one.recording.surface for one in judged})
    total = _row("", judged)
    return Report(
        len(judged),
        len(surfaces),
        total.updates,
        total.contact,
        rules,
        tuple(_row(name, [one for one in judged if one.recording.surface == name]) for name in surfaces),
        tuple(_row(one.recording.path.name, [one]) for one in judged),
    )


def _row(name: str, judged: Sequence[TakePredictions]) -> Row:
    labels = {one.recording.known("label") for one in judged}
    contact = np.concatenate([one.contact for one in judged])
    return Row(
        name,
        labels.pop() if len(labels) == 1 else "mixed",
        len(contact),
        float(contact.mean()) if len(contact) else float("nan"),
        _accuracy(judged, "authors"),
        _accuracy(judged, "two-class"),
    )


def _accuracy(judged: Sequence[TakePredictions], rule: Rule) -> float:
    right = np.concatenate(
        [
            (rough_score(one.probabilities[one.contact], rule) >= 0.5) == (one.recording.label is Touch.ROUGH)
            for one in judged
        ]
    )
    return float(right.mean()) if len(right) else float("nan")
