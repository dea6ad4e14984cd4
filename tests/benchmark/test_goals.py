import math
from dataclasses import asdict, replace

from benchmarks.goals import goals_of

from tactophone.benchmark import Cost
from tactophone.benchmark.result import MethodResult
from tactophone.evaluation import RENDERED, Estimate, Rendered

NOTHING = Rendered(*[Estimate(math.nan, math.nan, math.nan)] * len(RENDERED))
PAPER = MethodResult(
    method="paper/general", dataset="stones", split="5-fold", control=False, rendered=NOTHING, scores={},
    differences={}, by_surface={},
    curve=(), reliability=(), height_correlation=math.nan, false_positives_at_reference=0.10, bumps_per_minute=50.0,
    calibration_error=0.15, contact_ms=(150.0, 300.0, 0.1), edge_ms=(160.0, 350.0, 0.1),
)  # fmt: skip
TEXTURE = replace(
    PAPER, method="texture", false_positives_at_reference=0.03, calibration_error=0.04, contact_ms=(90.0, 230.0, 0.1),
    edge_ms=(math.nan, math.nan, math.nan),
)  # fmt: skip
COSTS = {
    "paper/general": asdict(Cost(2_000_000, 2_000_000, 160.0)),
    "texture": asdict(Cost(300, 30_000, 170.0)),
}


def test_each_goal_is_met_or_missed_by_so_much() -> None:
    verdicts = {goal.name: goal.verdict for goal in goals_of([asdict(PAPER), asdict(TEXTURE)], COSTS)}
    assert verdicts == {
        "false positives at the paper's rough recall": "met",
        "correct decision after contact, p50 (ms)": "met",
        "correct decision after contact, p95 (ms)": "missed by 50",
        "calibration error": "met",
        "processor time of an update (us)": "missed by 10",
    }


def test_there_are_no_goals_where_either_is_missing() -> None:
    assert goals_of([asdict(PAPER)], COSTS) == []
    assert goals_of([asdict(TEXTURE), asdict(PAPER)], COSTS) == []
