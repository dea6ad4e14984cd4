from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Recording
from tactophone.core.types import Touch
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.evidence import TouchEvidence
from tactophone_lab.evaluation.decision_rules import (
    candidate_rules,
    choose_left_out,
    choose_rule,
    draw_trade_off,
    measure_rule,
    rates,
    try_rules,
)
from tactophone_lab.evaluation.predict import TakePredictions

HOP = 512 / 48_000


def predicted(
    label: Touch, *, surface: str, seed: int, mean: float, size: int = 600
) -> TakePredictions:
    """Predictions that wander about a mean, in touches of random length."""
    rng = np.random.default_rng(seed)
    wander = np.convolve(
        rng.normal(0, 1, size + 20), np.ones(20) / np.sqrt(20), "valid"
    )[:size]
    share = 1 / (1 + np.exp(-(mean + 2 * wander)))
    contact = np.repeat(rng.random(size // 20) < 0.8, 20)
    # One update in ten is of unknown sound, for rules that abstain.
    none = np.where(rng.random(size) < 0.1, 0.6, 0.0)
    rows = np.stack(
        [none, (1 - none) * (1 - share), (1 - none) * share], axis=1
    ).astype(np.float32)
    recording = Recording(Path(f"{surface}{seed}.wav"), surface, label)
    return TakePredictions(recording, 0.256 + HOP * np.arange(size), rows, contact)


def predictions() -> list[TakePredictions]:
    return [
        predicted(
            label,
            surface=f"{label.name}{surface}",
            seed=10 * surface + label,
            mean=mean,
        )
        for label, mean in ((Touch.SMOOTH, -1.5), (Touch.ROUGH, 2.0))
        for surface in range(4)
    ]


RULES = (
    DecisionRule(),
    DecisionRule(0.6, 0.3),
    DecisionRule(0.9, 0.8),
    DecisionRule(abstain_from=0.3),
)


def test_rules_side_by_side_decide_as_the_live_decision_does() -> None:
    for take in predictions():
        outcomes = try_rules([take, predictions()[0], predictions()[-1]], RULES)
        for place, rule in enumerate(RULES):
            live = TouchEvidence(rule)
            rough = []
            for now, row, contact in zip(
                take.time, take.probabilities, take.contact, strict=True
            ):
                if contact:
                    live.hear(tuple(map(float, row)), now)
                rough.append(bool(contact) and live.is_rough(now))
            bumps = sum(
                now and not before
                for before, now in zip([False, *rough], rough, strict=False)
            )
            assert (outcomes.rough[0, place], outcomes.bumps[0, place]) == (
                sum(rough),
                bumps,
            )


def test_candidates_abstain_as_the_model_does() -> None:
    own = DecisionRule(0.6, 0.4, 4, 0.5)
    assert candidate_rules(own)[0] == own
    assert {rule.confirm for rule in candidate_rules(own)[1:]} == {1}
    assert {rule.abstain_from for rule in candidate_rules(own)} == {0.5}


def test_the_limit_is_kept_and_no_allowed_rule_has_more_recall() -> None:
    rules = candidate_rules(DecisionRule())
    outcomes = try_rules(predictions(), rules)
    table = rates(outcomes)
    for goal, limit in (("false_bumps_per_minute", 5.0), ("false_positive_rate", 0.02)):
        place = choose_rule(outcomes, rules, goal=goal, limit=limit)
        assert table[goal][place] <= limit
        allowed = (table[goal] <= limit) & (
            table["false_positive_rate"] <= table["false_positive_rate"][0]
        )
        assert (
            table["rough_recall"][place] >= table["rough_recall"][allowed].max() - 1e-3
        )


def test_bumps_are_not_avoided_by_staying_rough() -> None:
    rules = (
        DecisionRule(0.3, 0.3),
        DecisionRule(1e-4, 1e-4),
        DecisionRule(0.9, 0.8),
    )
    outcomes = try_rules(predictions(), rules)
    table = rates(outcomes)
    assert table["false_bumps_per_minute"][1] < table["false_bumps_per_minute"][0]
    assert table["rough_recall"][1] > table["rough_recall"][2]
    limit = float(table["false_bumps_per_minute"][1:].max())
    assert choose_rule(outcomes, rules, goal="false_bumps_per_minute", limit=limit) == 2
    assert choose_rule(outcomes, rules, goal="false_positive_rate", limit=1.0) == 1


def test_a_lower_limit_never_increases_recall() -> None:
    rules = candidate_rules(DecisionRule())
    outcomes = try_rules(predictions(), rules)
    recall = [
        rates(outcomes)["rough_recall"][
            choose_rule(outcomes, rules, goal="false_bumps_per_minute", limit=limit)
        ]
        for limit in (0.5, 5.0, 50.0)
    ]
    assert recall == sorted(recall)


def test_a_point_has_intervals_a_delay_and_json() -> None:
    outcomes = try_rules(predictions(), RULES)
    point = measure_rule(outcomes, 0, RULES[0])
    assert (
        point.false_bumps_per_minute.low
        <= point.false_bumps_per_minute.value
        <= point.false_bumps_per_minute.high
    )
    assert 0 <= point.delay < 1
    slower = measure_rule(outcomes, 2, RULES[2])
    assert slower.delay > point.delay
    assert set(point.as_json()) == {
        "false_bumps_per_minute",
        "false_positive_rate",
        "rough_recall",
        "delay",
    }


def test_objects_left_out_of_the_choice_have_the_rule_of_the_others() -> None:
    takes = predictions()
    # The one smooth object that needs another rule than the rest.
    odd = predicted(Touch.SMOOTH, surface="odd", seed=99, mean=1.5)
    rules = candidate_rules(DecisionRule())
    goal, limit = "false_positive_rate", 0.05
    outcomes = try_rules([*takes, odd], rules)
    left_out = choose_left_out(outcomes, rules, goal=goal, limit=limit)
    # The rest chooses a threshold under which the odd object would be rough.
    assert (
        left_out[-1].rough_on
        < rules[choose_rule(outcomes, rules, goal=goal, limit=limit)].rough_on
    )
    assert len(left_out) == 9
    assert (
        choose_left_out(
            try_rules([takes[0], *takes[4:]], rules), rules, goal=goal, limit=limit
        )
        == []
    )


def test_impossible_goals_are_named() -> None:
    sure = [
        predicted(label, surface=label.name, seed=1, mean=20.0)
        for label in (Touch.SMOOTH, Touch.ROUGH)
    ]
    with pytest.raises(
        DatasetError,
        match=r"no rule keeps .* the lowest is 0.994: allow more, or check",
    ):
        choose_rule(
            try_rules(sure, RULES), RULES, goal="false_positive_rate", limit=0.01
        )
    with pytest.raises(DatasetError, match="no rough recording"):
        try_rules(predictions()[:4], RULES)


def test_the_trade_off_is_drawn(tmp_path: Path) -> None:
    rules = candidate_rules(DecisionRule())
    outcomes = try_rules(predictions(), rules)
    points = [measure_rule(outcomes, place, rules[place]) for place in (0, 40)]
    goal = ("false_bumps_per_minute", 2.0)
    draw_trade_off(
        tmp_path / "p.png",
        outcomes,
        rules,
        chosen=points[1],
        before=points[0],
        limit=goal,
    )
    assert (tmp_path / "p.png").stat().st_size > 10_000
