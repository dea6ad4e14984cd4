"""``tactophone dataset``: what a data set holds, what is wrong with it, and other forms of it."""

import argparse
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.dataset import Dataset, Problem, check, open_dataset, split
from tactophone.dataset.consistency import FAINT_DBFS, check_together
from tactophone.dataset.converters import convert, set_split, write_card
from tactophone.dataset.splits import NAMES
from tactophone.errors import ConfigError
from tactophone.perception.sensor_health.calibration_file import Calibration

ACTIONS = {
    "check": "read every file through and name what is wrong, with each and between them; exit 1 if one cannot be used",
    "show": "list surfaces, labels and recordings; with --plot, draw levels and spectrograms",
    "split": "show how a named split divides it; with --write, put train and test into its manifest",
    "import": "copy another layout (the paper's authors', or manifest.csv) into this project's, as FLAC",
    "card": "write a data card, README.md, as Hugging Face has them",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's actions and their arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    made = {}
    for name, line in ACTIONS.items():
        sub = made[name] = actions.add_parser(name, help=line, description=line, formatter_class=terminal.HelpFormatter)
        sub.add_argument("folder", metavar="DIR", help="a folder with metadata.csv, manifest.csv or opus/stereo/")
        sub.set_defaults(action=globals()[f"_{name}"])
        if name in ("check", "show", "split"):
            sub.add_argument("--json", action="store_true", help="print JSON instead of a table")
    made["check"].add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help=f"contact threshold of the set-up (default: {FAINT_DBFS:g} dBFS)",
    )
    made["show"].add_argument("--plot", type=Path, metavar="PNG", help="picture to write")
    made["split"].add_argument("--by", default="4-fold", metavar="NAME", help=f"one of {', '.join(NAMES)}")
    made["split"].add_argument("--fold", type=int, default=1, metavar="N", help="which fold's test side --write takes")
    made["split"].add_argument("--write", action="store_true", help="write the column split of metadata.csv")
    made["import"].add_argument("out", type=Path, metavar="OUT", help="new folder to write to")


def run(args: argparse.Namespace) -> int:
    """Run the chosen action."""
    code: int = args.action(args)
    return code


def _check(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    threshold_dbfs = Calibration.read(args.calibration).window_dbfs if args.calibration else FAINT_DBFS
    with terminal.progress("checking") as bar:
        task = bar.add_task("", total=2 * len(dataset.recordings), note="")
        alone = check(dataset, progress=lambda done: bar.update(task, completed=done))
        together = check_together(dataset, threshold_dbfs=threshold_dbfs, progress=lambda done: bar.advance(task))
    problems = (*alone, *together)
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
    if args.plot:
        from tactophone.dataset.plots import draw_dataset

        draw_dataset(args.plot, dataset)
    if args.json:
        terminal.print_json(
            {"name": dataset.name, "recordings": len(dataset.recordings), "surfaces": list(_surfaces(dataset))}
        )
        return 0
    table = Table("surface", "label", "tier", "scenarios", "recordings", title=dataset.name, title_justify="left")
    for surface in _surfaces(dataset):
        table.add_row(*(str(cell) for cell in surface.values()))
    terminal.out().print(table)
    if args.plot:
        terminal.out().print(args.plot, soft_wrap=True)
    return 0


def _split(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    folds = split(dataset, args.by)
    if args.write:
        if not 1 <= args.fold <= len(folds):
            raise ConfigError(f"--fold {args.fold}: {args.by} has folds 1 to {len(folds)}")
        fold = folds[args.fold - 1]
        sides = {one.surface: side for side, part in (("train", fold.train), ("test", fold.test)) for one in part}
        terminal.log().print(set_split(dataset, sides), soft_wrap=True)
    rows: list[dict[str, Any]] = [
        {"fold": fold.name, "train": len(fold.train), "test": sorted({one.surface for one in fold.test})}
        for fold in folds
    ]
    if args.json:
        terminal.print_json(rows)
        return 0
    table = Table("fold", "recordings to train on", "surfaces to test on", box=None)
    for row in rows:
        table.add_row(str(row["fold"]), str(row["train"]), ", ".join(map(str, row["test"])))
    terminal.out().print(table)
    return 0


def _import(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    for problem in dataset.problems:
        terminal.log().print(f"left out: {problem}", soft_wrap=True)
    with terminal.progress("converting") as bar:
        task = bar.add_task("", total=len(dataset.recordings), note="")
        made = convert(dataset, args.out, progress=lambda done: bar.update(task, completed=done))
    print(f"{len(made.recordings)} recordings in {args.out}")
    return 0


def _card(args: argparse.Namespace) -> int:
    print(write_card(open_dataset(args.folder)))
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
