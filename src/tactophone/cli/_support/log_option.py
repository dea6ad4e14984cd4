"""``--log``: the prediction log of a live run."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tactophone.cli._support import terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option; `demo` writes ``timeline.csv`` in its output folder without it."""
    parser.add_argument(
        "--log",
        type=Path,
        metavar="FILE",
        help="CSV file to write each prediction and command to, with the columns of `tactophone feel`; "
        "written outside the audio process, and complete up to 1 s if a process is killed",
    )


@contextmanager
def logged(path: Path | None, name: str) -> Iterator[None]:
    """Write the predictions of the run of that name to a file meanwhile; does nothing when it is ``None``."""
    from tactophone.telemetry import PredictionLog

    if path is None:
        yield
        return
    with PredictionLog(name, path, report=terminal.warn):
        yield
