"""Versions of Tactophone that a benchmark runs in turn, each from its own tree."""

import argparse
import os
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).parents[1]


def add_trees(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--tree``, once for each version."""
    parser.add_argument(
        "--tree",
        action="append",
        default=[],
        metavar="NAME[=PATH[:PATH]]",
        help="a version and where its packages lie (default: this one)",
    )


def trees_of(args: argparse.Namespace) -> dict[str, str]:
    """Return the versions asked for: a ``PYTHONPATH`` by name."""
    own = os.pathsep.join(map(str, ROOT.glob("packages/*/src")))
    trees = {}
    for text in args.tree or ["now"]:
        name, _, paths = text.partition("=")
        trees[name] = paths or own
    return trees


def in_turn(trees: Iterable[str], round_number: int) -> list[str]:
    """Return the order of a round: its first version is the last one of the next, so
    that neither always runs first.

    >>> in_turn(["now", "before"], 1)
    ['before', 'now']
    """
    names = list(trees)
    return names if round_number % 2 == 0 else names[::-1]
