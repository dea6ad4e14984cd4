"""Choice of a decision rule's threshold for a wanted rate of false bumps.

A false bump is a decision that turns rough while a smooth surface is touched: one false
window is one bump at the operator's finger (the paper's section V). Every candidate
rule runs over the same predictions as the live evidence does
(:mod:`signal.perception.evidence`), all rules side by side; of the rules that keep the
wanted rate, the one with the highest rough recall is chosen. The best of many on a few
objects is partly luck: so each object can be left out of the choice in turn, to be
scored by the rule that the others choose.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactophone.app.figures import (
    BLUE,
    VERMILION,
    load_pyplot,
    save_figure,
)
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Recording
from tactophone.core.types import SURFACE_LABELS, Touch
from tactophone.signal.perception.decision import DecisionRule, share_of
from tactophone.signal.perception.evidence import (
    CAUTION,
    GREATEST_STEP,
    LEAST,
    MOST,
    ROUGH_FROM,
)
from tactophone.signal.silences import LIFT
from tactophone_lab.evaluation.bootstrap import Estimate, bootstrap
from tactophone_lab.evaluation.metrics import Floats, log_odds
from tactophone_lab.evaluation.predict import TakePredictions

Goal = Literal["false_bumps_per_minute", "false_positive_rate"]

THRESHOLDS = 64
"""Thresholds tried, evenly spaced in log-odds, as a network's confidence spreads."""

WIDEST_LOGIT = 9.0
"""Thresholds are tried from minus to plus this many log-odds: 1 in 8100 either way."""


@dataclass(frozen=True, slots=True, eq=False)
class RuleOutcomes:
    """Outcome of each candidate rule on each recording; arrays have shape
    ``(recordings, rules)``."""

    recordings: tuple[Recording, ...]
    """Labelled recordings with contact."""
    minutes: NDArray[np.float64]
    """Of contact in each recording, shape ``(recordings,)``."""
    updates: NDArray[np.float64]
    """In contact, shape ``(recordings,)``."""
    rough: NDArray[np.float64]
    """Updates decided as rough."""
    bumps: NDArray[np.float64]
    """How often the decision turns rough."""
    delay: NDArray[np.float64]
    """Mean time in s from a touch's beginning to its first rough decision; NaN where
    no decision is rough."""

    @property
    def is_rough(self) -> NDArray[np.bool_]:
        return np.array([recording.rough for recording in self.recordings])


@dataclass(frozen=True, slots=True)
class OperatingPoint:
    """A decision rule with its rates."""

    rule: DecisionRule
    false_bumps_per_minute: Estimate
    """Decisions that turn rough, per minute of contact with smooth surfaces."""
    false_positive_rate: Estimate
    rough_recall: Estimate
    """`false_positive_rate` and `rough_recall`: share of updates in contact decided as
    rough, of smooth and of rough surfaces."""
    delay: float
    """Median over rough recordings of the time from touch to rough decision, in s; NaN
    if no rough decision was made."""

    def as_json(self) -> dict[str, Any]:
        """Return plain numbers, for a model card: each rate as value, low, high."""
        names = ("false_bumps_per_minute", "false_positive_rate", "rough_recall")
        numbers = {name: getattr(self, name).rounded(4) for name in names}
        return {
            **numbers,
            "delay": None if np.isnan(self.delay) else round(self.delay, 3),
        }


def candidate_rules(own: DecisionRule) -> tuple[DecisionRule, ...]:
    """List the rules to try, the model's own first; each abstains as that does.

    What counts of a rule is its reference, so the others have one threshold each.
    """
    return (
        own,
        *(
            DecisionRule(threshold, threshold, 1, own.abstain_from)
            for threshold in map(
                share_of, np.linspace(-WIDEST_LOGIT, WIDEST_LOGIT, THRESHOLDS).tolist()
            )
        ),
    )


def try_rules(
    predictions: Sequence[TakePredictions], rules: Sequence[DecisionRule]
) -> RuleOutcomes:
    """Run every rule over the predictions for labelled recordings.

    Raises `DatasetError` if there is no contact on smooth or on rough surfaces.
    """
    takes = [
        take for take in predictions if take.recording.labelled and take.contact.any()
    ]
    for touch in SURFACE_LABELS:
        if not any(take.recording.label is touch for take in takes):
            raise DatasetError(
                f"no {touch.name.lower()} recording with contact: validation needs "
                "both classes"
            )
    runs = [_run(take, rules) for take in takes]
    minutes, updates, rough, bumps, delay = (
        np.array(column) for column in zip(*runs, strict=True)
    )
    return RuleOutcomes(
        tuple(take.recording for take in takes), minutes, updates, rough, bumps, delay
    )


