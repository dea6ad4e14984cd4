"""Output of every verb: results on stdout, everything else on stderr."""

import argparse
import functools
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any, TypeVar

from rich.console import Console
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from tactophone.errors import ConfigError, did_you_mean
from tactophone.json_numbers import finite

Entry = TypeVar("Entry")


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the default of each option that has one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        # bool first, as it is a number too; an empty text or list is no default worth showing, but 0 is.
        default = action.default
        if (
            isinstance(default, bool)
            or default is argparse.SUPPRESS
            or not (default or isinstance(default, int | float))
        ):
            return action.help
        return super()._get_help_string(action)


class Parser(argparse.ArgumentParser):
    """Shows defaults, and names in errors the choice nearest to an unknown one, and the option that is out of range."""

    def __init__(self, **options: Any) -> None:
        super().__init__(formatter_class=HelpFormatter, **options)

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string)
        except ConfigError as error:  # of a `Within`
            raise ConfigError(f"{action.option_strings[-1]} {error}") from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            error.message += did_you_mean(str(value), map(str, action.choices or ()))
            raise


@functools.cache
def out() -> Console:
    """The console for results; plain text when stdout is not a terminal."""
    return Console(highlight=False)


@functools.cache
def log() -> Console:
    """The console for everything that is not a result."""
    return Console(stderr=True, highlight=False)


def live_display() -> AbstractContextManager[Live | None]:
    """Return a display on stderr that is redrawn in place; ``None`` where stderr is not a terminal."""
    console = log()
    return Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else nullcontext()


def print_error(message: str) -> None:
    """Print what went wrong, on stderr, in one line."""
    print(f"tactophone: {message}", file=sys.stderr)


def print_json(value: Any) -> None:
    """Print a result as JSON; infinities and NaN become ``null``, as JSON has neither."""
    print(json.dumps(finite(value), indent=2, ensure_ascii=False))


@contextmanager
def progress(description: str, total: float | None = None, *, note: str = "") -> Iterator[Callable[..., None]]:
    """Show a progress bar on stderr, where that is a terminal.

    Yields the function that updates it, by ``completed`` or ``advance``, ``total`` and ``note``.
    """
    columns = (
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(
        TextColumn(description), *columns, console=log(), transient=True, disable=not log().is_terminal
    ) as bar:
        yield functools.partial(bar.update, bar.add_task("", total=total, note=note))


@contextmanager
def tracked(entries: Iterable[Entry], description: str, total: float | None = None) -> Iterator[Iterator[Entry]]:
    """Yield an iterator over entries that a progress bar counts; ``total`` is by default their length."""

    def counted() -> Iterator[Entry]:
        for entry in entries:
            yield entry
            update(advance=1)

    with progress(description, len(entries) if isinstance(entries, Sized) else total) as update:
        yield counted()


def warn(line: str) -> None:
    """Print what has gone wrong in a run that goes on, as `note` does."""
    note(f"! {line}")


def note(line: str) -> None:
    """Print a line for people on stderr, as it is; may be called from another thread."""
    log().print(line, soft_wrap=True, markup=False, highlight=False)
