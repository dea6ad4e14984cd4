"""``--filter``, for every verb that reads a data set, and ``--kin``, for those that split one."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from tactophone.cli._support import terminal
from tactophone.dataset import Dataset, open_dataset, usable, with_channels, with_kin
from tactophone.errors import DatasetError


def add_filter(parser: argparse.ArgumentParser) -> None:
    """Add ``--filter``."""
    parser.add_argument(
        "--filter", action="append", metavar="KEY=VALUE[,VALUE...]",
        help="keep only recordings whose tier, surface, scenario or other key has one of these values; repeatable",
    )  # fmt: skip


def add_kin(parser: argparse.ArgumentParser) -> None:
    """Add ``--kin``."""
    parser.add_argument(
        "--kin", type=Path, metavar="CSV",
        help="columns surface,kin: surfaces of one kin stay on one side of a split (default: the column kin, or "
        "the versions of a surface, by name)",
    )  # fmt: skip


def open_filtered(folder: Path, filters: list[str] | None, *, channels: int = 1, kin: Path | None = None) -> Dataset:
    """Open a data set, apply the filters, and drop unusable recordings, each reported on stderr.

    Recordings with fewer ``channels`` are dropped where others have as many. Raises `DatasetError` if nothing is left.
    """
    dataset = open_dataset(folder)
    for text in filters or ():
        dataset = _filtered(dataset, text)
    kept, problems = usable(dataset)
    for problem in problems:
        if problem.fatal:
            terminal.note(f"left out: {problem}")
    kept, lacking = with_channels(kept.labelled(), channels)
    for problem in lacking:
        terminal.note(f"left out: {problem}")
    return with_kin(kept, kin) if kin else kept


def joined(datasets: Sequence[Dataset]) -> Dataset:
    """Join data sets for a training; the first one's folder stands for all."""
    first = datasets[0]
    return Dataset(
        " + ".join(dataset.name for dataset in datasets),
        first.root,
        tuple(recording for dataset in datasets for recording in dataset.recordings),
        tuple(problem for dataset in datasets for problem in dataset.problems),
    )


def _filtered(dataset: Dataset, text: str) -> Dataset:
    key, equals, values = text.partition("=")
    if not equals:
        raise DatasetError(f"--filter {text}: write KEY=VALUE, such as tier=core")
    allowed = set(values.split(","))
    kept = dataset.where(lambda recording: recording.known(key) in allowed)
    if not kept.recordings:
        known = sorted({recording.known(key) or "(nothing)" for recording in dataset.recordings})
        raise DatasetError(f"--filter {text}: no recording has it; {key} is one of {', '.join(known[:12])}")
    return kept
