"""Choosing when to believe *rough*: thresholds, hysteresis and confirmation for a wanted rate of false bumps.

A false bump is a belief that turns rough while a smooth surface is touched: one wrong window is one bump at the
operator's finger (the paper's section V). Every candidate rule runs over the same judgements as the live decision would
(:mod:`tactophone.perception.decision`), all of them side by side; of those that keep the wanted rate, the one that
finds most of the rough is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.errors import DatasetError
from tactophone.evaluation.bootstrap import Estimate, interval
from tactophone.evaluation.metrics import rough_score
from tactophone.evaluation.predictions import TakePredictions
from tactophone.offline.plots import BLUE, GREEN, GREY, ORANGE, VERMILION, load_pyplot
from tactophone.perception import DecisionRule
from tactophone.types import Touch

Goal = Literal["false_bumps_per_minute", "false_positive_rate"]

SHARES = 64
"""Thresholds tried, evenly spaced in log-odds: that is how a network's confidence spreads."""

WIDEST_LOGIT = 9.0
HYSTERESIS_LOGITS = (0.0, 1.0, 2.0, 4.0)
CONFIRMATIONS = (1, 2, 4, 8)
"""Updates in a row: at a hop of 10.7 ms the last one costs 75 ms before a rough surface is felt as such."""

DRAWS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """What each candidate did, per recording; arrays are ``(recordings, candidates)``.

    Parameters
    ----------
    minutes
        Of contact in each recording, ``(recordings,)``.
    updates
        In contact, ``(recordings,)``.
    rough
        Updates believed rough.
    bumps
        Times that the belief turned rough.
    delay
        Mean time in s from a touch's beginning to the first rough belief in it; NaN where there was none.
    """

    recordings: tuple[Recording, ...]
    minutes: NDArray[np.float64]
    updates: NDArray[np.float64]
    rough: NDArray[np.float64]
    bumps: NDArray[np.float64]
    delay: NDArray[np.float64]

    @property
    def is_rough(self) -> NDArray[np.bool_]:
        """Which recordings are of a rough surface."""
        return np.array([one.label is Touch.ROUGH for one in self.recordings])


@dataclass(frozen=True, slots=True)
class Point:
    """How a rule does: false bumps a minute and share of false updates on smooth, share of rough found, delay in s."""

    rule: DecisionRule
    false_bumps_per_minute: Estimate
    false_positive_rate: Estimate
    rough_recall: Estimate
    delay: float

    def as_json(self) -> dict[str, Any]:
        """Give plain numbers, for a model's card."""
        told = {name: getattr(self, name) for name in ("false_bumps_per_minute", "false_positive_rate", "rough_recall")}
        numbers = {name: [round(float(one), 4) for one in (e.value, e.low, e.high)] for name, e in told.items()}
        return {**numbers, "delay": None if np.isnan(self.delay) else round(self.delay, 3)}


def candidates() -> tuple[DecisionRule, ...]:
    """List the rules tried, the paper's first."""
    logits = np.linspace(-WIDEST_LOGIT, WIDEST_LOGIT, SHARES)
    return (
        DecisionRule(),
        *(
            DecisionRule(_share(on), _share(on - hysteresis), confirm)
            for confirm in CONFIRMATIONS
            for hysteresis in HYSTERESIS_LOGITS
            for on in logits
        ),
    )


def try_rules(judgements: Sequence[TakePredictions], rules: Sequence[DecisionRule]) -> Outcome:
    """Run every rule over the labelled judgements.

    Raises
    ------
    DatasetError
        If smooth or rough was never in contact: then there is nothing to choose by.
    """
    judged = [one for one in judgements if one.recording.label in (Touch.SMOOTH, Touch.ROUGH) and one.contact.any()]
    for touch in (Touch.SMOOTH, Touch.ROUGH):
        if not any(one.recording.label is touch for one in judged):
            raise DatasetError(f"no {touch.name.lower()} recording with contact: validation wants both kinds")
    runs = [_run(one, rules) for one in judged]
    minutes, updates, rough, bumps, delay = (np.array(column) for column in zip(*runs, strict=True))
    return Outcome(tuple(one.recording for one in judged), minutes, updates, rough, bumps, delay)


def choose(outcome: Outcome, rules: Sequence[DecisionRule], *, goal: Goal, limit: float) -> int:
    """Give the place of the rule that finds most of the rough within the limit; the quickest of those alike.

    Raises
    ------
    DatasetError
        If no rule keeps the limit.
    """
    table = curve(outcome)
    allowed = np.flatnonzero(table[goal] <= limit)
    if not len(allowed):
        lowest = float(np.min(table[goal]))
        raise DatasetError(f"no rule keeps {goal.replace('_', ' ')} under {limit:g}; the lowest is {lowest:.3g}")
    recall = np.round(table["rough_recall"][allowed], 3)
    best = allowed[recall == recall.max()]
    return int(min(best, key=lambda place: (rules[place].confirm, rules[place].rough_on - rules[place].rough_off)))


def curve(outcome: Outcome, times: NDArray[np.float64] | None = None) -> dict[str, NDArray[np.float64]]:
    """Measure every rule; ``times`` says how often each recording counts, once by default."""
    weight = np.ones(len(outcome.recordings)) if times is None else times
    smooth, rough = weight * ~outcome.is_rough, weight * outcome.is_rough
    with np.errstate(invalid="ignore", divide="ignore"):
        return {
            "false_bumps_per_minute": smooth @ outcome.bumps / (smooth @ outcome.minutes),
            "false_positive_rate": smooth @ outcome.rough / (smooth @ outcome.updates),
            "rough_recall": rough @ outcome.rough / (rough @ outcome.updates),
        }


