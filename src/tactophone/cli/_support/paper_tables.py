"""Prints the paper's tables: I and II on data in the authors' layout, III with a simulated operator."""

import argparse
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from rich.box import SIMPLE
from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.dataset import Dataset

if TYPE_CHECKING:
    from tactophone.benchmark import Cache
    from tactophone.benchmark.paper_tables import TableRow
    from tactophone.evaluation import Estimate, TakePredictions


def print_tables(args: argparse.Namespace, datasets: Sequence[Dataset], cache: "Cache") -> int:
    """Print the tables that ``args`` names; I and II of each data set."""
    from tactophone.benchmark.paper_tables import by_gate, table_one, table_two
    from tactophone.benchmark.plan import origin_of

    for dataset in datasets:
        predictions = _predict(dataset, args.methods.split(",") if args.methods else (), cache)
        for gate, gated in by_gate(predictions, dataset.recordings).items():
            for chosen, make, title in ((args.table1, table_one, "Table I"), (args.table2, table_two, "Table II")):
                if chosen:
                    heading = f"{title}, {dataset.name} ({origin_of(dataset)}), {gate}"
                    print_rows(heading, make(gated), as_json=args.json)
    if args.table3:
        _print_task(args)
    return 0


def _predict(dataset: Dataset, names: Sequence[str], cache: "Cache") -> "dict[str, list[TakePredictions]]":
    from tactophone.benchmark.paper_tables import predict_held_out

    with terminal.progress("Tables I and II") as update:
        return predict_held_out(dataset, names, cache, report=lambda name: update(note=name))


def print_rows(title: str, rows: Sequence["TableRow"], *, as_json: bool) -> None:
    """Print one of Tables I and II."""
    if as_json:
        terminal.print_json({"title": title, "lines": [asdict(row) for row in rows]})
        return
    caption = (
        "Below a score, its 90 % interval over takes of the test objects and 5 s pieces of the competition's runs: one "
        "object a class says nothing of other objects."
    )
    table = Table(title=title, title_justify="left", box=SIMPLE, pad_edge=False, padding=0)
    table.caption, table.caption_justify = caption, "left"
    table.add_column("")
    for name in rows[0].values:
        # In 80 characters the headings wrap, the figures and the names' words do not.
        lines = [line for row in rows for line in _cell(row.values[name]).splitlines()]
        table.add_column(name.replace("_", " "), justify="right", width=max(map(len, ("contact", *lines))))
    for row in rows:
        table.add_row(row.name, *map(_cell, row.values.values()))
    terminal.out().print(table)


def _cell(score: "Estimate") -> str:
    if math.isnan(score.low):
        return "-" if math.isnan(score.value) else f"{score.value:.3f}"
    # Two lines, and no leading zeros, so that eight columns fit.
    low, high = (f"{end:.2f}".removeprefix("0") for end in (score.low, score.high))
    return f"{score.value:.3f}\n{low}-{high}"


def _print_task(args: argparse.Namespace) -> None:
    from tactophone.benchmark.paper_tables import PAPER_THREE, play_task, task_methods

    names = args.methods.split(",") if args.methods else task_methods()
    with terminal.progress("simulated operator", len(names) + 1) as update:
        outcomes = play_task(names, rounds=args.rounds, report=lambda name: update(advance=1, note=name))
    if args.json:
        own = [{"name": f"paper's own: {name}", "task": time} for name, time in PAPER_THREE.items()]
        played = [{**asdict(outcome), "task": outcome.median_duration + args.retrieval} for outcome in outcomes]
        terminal.print_json([*own, *played])
        return
    title = f"Table III: SIMULATED OPERATOR, five stones, two of them rough, {args.rounds} rounds a method"
    caption = (
        "Shares with 90 % intervals, times as median and 5 to 95 %. The operator practises on the catalogue's training "
        "objects, on which the shipped models are trained, and plays with stones new to both. Task time: the median "
        f"decision and {args.retrieval:g} s of retrieval (--retrieval). The paper's rows are people with a robot, who "
        "also moved an arm."
    )
    heading = ("method", "rough one found", "both found", "decision time (s)", "task (s)")
    table = Table(*heading, title=title, title_justify="left", caption=caption, caption_justify="left")
    for name, time in PAPER_THREE.items():
        table.add_row(f"paper's own: {name}", "yes", "", "", time)
    for outcome in outcomes:
        task_time = f"{outcome.median_duration + args.retrieval:.1f}"
        table.add_row(outcome.name, outcome.found, outcome.both, outcome.duration, task_time)
    terminal.out().print(table)