def choose_rule(
    outcomes: RuleOutcomes,
    rules: Sequence[DecisionRule],
    *,
    goal: Goal,
    limit: float,
    weights: Floats | None = None,
) -> int:
    """Return the index of the rule with the highest rough recall within the limit; of
    equal ones, the threshold nearest to even odds.

    A limit of false bumps also excludes rules under which smooth is rough for longer
    than under the first: a touch that stays rough once it has been has few bumps.
    ``weights`` as in :func:`rates`. Raises `DatasetError` if no rule keeps the limit.
    """
    table = rates(outcomes, weights)
    smooth_as_rough = table["false_positive_rate"]
    longest = smooth_as_rough[0] if goal == "false_bumps_per_minute" else np.inf
    allowed = np.flatnonzero((table[goal] <= limit) & (smooth_as_rough <= longest))
    if not len(allowed):
        lowest = float(np.min(table[goal][smooth_as_rough <= longest]))
        words = (
            f"no rule keeps {goal.replace('_', ' ')} under {limit:g}; the lowest "
            f"is {lowest:.3g}"
        )
        raise DatasetError(
            f"{words}: allow more, or check labels and tip with `tactophone evaluate`"
        )
    recall = np.round(table["rough_recall"][allowed], 3)
    best = allowed[recall == recall.max()]
    return int(
        min(
            best,
            key=lambda place: abs(rules[place].reference),
        )
    )


def rates(outcomes: RuleOutcomes, weights: Floats | None = None) -> dict[str, Floats]:
    """Compute the rates of every rule, each of shape ``(..., rules)``; see
    :class:`OperatingPoint`.

    ``weights``, shape ``(..., recordings)``, says how often each recording counts, once
    by default.
    """
    every = np.ones(len(outcomes.recordings)) if weights is None else weights
    smooth = every * ~outcomes.is_rough
    rough = every * outcomes.is_rough
    with np.errstate(invalid="ignore", divide="ignore"):
        return {
            "false_bumps_per_minute": smooth
            @ outcomes.bumps
            / (smooth @ outcomes.minutes)[..., None],
            "false_positive_rate": smooth
            @ outcomes.rough
            / (smooth @ outcomes.updates)[..., None],
            "rough_recall": rough
            @ outcomes.rough
            / (rough @ outcomes.updates)[..., None],
        }


def choose_left_out(
    outcomes: RuleOutcomes, rules: Sequence[DecisionRule], *, goal: Goal, limit: float
) -> list[DecisionRule]:
    """Choose a rule for each recording without its surface: the first, where none keeps
    the limit on the others.

    Returns no rules where a class has one surface.
    """
    surfaces = np.array([recording.surface for recording in outcomes.recordings])
    chosen = []
    for others in (surfaces != name for name in surfaces):
        if len(set(outcomes.is_rough[others])) < 2:
            return []
        place = 0
        with suppress(DatasetError):
            place = choose_rule(
                outcomes, rules, goal=goal, limit=limit, weights=others.astype(float)
            )
        chosen.append(rules[place])
    return chosen


def measure_rule(
    outcomes: RuleOutcomes, place: int, rule: DecisionRule
) -> OperatingPoint:
    """Compute the rates of one rule, each with its 90 % interval over draws of the
    surfaces."""
    keys = [(take.rough, take.surface) for take in outcomes.recordings]
    rows = sorted(set(keys))
    # Each row marks the recordings of one surface, so the sum of the drawn rows is how
    # often each recording counts.
    table = np.array([[float(key == row) for key in keys] for row in rows])
    estimates = bootstrap(
        table,
        lambda weights: {
            name: rate[..., place] for name, rate in rates(outcomes, weights).items()
        },
        strata=[
            np.array([n for n, row in enumerate(rows) if row[0] == rough], np.intp)
            for rough in (False, True)
        ],
    )
    delays = outcomes.delay[outcomes.is_rough, place]
    delay = float(np.nanmedian(delays)) if not np.isnan(delays).all() else float("nan")
    return OperatingPoint(rule, **estimates, delay=delay)