def describe(outcome: Outcome, place: int, rule: DecisionRule, *, seed: int = 0) -> Point:
    """Measure one rule, each figure with its interval by drawing surfaces anew."""
    one = Outcome(
        outcome.recordings, outcome.minutes, outcome.updates,
        *(array[:, place : place + 1] for array in (outcome.rough, outcome.bumps, outcome.delay)),
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    drawn = [curve(one, _draw(one, rng)) for _ in range(DRAWS)]
    told = {name: interval(float(value[0]), [draw[name][0] for draw in drawn]) for name, value in curve(one).items()}
    delays = one.delay[one.is_rough, 0]
    delay = float(np.nanmedian(delays)) if not np.isnan(delays).all() else float("nan")
    return Point(rule, **told, delay=delay)


def draw_trade_off(
    path: Path,
    outcome: Outcome,
    rules: Sequence[DecisionRule],
    *,
    chosen: Point,
    before: Point,
    limit: tuple[Goal, float],
) -> None:
    """Draw what more caution costs: rough found against false bumps, a line each number of confirmations."""
    pyplot = load_pyplot()
    goal, value = limit
    table = curve(outcome)
    figure, axes = pyplot.subplots(figsize=(7.5, 4.6), layout="constrained", dpi=130)
    for confirm, colour in zip(CONFIRMATIONS, (BLUE, ORANGE, GREEN, GREY), strict=True):
        places = [n for n, rule in enumerate(rules) if rule.confirm == confirm]
        x, y = _frontier(table[goal][places], table["rough_recall"][places])
        axes.plot(x.clip(_least(goal)), y, color=colour, label=f"{confirm} in a row", drawstyle="steps-post")
    axes.axvline(value, color=VERMILION, linestyle=":", label="wanted at most")
    for point, marker, words in ((before, "o", "the paper's rule"), (chosen, "*", "chosen")):
        estimate: Estimate = getattr(point, goal)
        axes.plot(
            max(estimate.value, _least(goal)),
            point.rough_recall.value,
            marker,
            color="black",
            markersize=11,
            label=words,
            linestyle="none",
        )
    axes.set_xscale("log")
    unit = (
        "false bumps a minute of smooth contact" if goal == "false_bumps_per_minute" else "share of smooth called rough"
    )
    axes.set(xlabel=unit, ylabel="share of rough contact found", ylim=(0, 1.02))
    axes.legend(loc="lower right", frameon=False)
    axes.grid(alpha=0.3)
    figure.savefig(path)
    pyplot.close(figure)


def _least(goal: Goal) -> float:
    """Where none at all is drawn on a logarithmic axis."""
    return 0.05 if goal == "false_bumps_per_minute" else 1e-4


def _frontier(cost: NDArray[np.float64], gain: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The best gain at or under each cost."""
    order = np.argsort(cost, kind="stable")
    return cost[order], np.maximum.accumulate(gain[order])


def _share(logit: float) -> float:
    return float(1 / (1 + np.exp(-logit)))


def _run(one: TakePredictions, rules: Sequence[DecisionRule]) -> tuple[Any, ...]:
    """Decide over a recording by all rules at once; the same steps as :class:`tactophone.perception.Decision`."""
    on, off, confirm = (
        np.array([getattr(rule, name) for rule in rules]) for name in ("rough_on", "rough_off", "confirm")
    )
    share = rough_score(one.probabilities, "two-class")
    believed, streak = np.zeros(len(rules), bool), np.zeros(len(rules), int)
    rough, bumps = np.zeros(len(rules)), np.zeros(len(rules))
    waits: list[NDArray[np.float64]] = []
    waited, since = np.full(len(rules), np.nan), 0.0
    touching = False
    for now, contact, value in zip(one.time, one.contact, share, strict=True):
        if contact and not touching:
            waits.append(waited)
            waited, since = np.full(len(rules), np.nan), now
        touching = bool(contact)
        streak = np.where(value >= on, streak + 1, 0)
        held = (value >= np.where(believed, off, on)) & (believed | (streak >= confirm)) & touching
        bumps += held & ~believed
        waited = np.where(held & np.isnan(waited), now - since, waited)
        believed = held
        rough += held
    waits.append(waited)
    with np.errstate(invalid="ignore"):
        known = np.array(waits[1:])
        counted = (~np.isnan(known)).sum(axis=0)
        delay = np.where(counted > 0, np.nansum(known, axis=0) / np.maximum(counted, 1), np.nan)
    hop = float(np.median(np.diff(one.time))) if len(one.time) > 1 else 0.0
    updates = int(one.contact.sum())
    return updates * hop / 60, updates, rough, bumps, delay


def _draw(outcome: Outcome, rng: np.random.Generator) -> NDArray[np.float64]:
    """How often each recording counts when surfaces are drawn anew, rough and smooth ones apart."""
    surfaces = np.array([one.surface for one in outcome.recordings])
    times = np.zeros(len(surfaces))
    for rough in (False, True):
        present = np.unique(surfaces[outcome.is_rough == rough])
        for name in rng.choice(present, len(present)):
            times += (surfaces == name) & (outcome.is_rough == rough)
    return times
