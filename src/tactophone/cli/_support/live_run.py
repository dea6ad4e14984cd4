"""What `send`, `receive` and `loopback` share: the options of a live run, and how it is followed until it ends."""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from tactophone.cli._support import console, dashboard_options, flags, log_option, record_option, run_summary

if TYPE_CHECKING:  # its import takes 0.3 s, which would slow down --help
    from tactophone.runtime import Supervisor


def add_arguments(parser: argparse.ArgumentParser, settings: Mapping[str, str]) -> None:
    """Add flags for these settings, and all that a live run can show, log and record."""
    flags.add_settings(parser, settings)
    flags.add_fingers(parser)
    dashboard_options.add_arguments(parser)
    log_option.add_arguments(parser)
    record_option.add_arguments(parser)
    run_summary.add_arguments(parser)


def follow(
    args: argparse.Namespace,
    sides: "AbstractContextManager[Sequence[Supervisor]]",
    name: str,
    *,
    microphone: Connection | None = None,
) -> int:
    """Start the sides, show, log and record the run of that name until it ends; return the verb's exit code.

    ``microphone`` takes the sound of a page's microphone.
    """
    with (
        sides as running,
        record_option.recorded(args, name),
        log_option.logged(args.log, name),
        dashboard_options.shown(args, name, microphone=microphone),
    ):
        outcome = console.follow(running, name, duration=args.duration)
    return run_summary.print_outcome(args, outcome)
