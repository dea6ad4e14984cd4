"""``tactophone arm``: let vibration be felt again, after a stop, a mute or a restart."""

import argparse

from tactophone.cli._support.requests import add_arguments, ask

__all__ = ["add_arguments", "run"]


def run(args: argparse.Namespace) -> int:
    """Ask for it."""
    return ask(args, "arm")
