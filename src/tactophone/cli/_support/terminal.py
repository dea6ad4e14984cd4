"""What every verb shares of the terminal: results on stdout, everything else on stderr."""

import argparse
import functools
import json
import sys
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows each default, as ``%(default)s``, wherever there is one to show."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        # Not by equality, as 1.0 equals True.
        if action.default is None or isinstance(action.default, bool) or action.default is argparse.SUPPRESS:
            return action.help
        return super()._get_help_string(action)


@functools.cache
def out() -> Console:
    """The console for results; plain text when stdout is not a terminal."""
    return Console(highlight=False)


@functools.cache
def log() -> Console:
    """The console for everything that is not a result."""
    return Console(stderr=True, highlight=False)


def complain(message: str) -> None:
    """Say what went wrong, on stderr, in one line."""
    print(f"tactophone: {message}", file=sys.stderr)


def print_json(value: Any) -> None:
    """Print a result for a program to read; infinities and NaN become ``null``, as JSON has neither."""
    print(json.dumps(finite(value), indent=2, ensure_ascii=False))


def progress(description: str) -> Progress:
    """Show how far a long job is, on stderr, and nothing at all when that is not a terminal."""
    return Progress(
        TextColumn(description),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
        console=log(),
        transient=True,
        disable=not log().is_terminal,
    )


def finite(value: Any) -> Any:
    """Put ``None`` for infinities and NaN in plain dictionaries and lists."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value
