from pathlib import Path

import numpy as np
import pytest

from tactophone.dataset import Recording
from tactophone.errors import DatasetError
from tactophone.evaluation.operating_point import candidates, choose, curve, describe, draw_trade_off, try_rules
from tactophone.evaluation.predictions import TakePredictions
from tactophone.perception import Decision, DecisionRule
from tactophone.types import Touch

HOP = 512 / 48_000


def predict_take(label: Touch, *, surface: str, seed: int, mean: float, size: int = 600) -> TakePredictions:
    """Beliefs that wander about a mean, in touches of random length."""
    rng = np.random.default_rng(seed)
    wander = np.convolve(rng.normal(0, 1, size + 20), np.ones(20) / np.sqrt(20), "valid")[:size]
    share = 1 / (1 + np.exp(-(mean + 2 * wander)))
    contact = np.repeat(rng.random(size // 20) < 0.8, 20)
    rows = np.stack([np.zeros(size), 1 - share, share], axis=1).astype(np.float32)
    recording = Recording(Path(f"{surface}{seed}.wav"), surface, label)
    return TakePredictions(recording, 0.256 + HOP * np.arange(size), rows, contact)


def judgements() -> list[TakePredictions]:
    return [
        predict_take(label, surface=f"{label.name}{surface}", seed=10 * surface + label, mean=mean)
        for label, mean in ((Touch.SMOOTH, -1.5), (Touch.ROUGH, 2.0))
        for surface in range(4)
    ]


RULES = (DecisionRule(), DecisionRule(0.9, 0.6, 1), DecisionRule(0.7, 0.2, 4))


def test_rules_side_by_side_decide_as_the_live_decision_does() -> None:
    for one in judgements():
        outcome = try_rules([one, judgements()[0], judgements()[-1]], RULES)
        for place, rule in enumerate(RULES):
            live = Decision(rule)
            rough = [
                live.decide(tuple(map(float, row)), contact=bool(contact))[0] is Touch.ROUGH
                for row, contact in zip(one.probabilities, one.contact, strict=True)
            ]
            bumps = sum(now and not before for before, now in zip([False, *rough], rough, strict=False))
            assert (outcome.rough[0, place], outcome.bumps[0, place]) == (sum(rough), bumps)


def test_the_goal_is_kept_and_no_allowed_rule_finds_more() -> None:
    rules = candidates()
    outcome = try_rules(judgements(), rules)
    table = curve(outcome)
    for goal, limit in (("false_bumps_per_minute", 5.0), ("false_positive_rate", 0.02)):
        place = choose(outcome, rules, goal=goal, limit=limit)
        assert table[goal][place] <= limit
        allowed = table[goal] <= limit
        assert table["rough_recall"][place] >= table["rough_recall"][allowed].max() - 1e-3


def test_more_caution_never_finds_more() -> None:
    rules = candidates()
    outcome = try_rules(judgements(), rules)
    found = [curve(outcome)["rough_recall"][choose(outcome, rules, goal="false_bumps_per_minute", limit=limit)]
             for limit in (0.5, 5.0, 50.0)]  # fmt: skip
    assert found == sorted(found)


def test_a_point_has_intervals_a_delay_and_json() -> None:
    outcome = try_rules(judgements(), RULES)
    point = describe(outcome, 0, RULES[0])
    assert point.false_bumps_per_minute.low <= point.false_bumps_per_minute.value <= point.false_bumps_per_minute.high
    assert 0 <= point.delay < 1
    slower = describe(outcome, 2, RULES[2])
    assert slower.delay > point.delay
    assert set(point.as_json()) == {"false_bumps_per_minute", "false_positive_rate", "rough_recall", "delay"}


def test_what_cannot_be_had_is_named() -> None:
    sure = [predict_take(label, surface=label.name, seed=1, mean=20.0) for label in (Touch.SMOOTH, Touch.ROUGH)]
    with pytest.raises(DatasetError, match="no rule keeps"):
        choose(try_rules(sure, RULES), RULES, goal="false_positive_rate", limit=0.01)
    with pytest.raises(DatasetError, match="no rough recording"):
        try_rules(judgements()[:4], RULES)


def test_the_trade_off_is_drawn(tmp_path: Path) -> None:
    rules = candidates()
    outcome = try_rules(judgements(), rules)
    points = [describe(outcome, place, rules[place]) for place in (0, 40)]
    goal = ("false_bumps_per_minute", 2.0)
    draw_trade_off(tmp_path / "p.png", outcome, rules, chosen=points[1], before=points[0], limit=goal)
    assert (tmp_path / "p.png").stat().st_size > 10_000
