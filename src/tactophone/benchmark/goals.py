"""What our own detector set out to reach beside the paper's, and whether it did, in the same run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from tactophone.benchmark.entries import Cost
from tactophone.benchmark.result import Result

MIDDLE_MS, LATE_MS = 100.0, 180.0
"""Goals for the median and the 95th percentile of a right decision: a window of 256 ms cannot reach them."""

CALIBRATION = 0.05


@dataclass(frozen=True, slots=True)
class Goal:
    """One goal.

    Parameters
    ----------
    told
        What it is about, with its unit.
    limit
        The most that was allowed.
    reference, ours
        What the first method and ours came to.
    """

    told: str
    limit: float
    reference: float
    ours: float

    @property
    def verdict(self) -> str:
        """Met, or by how much it was missed.

        >>> Goal("time (ms)", 100, 300, 130).verdict, Goal("time (ms)", 100, 300, 90).verdict
        ('missed by 30', 'met')
        """
        return "met" if self.ours <= self.limit else f"missed by {tell(self.ours - self.limit)}"


def goals_of(results: Sequence[Result], costs: Mapping[str, Cost]) -> list[Goal]:
    """Compare ours with the paper's network on one split; nothing, unless both took part and the latter leads.

    Goals that the split cannot tell, such as edges where one surface is left out, are left away.
    """
    found = {one.method: one for one in results}
    paper = results[0]
    if "ours" not in found or not paper.method.startswith("paper"):
        return []
    ours = found["ours"]
    rates = paper.false_positives_at_reference, ours.false_positives_at_reference
    goals = [Goal("false positives at the paper's rough recall", rates[0] / 2, *rates)]
    for place, first, second in (
        ("contact", paper.contact_ms, ours.contact_ms), ("an edge", paper.edge_ms, ours.edge_ms),
    ):  # fmt: skip
        goals.append(Goal(f"right decision after {place}, p50 (ms)", MIDDLE_MS, first[0], second[0]))
        goals.append(Goal(f"right decision after {place}, p95 (ms)", LATE_MS, first[1], second[1]))
    goals.append(Goal("calibration error", CALIBRATION, paper.calibration_error, ours.calibration_error))
    if paper.method in costs and "ours" in costs:
        times = costs[paper.method].update_us, costs["ours"].update_us
        goals.append(Goal("processor time of an update (us)", times[0], *times))
    return [one for one in goals if math.isfinite(one.ours)]


def tell(value: float) -> str:
    """Tell a number with the digits that it deserves.

    >>> tell(0.0312), tell(97.3)
    ('0.031', '97')
    """
    return f"{value:.3f}" if value < 1 else f"{value:.0f}"
