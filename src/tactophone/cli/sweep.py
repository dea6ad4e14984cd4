"""``tactophone sweep``: cross-validate a recipe under every combination of settings, best first."""

import argparse
import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from tactophone.cli._support import fold_options, terminal
from tactophone.cli._support.dataset_options import add_filter, add_kin, open_filtered
from tactophone.cli._support.ranges import SEED, Within
from tactophone.cli._support.training_options import BITRATE, NUMBERS, add_training_options, recipe_of
from tactophone.dataset import split
from tactophone.errors import ConfigError

if TYPE_CHECKING:
    from tactophone.benchmark import Cache, Method

_VALUES: dict[str, Callable[[str], Any]] = {
    "recipe": str, "variant": str, "reference_code": {"true": True, "false": False}.__getitem__, "precision": str,
    **{name: number for name, (number, _) in NUMBERS.items()}, "seed": SEED, "channels": Within(int, 1, 2),
    "opus_bitrate": BITRATE,
}  # fmt: skip
"""Options that may vary, and how their values are read."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("data", type=Path, metavar="DIR", help="a data set: see `tactophone dataset`")
    add_filter(parser)
    add_kin(parser)
    parser.add_argument(
        "--vary", action="append", required=True, metavar="NAME=VALUE,VALUE...",
        help=f"a setting and its values, repeatable: every combination is tried; of {', '.join(_VALUES)}",
    )  # fmt: skip
    parser.add_argument("--split", metavar="NAME", default="5-fold", help="how to cross-validate")
    fold_options.add_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_training_options(parser.add_argument_group("the recipe, where --vary does not change it"))


def run(args: argparse.Namespace) -> int:
    """Run the folds of every combination in parallel, and list the combinations, best first."""
    from tactophone.benchmark.methods import method_of

    recipes = [(name, recipe_of(changed)) for name, changed in _combinations(args)]
    dataset = open_filtered(
        args.data, args.filter, channels=max(recipe.channels for _, recipe in recipes), kin=args.kin
    )
    trials = [(name, method_of(recipe)) for name, recipe in recipes]
    folds = split(dataset, args.split)
    cache = fold_options.cache_of(args)
    _run(trials, folds, cache, args)
    rows = sorted((_row(name, method, folds, cache) for name, method in trials), key=lambda row: -row["score"])
    if args.json:
        terminal.print_json(rows)
        return 0
    table = Table("settings", "balanced accuracy", "area under ROC", "recall at 1 %")
    for row in rows:
        table.add_row(row["settings"], row["balanced_accuracy"], row["auc"], row["recall_at_1"])
    terminal.out().print(table)
    terminal.log().print("the best of many is partly luck: score it again on surfaces that no trial was scored on")
    return 0


def _combinations(args: argparse.Namespace) -> Iterator[tuple[str, argparse.Namespace]]:
    choices = [_values(text) for text in args.vary]
    for values in itertools.product(*(values for _, values in choices)):
        changes = dict(zip((name for name, _ in choices), values, strict=True))
        label = ", ".join(f"{name} {value}" for name, value in changes.items())
        yield label, argparse.Namespace(**{**vars(args), **changes})


def _values(text: str) -> tuple[str, list[Any]]:
    name, equals, values = text.partition("=")
    name = name.replace("-", "_")
    if not equals or name not in _VALUES:
        raise ConfigError(f"--vary {text}: write NAME=VALUE,VALUE with a name of {', '.join(_VALUES)}")
    try:
        return name, [_VALUES[name](value) for value in values.split(",")]
    except ConfigError as error:
        raise ConfigError(f"--vary {text}: {name} {error}") from None
    except KeyError:
        raise ConfigError(f"--vary {text}: {name} takes true and false") from None


def _run(trials: "Sequence[tuple[str, Method]]", folds: Any, cache: "Cache", args: argparse.Namespace) -> None:
    from tactophone.benchmark import run_folds

    todo = [(method, fold) for _, method in trials for fold in folds]
    with terminal.progress("sweeping", len(todo)) as update:
        run_folds(
            todo, cache, workers=args.workers, ray=args.ray,
            report=lambda done, name: update(completed=done, note=name),
        )  # fmt: skip


def _row(name: str, method: "Method", folds: Any, cache: "Cache") -> dict[str, Any]:
    from tactophone.benchmark import cross_validate
    from tactophone.evaluation import estimate, scores_of

    found = estimate(scores_of(cross_validate(method, folds, cache=cache), "two-class"))
    measures = ("balanced_accuracy", "auc", "recall_at_1")
    return {
        "settings": name,
        "score": found["balanced_accuracy"].value,
        **{measure: str(found[measure]) for measure in measures},
    }
