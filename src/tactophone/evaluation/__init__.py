"""Metrics, intervals, event metrics and reports: every number with its definition."""

from tactophone.evaluation.bootstrap import Estimate, estimate, interval
from tactophone.evaluation.event_metrics import (
    Delays,
    calibration_error,
    contact_delays,
    edge_delays,
    false_bumps_per_minute,
)
from tactophone.evaluation.metrics import RULES, Rule, Scores, false_positives_at_recall, measure, rough_score
from tactophone.evaluation.model_comparison import Change, accuracy_of, by_surface, by_take, compare_models
from tactophone.evaluation.operating_point import (
    Goal,
    OperatingPoint,
    candidate_rules,
    choose_rule,
    draw_trade_off,
    measure_rule,
    try_rules,
)
from tactophone.evaluation.paired import Difference, correct_for_number, paired_difference
from tactophone.evaluation.predictions import (
    Predictor,
    TakePredictions,
    model_predictor,
    scores_of,
    streaming_predictor,
)
from tactophone.evaluation.rendered import RENDERED, Rendered, rendered_scores
from tactophone.evaluation.report import Report, make_report
from tactophone.evaluation.transitions import SOURCES, join_edges
from tactophone.evaluation.true_contact import in_true_contact

__all__ = [
    "RENDERED",
    "RULES",
    "SOURCES",
    "Change",
    "Delays",
    "Difference",
    "Estimate",
    "Goal",
    "OperatingPoint",
    "Predictor",
    "Rendered",
    "Report",
    "Rule",
    "Scores",
    "TakePredictions",
    "accuracy_of",
    "by_surface",
    "by_take",
    "calibration_error",
    "candidate_rules",
    "choose_rule",
    "compare_models",
    "contact_delays",
    "correct_for_number",
    "draw_trade_off",
    "edge_delays",
    "estimate",
    "false_bumps_per_minute",
    "false_positives_at_recall",
    "in_true_contact",
    "interval",
    "join_edges",
    "make_report",
    "measure",
    "measure_rule",
    "model_predictor",
    "paired_difference",
    "rendered_scores",
    "rough_score",
    "scores_of",
    "streaming_predictor",
    "try_rules",
]
