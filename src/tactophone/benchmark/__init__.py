"""Every method on the same splits, behind one protocol; the paper's tables and the report.

What needs the training room (torch, onnx, scikit-learn) or the simulator is imported when it is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from tactophone.benchmark.crossvalidation import Cache, Method, cross_validate, default_cache, permute_labels
from tactophone.benchmark.job_runner import Job, run_jobs

if TYPE_CHECKING:
    from tactophone.benchmark.costs import Cost, measure_costs
    from tactophone.benchmark.html_report import (
        format_delay,
        format_heights,
        format_permuted,
        format_seeds,
        steps_by_profile,
        write_report,
    )
    from tactophone.benchmark.methods import graph_predictor, method_of, recipe_method
    from tactophone.benchmark.paper_tables import TableRow, by_gate, predict_held_out, table_one, table_two
    from tactophone.benchmark.plan import DatasetResults, origin_of, plan_for, run_plan, splits_of
    from tactophone.benchmark.stone_task import PAPER_THREE, play_task, task_methods

__all__ = [
    "PAPER_THREE",
    "Cache",
    "Cost",
    "DatasetResults",
    "Job",
    "Method",
    "TableRow",
    "by_gate",
    "cross_validate",
    "default_cache",
    "format_delay",
    "format_heights",
    "format_permuted",
    "format_seeds",
    "graph_predictor",
    "measure_costs",
    "method_of",
    "origin_of",
    "permute_labels",
    "plan_for",
    "play_task",
    "predict_held_out",
    "recipe_method",
    "run_jobs",
    "run_plan",
    "splits_of",
    "steps_by_profile",
    "table_one",
    "table_two",
    "task_methods",
    "write_report",
]

_MODULE_OF = {
    "costs": ("Cost", "measure_costs"),
    "html_report": (
        "format_delay",
        "format_heights",
        "format_permuted",
        "format_seeds",
        "steps_by_profile",
        "write_report",
    ),
    "methods": ("graph_predictor", "method_of", "recipe_method"),
    "paper_tables": ("TableRow", "by_gate", "predict_held_out", "table_one", "table_two"),
    "plan": ("DatasetResults", "origin_of", "plan_for", "run_plan", "splits_of"),
    "stone_task": ("PAPER_THREE", "play_task", "task_methods"),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULE_OF.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__} has no attribute {name}")
