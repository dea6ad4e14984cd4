"""Where the folds of `benchmark` and `sweep` run, and where their results are kept."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli._support.ranges import Within

if TYPE_CHECKING:
    from tactophone.benchmark import Cache


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--workers``, ``--ray`` and ``--cache``."""
    parser.add_argument("--workers", type=Within(int, 1), default=2, metavar="N", help="processes, %(type)s")
    parser.add_argument("--ray", action="store_true", help="run folds on a Ray cluster: RAY_ADDRESS, or a local one")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="for the folds' results (default: the user's cache)")


def cache_of(args: argparse.Namespace) -> "Cache":
    """Return where the folds' results are kept."""
    from tactophone.benchmark import Cache, default_cache

    return Cache(args.cache) if args.cache else default_cache()
