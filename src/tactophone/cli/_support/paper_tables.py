"""The paper's tables beside ours: I and II on data in the authors' layout, III with a simulated operator."""

import argparse
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rich.box import SIMPLE
from rich.table import Table

from tactophone.benchmark.crossvalidation import Cache
from tactophone.cli._support import terminal
from tactophone.dataset import Dataset

if TYPE_CHECKING:
    from tactophone.benchmark.paper_tables import Line
    from tactophone.benchmark.stone_task import Outcome
    from tactophone.evaluation.predictions import TakePredictions


def print_tables(args: argparse.Namespace, datasets: Sequence[Dataset], cache: Cache) -> int:
    """Print the tables that were asked for."""
    from tactophone.benchmark.paper_tables import table_one, table_two
    from tactophone.benchmark.plan import origin_of

    for dataset in datasets:
        judged = _judge(dataset, args.methods.split(",") if args.methods else (), cache)
        for wanted, make, title in ((args.table1, table_one, "Table I"), (args.table2, table_two, "Table II")):
            if wanted:
                _print_lines(f"{title}, {dataset.name} ({origin_of(dataset)})", make(judged), as_json=args.json)
    if args.table3:
        _print_task(args)
    return 0


def _judge(dataset: Dataset, names: Sequence[str], cache: Cache) -> "dict[str, list[TakePredictions]]":
    from tactophone.benchmark.paper_tables import judge_held_out

    with terminal.progress("Tables I and II") as bar:
        task = bar.add_task("", total=None, note="")
        return judge_held_out(dataset, names, cache, report=lambda name: bar.update(task, note=name))


def _print_lines(title: str, lines: Sequence["Line"], *, as_json: bool) -> None:
    if as_json:
        terminal.print_json({"title": title, "lines": [line.as_json() for line in lines]})
        return
    table = Table(title=title, title_justify="left", box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("", no_wrap=True)
    for name in lines[0].values:
        table.add_column(name.replace("_", " "), justify="right")
    for line in lines:
        table.add_row(line.name, *line.values.values())
    terminal.out().print(table)


def _print_task(args: argparse.Namespace) -> None:
    from tactophone.benchmark.stone_task import play_task, ways_to_feel

    with terminal.progress("simulated operator") as bar:
        names = args.methods.split(",") if args.methods else ways_to_feel()
        task = bar.add_task("", total=len(names) + 1, note="")
        outcomes = play_task(names, rounds=args.rounds, report=lambda name: bar.update(task, advance=1, note=name))
    if args.json:
        terminal.print_json([one.as_json() for one in outcomes])
        return
    terminal.out().print(_task_table(outcomes, args.rounds))


def _task_table(outcomes: Sequence["Outcome"], rounds: int) -> Table:
    title = f"Table III: SIMULATED OPERATOR, five stones, two of them rough, {rounds} rounds a method"
    told = (
        "Shares with 90 % intervals, times as median and 5 to 95 %. It practises on the catalogue's training objects, "
        "as shipped models do, and plays with stones that neither has met. The paper's two people: 62 and 66 s."
    )
    heading = ("felt through", "rough one found", "both found", "decision time (s)")
    table = Table(*heading, title=title, title_justify="left", caption=told, caption_justify="left")
    for one in outcomes:
        table.add_row(one.name, one.found, one.both, one.duration)
    return table
