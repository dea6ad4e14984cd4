"""``tactophone sweep``: cross-validate a recipe under every combination of settings, and say which did best."""

import argparse
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.table import Table

from tactophone.benchmark.crossvalidation import Cache, Method, cross_validate, default_cache
from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_choice, choose
from tactophone.cli.train import add_recipe, method_of
from tactophone.dataset import split
from tactophone.errors import ConfigError

_NUMBERS = {
    "epochs": int, "least_steps": int, "batch_size": int, "hop": int, "learning_rate": float, "noise": float,
    "seed": int, "channels": int, "opus": int,
}  # fmt: skip
_WORDS = ("recipe", "variant", "following", "precision")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("data", type=Path, metavar="DIR", help="a data set: see `tactophone dataset`")
    add_choice(parser)
    parser.add_argument(
        "--vary", action="append", required=True, metavar="NAME=VALUE,VALUE...",
        help=f"a setting and its values, repeatable: every combination is tried; of {', '.join((*_WORDS, *_NUMBERS))}",
    )  # fmt: skip
    parser.add_argument("--split", metavar="NAME", default="5-fold", help="how to cross-validate")
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes, 1 or more")
    parser.add_argument("--ray", action="store_true", help="run folds on a Ray cluster: RAY_ADDRESS, or a local one")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="where folds' results are kept (default: the user's)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_recipe(parser.add_argument_group("the recipe, where --vary does not change it"))


def run(args: argparse.Namespace) -> int:
    """Run every combination's folds, wherever there is room, and list them, best first."""
    if args.workers < 1:
        raise ConfigError(f"--workers {args.workers}: 1 or more")
    dataset = choose(args.data, args.where)
    trials = [(name, method_of(changed)) for name, changed in _combinations(args)]
    folds = split(dataset, args.split)
    cache = Cache(args.cache) if args.cache else default_cache()
    _run(trials, folds, cache, args)
    rows = sorted((_row(name, method, folds, cache) for name, method in trials), key=lambda row: -row["score"])
    if args.json:
        terminal.print_json(rows)
        return 0
    table = Table("settings", "balanced accuracy", "area under ROC", "recall at 1 %")
    for row in rows:
        table.add_row(row["settings"], row["balanced_accuracy"], row["auc"], row["recall_at_1"])
    terminal.out().print(table)
    terminal.log().print("the best of many is flattered: score it again on surfaces that no trial has seen")
    return 0


def _combinations(args: argparse.Namespace) -> Iterator[tuple[str, argparse.Namespace]]:
    choices = [_values(wish) for wish in args.vary]
    for values in itertools.product(*(some for _, some in choices)):
        changes = dict(zip((name for name, _ in choices), values, strict=True))
        told = ", ".join(f"{name} {value}" for name, value in changes.items())
        yield told, argparse.Namespace(**{**vars(args), **changes})


def _values(wish: str) -> tuple[str, list[Any]]:
    name, equals, values = wish.partition("=")
    name = name.replace("-", "_")
    if not equals or name not in (*_WORDS, *_NUMBERS):
        raise ConfigError(f"--vary {wish}: write NAME=VALUE,VALUE with a name of {', '.join((*_WORDS, *_NUMBERS))}")
    try:
        return name, [_NUMBERS[name](value) if name in _NUMBERS else value for value in values.split(",")]
    except ValueError:
        raise ConfigError(f"--vary {wish}: {name} takes numbers") from None


def _run(trials: list[tuple[str, Method]], folds: Any, cache: Cache, args: argparse.Namespace) -> None:
    from tactophone.benchmark.job_runner import Job, run_jobs

    jobs = [Job(method, fold) for _, method in trials for fold in folds]
    place = "ray" if args.ray else "processes" if args.workers > 1 else "here"
    with terminal.progress("sweeping") as bar:
        task = bar.add_task("", total=len(jobs), note="")
        run_jobs(
            jobs, cache, place=place, workers=args.workers,  # type: ignore[arg-type]  # one of its words
            report=lambda done, name: bar.update(task, completed=done, note=name),
        )  # fmt: skip


def _row(name: str, method: Method, folds: Any, cache: Cache) -> dict[str, Any]:
    from tactophone.evaluation.bootstrap import estimate
    from tactophone.evaluation.predictions import scores_of

    found = estimate(scores_of(cross_validate(method, folds, cache=cache), "two-class"))
    measures = ("balanced_accuracy", "auc", "recall_at_1")
    return {"settings": name, "score": found["balanced_accuracy"].value, **{one: str(found[one]) for one in measures}}
