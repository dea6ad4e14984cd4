"""Processor time of both ends in use, of several versions in turn.

    python benchmarks/versions.py --tree now --tree before=../before/src

For each sound at the microphone ports, number of fingers and duration of a packet,
every version runs for some seconds, and all of that is repeated in ``--rounds``. Other
work on the machine disturbs neighbours alike, so compare versions within a round: the
table states the median of the ratios to the last version named, with all of them. Its
load average stands beside each. Percentages are of one core.

- ``silence``: exact zeros, with the check of the microphones off.
- ``air``: the noise of microphones at rest, with the check on.
- ``strokes``: a stroke every two seconds over that noise, with the check on.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

from trees import add_trees, in_turn, trees_of

ROOT = Path(__file__).parents[1]

SOUNDS = ("silence", "air", "strokes")

PERIOD = 128
"""Samples of a period of the sound server."""

CHILD = Path(__file__).with_name("version_cost.py")


class Case(NamedTuple):
    """What is measured of each version."""

    sound: str
    fingers: int
    packet_ms: float


class Cost(NamedTuple):
    """Percent of a core, and the load average meanwhile."""

    robot: float
    operator: float
    load: float

    @property
    def both(self) -> float:
        return self.robot + self.operator


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_trees(parser)
    parser.add_argument("--rounds", type=int, default=3, help="default: %(default)s")
    parser.add_argument(
        "--seconds", type=int, default=8, help="of each run (default: %(default)s)"
    )
    parser.add_argument(
        "--sounds",
        default=",".join(SOUNDS),
        help="at the microphones (default: %(default)s)",
    )
    parser.add_argument("--fingers", default="1,10", help="default: %(default)s")
    parser.add_argument(
        "--packets", default="5,2.5", help="in ms; default: %(default)s"
    )
    args = parser.parse_args()
    trees = trees_of(args)
    cases = [
        Case(sound, int(fingers), float(packet))
        for sound, fingers, packet in product(
            args.sounds.split(","), args.fingers.split(","), args.packets.split(",")
        )
    ]
    found: dict[tuple[Case, str], list[Cost]] = {}
    for number in range(args.rounds):
        for case, tree in product(cases, in_turn(trees, number)):
            cost = measured(case, trees[tree], args.seconds)
            found.setdefault((case, tree), []).append(cost)
            print(number, tree, case, cost, file=sys.stderr, flush=True)
    print("\n".join(table(found, list(trees), cases)))


def measured(case: Case, paths: str, seconds: int) -> Cost:
    words = (case.sound, str(case.fingers), str(case.packet_ms), str(seconds))
    said = subprocess.run(
        [sys.executable, CHILD, *words, str(PERIOD)],
        env={**os.environ, "PYTHONPATH": paths},
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    ).stdout
    return Cost(**json.loads(said.splitlines()[-1]), load=os.getloadavg()[0])


def table(
    found: dict[tuple[Case, str], list[Cost]], trees: list[str], cases: list[Case]
) -> Iterator[str]:
    """Yield the lines of a table: a row for each case, a column for each version."""
    last = trees[-1]
    columns = [f"{tree}, %" for tree in trees]
    columns += [f"{tree} / {last}" for tree in trees[:-1]]
    yield f"| sound | fingers | packet | {' | '.join(columns)} | load |"
    yield f"|---|--:|--:|{'--:|' * (len(columns) + 1)}"
    for case in cases:
        rows = {tree: found[case, tree] for tree in trees}
        cells = []
        for tree in trees:
            robot = statistics.median(cost.robot for cost in rows[tree])
            operator = statistics.median(cost.operator for cost in rows[tree])
            both = statistics.median(cost.both for cost in rows[tree])
            cells.append(f"{both:.1f} (robot {robot:.1f}, operator {operator:.1f})")
        for tree in trees[:-1]:
            ratios = [
                one.both / other.both
                for one, other in zip(rows[tree], rows[last], strict=True)
            ]
            every = ", ".join(f"{ratio:.2f}" for ratio in ratios)
            cells.append(f"{statistics.median(ratios):.2f} ({every})")
        loads = ", ".join(f"{cost.load:.0f}" for cost in rows[last])
        yield (
            f"| {case.sound} | {case.fingers} | {case.packet_ms:g} ms "
            f"| {' | '.join(cells)} | {loads} |"
        )


if __name__ == "__main__":
    main()