def draw_trade_off(
    path: Path,
    outcomes: RuleOutcomes,
    rules: Sequence[DecisionRule],
    *,
    chosen: OperatingPoint,
    before: OperatingPoint,
    limit: tuple[Goal, float],
) -> None:
    """Draw rough recall over false bumps as PNG."""
    pyplot = load_pyplot()
    goal, value = limit
    table = rates(outcomes)
    # Zero has no place on a logarithmic axis.
    least = 0.05 if goal == "false_bumps_per_minute" else 1e-4
    figure, axes = pyplot.subplots(figsize=(7.5, 4.6), layout="constrained", dpi=130)
    # The best recall at or under each cost.
    order = np.argsort(table[goal], kind="stable")
    axes.plot(
        table[goal][order].clip(least),
        np.maximum.accumulate(table["rough_recall"][order]),
        color=BLUE,
        label="thresholds",
        drawstyle="steps-post",
    )
    axes.axvline(value, color=VERMILION, linestyle=":", label="limit")
    for point, marker, label in ((before, "o", "before"), (chosen, "*", "chosen")):
        x = max(getattr(point, goal).value, least)
        y = point.rough_recall.value
        axes.plot(
            x, y, marker, color="black", markersize=11, label=label, linestyle="none"
        )
    axes.set_xscale("log")
    per_minute = goal == "false_bumps_per_minute"
    axes.set(
        xlabel="false bumps per minute of smooth contact"
        if per_minute
        else "share of smooth classified as rough"
    )
    axes.set(ylabel="share of rough contact found", ylim=(0, 1.02))
    axes.legend(loc="lower left", frameon=False)
    axes.grid(alpha=0.3)
    save_figure(figure, path)


def _run(take: TakePredictions, rules: Sequence[DecisionRule]) -> tuple[Any, ...]:
    """Decide over a recording by all rules at once.

    Beware: these are the steps of
    :class:`~signal.perception.evidence.TouchEvidence` written again, for arrays of
    rules. A change there belongs here too; a test holds them equal.
    """
    reference = np.array([rule.reference + CAUTION for rule in rules])
    abstain = np.array([rule.abstain_from for rule in rules])
    unknown = take.probabilities[:, Touch.NONE].astype(np.float64)
    evidence = np.full(len(rules), LEAST)
    verdict = np.zeros(len(rules), bool)
    was_rough = np.zeros(len(rules), bool)
    rough = np.zeros(len(rules))
    bumps = np.zeros(len(rules))
    delays: list[NDArray[np.float64]] = []
    delay = np.full(len(rules), np.nan)
    heard_at = -np.inf
    start = 0.0
    touching = False
    for now, contact, odds, none in zip(
        take.time,
        take.contact,
        log_odds(take.probabilities),
        unknown,
        strict=True,
    ):
        if contact and not touching:
            # A new touch: keep the last one's delays (the first entry belongs to no
            # touch) and count from here.
            delays.append(delay)
            delay = np.full(len(rules), np.nan)
            start = now
        touching = bool(contact)
        if touching:
            if now - heard_at > LIFT:
                evidence[:] = LEAST
                verdict[:] = False
            heard_at = now
            step = np.clip(odds - reference, -GREATEST_STEP, GREATEST_STEP)
            known = none < abstain
            evidence = np.where(known, np.clip(evidence + step, LEAST, MOST), evidence)
            verdict = np.where(known & (evidence >= ROUGH_FROM), True, verdict)
            verdict = np.where(known & (evidence <= LEAST), False, verdict)
        is_rough = verdict & touching
        bumps += is_rough & ~was_rough
        delay = np.where(is_rough & np.isnan(delay), now - start, delay)
        was_rough = is_rough
        rough += is_rough
    known_delays = np.array([*delays, delay][1:])
    counted = (~np.isnan(known_delays)).sum(axis=0)
    mean_delay = np.where(
        counted > 0, np.nansum(known_delays, axis=0) / np.maximum(counted, 1), np.nan
    )
    hop = float(np.median(np.diff(take.time))) if len(take.time) > 1 else 0.0
    updates = int(take.contact.sum())
    return updates * hop / 60, updates, rough, bumps, mean_delay
