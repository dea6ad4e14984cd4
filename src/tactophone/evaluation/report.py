"""Scores of a detector on one set of recordings: both rules, with intervals, by surface and by recording."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tactophone.evaluation.bootstrap import DRAWS, Estimate, estimate
from tactophone.evaluation.metrics import RULES, Rule, rough_score
from tactophone.evaluation.predictions import TakePredictions, scores_of
from tactophone.evaluation.rendered import Rendered, rendered_scores
from tactophone.evaluation.true_contact import in_true_contact
from tactophone.perception import DecisionRule
from tactophone.types import Touch


@dataclass(frozen=True, slots=True)
class GroupScore:
    """Score of one surface or one recording, over true contact; NaN where there is none."""

    name: str
    label: str
    updates: int
    contact: float
    """`updates` and `contact`: number of updates, and the share of them with the contact gate open."""
    authors: float
    two_class: float
    """`authors` and `two_class`: share of the updates in contact that are classified correctly, by each rule."""


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
    rules: dict[Rule, dict[str, Estimate]]
    """For each rule, each metric of :func:`tactophone.evaluation.measure` with its interval; over true contact,
    whatever the model's gate reports, so that all models are scored on the same windows."""
    by_surface: tuple[GroupScore, ...]
    by_recording: tuple[GroupScore, ...]
    """`by_surface` and `by_recording`: scores of single surfaces and recordings."""

    def as_json(self) -> dict[str, Any]:
        """Return plain dictionaries and lists."""
        return asdict(self)


def make_report(
    predictions: Sequence[TakePredictions], *, decision: DecisionRule | None = None, draws: int = DRAWS
) -> Report:
    """Score the predictions of one model, or of the folds of one recipe, for labelled recordings.

    Raises `DatasetError` if no recording has labelled contact.
    """
    labelled = [take for take in predictions if take.recording.label in (Touch.SMOOTH, Touch.ROUGH)]
    rules = {rule: estimate(scores_of(map(in_true_contact, labelled), rule), draws=draws) for rule in RULES}
    surfaces = sorted({take.recording.surface for take in labelled})
    total = _score("", labelled)
    return Report(
        len(labelled),
        len(surfaces),
        total.updates,
        total.contact,
        rendered_scores(labelled, decision or DecisionRule(), draws=draws),
        rules,
        tuple(_score(name, [take for take in labelled if take.recording.surface == name]) for name in surfaces),
        tuple(_score(take.recording.path.name, [take]) for take in labelled),
    )


def _score(name: str, takes: Sequence[TakePredictions]) -> GroupScore:
    labels = {take.recording.known("label") for take in takes}
    contact = np.concatenate([take.contact for take in takes])
    return GroupScore(
        name,
        labels.pop() if len(labels) == 1 else "mixed",
        len(contact),
        float(contact.mean()) if len(contact) else float("nan"),
        _accuracy(takes, "authors"),
        _accuracy(takes, "two-class"),
    )


def _accuracy(takes: Sequence[TakePredictions], rule: Rule) -> float:
    correct = [
        (rough_score(take.probabilities[take.contact], rule) >= 0.5) == (take.recording.label is Touch.ROUGH)
        for take in map(in_true_contact, takes)
    ]
    every = np.concatenate(correct)
    return float(every.mean()) if len(every) else float("nan")
