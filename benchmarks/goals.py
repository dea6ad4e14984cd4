"""Did the texture detector reach the goals that it was designed for? Prints the first table of the benchmark's page.

python benchmarks/goals.py RESULTS     (RESULTS: the results.json that `tactophone benchmark` writes)

Every goal is relative to the paper's network in the same run, or a limit in absolute terms.
"""

import argparse
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

P50_MS, P95_MS = 100.0, 180.0
"""Goals for the time to a correct decision: a window of 256 ms cannot reach them."""

CALIBRATION_ERROR = 0.05


@dataclass(frozen=True, slots=True)
class Goal:
    """A quantity with its unit, the most that is allowed, and its value for the paper's network and for texture."""

    name: str
    limit: float
    paper: float
    texture: float

    @property
    def verdict(self) -> str:
        """Met, or by how much it was missed.

        >>> Goal("time (ms)", 100, 300, 130).verdict, Goal("time (ms)", 100, 300, 90).verdict
        ('missed by 30', 'met')
        """
        return "met" if self.texture <= self.limit else f"missed by {brief(self.texture - self.limit)}"


def goals_of(results: Sequence[Mapping[str, Any]], costs: Mapping[str, Mapping[str, float]]) -> list[Goal]:
    """Compare the results of one split; no goals unless the paper's network leads it and the texture detector has part.

    Goals that a split cannot have, such as edges where one surface is left out, are left out.
    """
    by_method = {result["method"]: result for result in results}
    paper = results[0]
    if "texture" not in by_method or not paper["method"].startswith("paper"):
        return []
    texture = by_method["texture"]
    rates = paper["false_positives_at_reference"], texture["false_positives_at_reference"]
    goals = [Goal("false positives at the paper's rough recall", rates[0] / 2, *rates)]
    for place, key in (("contact", "contact_ms"), ("an edge", "edge_ms")):
        for name, index, limit in (("p50", 0, P50_MS), ("p95", 1, P95_MS)):
            times = (_number(result[key][index]) for result in (paper, texture))
            goals.append(Goal(f"correct decision after {place}, {name} (ms)", limit, *times))
    errors = paper["calibration_error"], texture["calibration_error"]
    goals.append(Goal("calibration error", CALIBRATION_ERROR, *errors))
    if paper["method"] in costs and "texture" in costs:
        times_us = costs[paper["method"]]["update_us"], costs["texture"]["update_us"]
        goals.append(Goal("processor time of an update (us)", times_us[0], *times_us))
    return [goal for goal in goals if math.isfinite(goal.texture)]


def brief(value: float) -> str:
    """Format a number with three decimals below 1, otherwise with none.

    >>> brief(0.0312), brief(97.3)
    ('0.031', '97')
    """
    return f"{value:.3f}" if value < 1 else f"{value:.0f}"


def _number(value: float | None) -> float:
    # The file has null where a number is not defined.
    return math.nan if value is None else value


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    summary = json.loads(parser.parse_args().results.read_text())
    print("| goal | paper | texture | at most | |\n|---|--:|--:|--:|---|")
    for dataset in summary["datasets"]:
        costs = summary["costs"].get(dataset["dataset"], {})
        for split, results in groupby(dataset["results"], key=lambda result: result["split"]):
            for goal in goals_of(list(results), costs):
                numbers = " | ".join(map(brief, (goal.paper, goal.texture, goal.limit)))
                print(f"| {dataset['dataset']}, {split}: {goal.name} | {numbers} | {goal.verdict} |")


if __name__ == "__main__":
    main()
