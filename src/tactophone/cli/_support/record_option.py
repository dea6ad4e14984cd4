"""``--record``: the log of a live run, from which `tactophone replay` computes it again."""

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tactophone.cli._support import extras, terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FILE",
        help="MCAP file for packets, sound, predictions, commands, events and settings, which `tactophone replay` "
        "computes again to the bit; written by another process, and complete up to 1 s if one is killed",
    )


@contextmanager
def recorded(args: argparse.Namespace, name: str) -> Iterator[None]:
    """Record the run of that name meanwhile, if ``--record`` is set."""
    if args.record is None:
        yield
        return
    extras.require_modules("mcap", "zstandard")
    from tactophone.bridges import BridgeProcess, McapLog

    build = partial(McapLog, name, args.record.absolute())
    with BridgeProcess(build, report=lambda line: terminal.log().print(f"! {line}", soft_wrap=True)):
        yield
