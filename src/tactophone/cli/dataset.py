"""``tactophone dataset``: what a data set holds, and what is wrong with it."""

import argparse
from collections import Counter
from dataclasses import asdict
from typing import Any

from rich.table import Table

from tactophone.cli import terminal
from tactophone.dataset import Dataset, Problem, check, open_dataset


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's actions and their arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    for name, action, line in (
        ("check", _check, "read every file through and name what is wrong; exit 1 if a file cannot be used"),
        ("show", _show, "list surfaces, labels and recordings; opens no sound"),
    ):
        sub = actions.add_parser(name, help=line, description=line, formatter_class=terminal.HelpFormatter)
        sub.add_argument("folder", metavar="DIR", help="a folder with metadata.csv, manifest.csv or opus/stereo/")
        sub.add_argument("--json", action="store_true", help="print JSON instead of a table")
        sub.set_defaults(action=action)


def run(args: argparse.Namespace) -> int:
    """Run the chosen action."""
    code: int = args.action(args)
    return code


def _check(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    with terminal.progress("checking") as bar:
        task = bar.add_task("", total=len(dataset.recordings), note="")
        problems = check(dataset, progress=lambda done: bar.update(task, completed=done))
    bad = {problem.path for problem in problems if problem.fatal}
    if args.json:
        terminal.print_json({"recordings": len(dataset.recordings), "problems": [_told(one) for one in problems]})
    else:
        for problem in problems:
            print(f"{'error' if problem.fatal else 'warning'}: {problem}")
        print(f"{len(dataset.recordings)} recordings, {len(bad)} unusable, {len(problems)} problems")
    return 1 if bad else 0


def _show(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    if args.json:
        terminal.print_json(
            {"name": dataset.name, "recordings": len(dataset.recordings), "surfaces": list(_surfaces(dataset))}
        )
        return 0
    table = Table("surface", "label", "tier", "scenarios", "recordings", title=dataset.name, title_justify="left")
    for surface in _surfaces(dataset):
        table.add_row(*(str(cell) for cell in surface.values()))
    terminal.out().print(table)
    return 0


def _surfaces(dataset: Dataset) -> list[dict[str, Any]]:
    return [
        {
            "surface": surface,
            **{key: _words(dataset, surface, key) for key in ("label", "tier", "scenario")},
            "recordings": sum(one.surface == surface for one in dataset.recordings),
        }
        for surface in dataset.surfaces
    ]


def _words(dataset: Dataset, surface: str, key: str) -> str:
    counted = Counter(one.known(key) or "-" for one in dataset.recordings if one.surface == surface)
    return ", ".join(sorted(counted))


def _told(problem: Problem) -> dict[str, Any]:
    return {**asdict(problem), "path": str(problem.path)}
