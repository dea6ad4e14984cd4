"""The end of a run: its counters and its latency budget."""

import argparse
import math
from dataclasses import asdict

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.cli._support.console import Outcome
from tactophone.cli._support.ranges import Within
from tactophone.telemetry import COUNTERS, STAGES, Snapshot


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--duration`` and ``--json``."""
    parser.add_argument(
        "--duration", type=Within(float, 0, unit="s"), default=0.0, metavar="S",
        help="how long to run, %(type)s; 0: until interrupted",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="at the end, print all counters as JSON")


def print_outcome(args: argparse.Namespace, outcome: Outcome) -> int:
    """Print the outcome and return the verb's exit code."""
    if outcome.last is None:
        return 1
    if args.json:
        last = outcome.last
        entries = {"counters": last.counters, "gauges": last.gauges, "state": asdict(last.state)}
        terminal.print_json(entries | {"restarts": outcome.restarts})
        return outcome.exit_code
    terminal.out().print(_counts(outcome.last))
    if math.isfinite(outcome.last.gauges["latency_total"]):
        terminal.out().print(_budget(outcome.last))
    return outcome.exit_code


def _counts(snapshot: Snapshot) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(justify="right")
    table.add_column()
    for name, description in COUNTERS.items():
        if snapshot.counters[name]:
            table.add_row(f"{snapshot.counters[name]}", description)
    return table


def _budget(snapshot: Snapshot) -> Table:
    table = Table(box=None, pad_edge=False)
    for stage in (*STAGES, "total"):
        table.add_column(stage, justify="right")
    table.add_row(*(f"{1000 * snapshot.gauges[f'latency_{stage}']:.2f} ms" for stage in (*STAGES, "total")))
    return table
