"""What the verbs that take a data set share: choosing recordings by what is known of them."""

import argparse
from pathlib import Path

from tactophone.cli._support import terminal
from tactophone.dataset import Dataset, open_dataset, usable
from tactophone.errors import DatasetError


def add_choice(parser: argparse.ArgumentParser) -> None:
    """Add ``--where``."""
    parser.add_argument(
        "--where", action="append", metavar="KEY=VALUE[,VALUE...]",
        help="keep only recordings whose tier, surface, scenario or other key has one of these values; repeatable",
    )  # fmt: skip


def choose(folder: Path, wanted: list[str] | None) -> Dataset:
    """Open a data set, keep what ``--where`` wants, and leave out what cannot be used, naming it on stderr.

    Raises
    ------
    DatasetError
        If nothing is left.
    """
    dataset = open_dataset(folder)
    for wish in wanted or ():
        dataset = _where(dataset, wish)
    kept, problems = usable(dataset)
    for problem in problems:
        if problem.fatal:
            terminal.log().print(f"left out: {problem}", soft_wrap=True)
    return kept.labelled()


def _where(dataset: Dataset, wish: str) -> Dataset:
    key, equals, values = wish.partition("=")
    if not equals:
        raise DatasetError(f"--where {wish}: write KEY=VALUE, such as tier=core")
    allowed = set(values.split(","))
    kept = dataset.where(lambda one: one.known(key) in allowed)
    if not kept.recordings:
        known = sorted({one.known(key) or "(nothing)" for one in dataset.recordings})
        raise DatasetError(f"--where {wish}: no recording has it; {key} is one of {', '.join(known[:12])}")
    return kept
