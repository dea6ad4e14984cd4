"""Output of every verb: results on stdout, as tables or as JSON; everything else on
stderr."""

import dataclasses
import functools
import json
import math
import os
import stat
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, TypeVar

from rich.box import HEAVY_HEAD
from rich.console import Console, RenderableType
from rich.live import Live
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from tactophone.core.errors import ConfigError, plain

Entry = TypeVar("Entry")

RULED: dict[str, Any] = {
    "box": HEAVY_HEAD,
    "pad_edge": True,
    "padding": (0, 1),
    "show_edge": False,
}
"""Style of a table with lines."""

Part = str | RenderableType | Sequence[Mapping[str, Any]]
"""What a result prints: lines, anything that rich prints, or rows of a table by
heading."""


class _Console(Console):
    """Prints text as it is: what comes from files, devices and the other end is neither
    markup nor escape sequences.

    On a terminal, a line that ends in a carriage return is replaced by whatever is
    printed next.
    """

    _replaced = False

    @property
    def replaces_lines(self) -> bool:
        """Whether a line can be written over: FORCE_COLOR, which notebooks and CI set,
        asks for colour in a pipe and not for that."""
        return self.is_terminal and self.file.isatty()

    def print(self, *objects: Any, **options: Any) -> None:
        if self._replaced:
            self.file.write("\x1b[2K")
        self._replaced = self.replaces_lines and options.get("end") == "\r"
        super().print(*objects, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(
            plain(text), **options | {"markup": False, "emoji": False}
        )


@functools.cache
def out() -> Console:
    """The console for results; plain text when stdout is not a terminal."""
    return _Console(highlight=False)


@functools.cache
def log() -> _Console:
    """The console for everything that is not a result."""
    return _Console(stderr=True, highlight=False)


def finite(value: Any) -> Any:
    """Replace infinities and NaN by ``None``, in dictionaries and lists too, as JSON
    has neither.

    >>> finite({"level": -math.inf, "shares": (0.5, math.nan)})
    {'level': None, 'shares': [0.5, None]}
    """
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def show(result: Any, parts: Iterable[Part] | None = None, *, as_json: bool) -> None:
    """Print a result on stdout: as JSON, or for people as the ``parts``.

    A sequence of dataclasses without parts is a table with a column for each field.
    """
    if as_json:
        # JSON has neither infinities nor NaN: they become null.
        print(
            plain(json.dumps(finite(as_values(result)), indent=2, ensure_ascii=False))
        )
        return
    if parts is None:
        parts = [
            [
                {name.replace("_", " "): value for name, value in _fields(row).items()}
                for row in result
            ]
        ]
    for part in parts:
        if isinstance(part, Sequence) and not isinstance(part, str):
            if part:
                out().print(table(part))
        elif isinstance(part, str) or (isinstance(part, Text) and part.no_wrap):
            out().print(part, soft_wrap=True)
        else:
            out().print(part)


def as_values(result: Any) -> Any:
    """Convert a value to what JSON can hold: a dataclass to its fields or its
    ``as_json()``, a path to its text.

    A field whose name ends in ``_`` is called by the keyword before it, and one that
    begins with ``_`` is left out.
    """
    if hasattr(result, "as_json"):
        return as_values(result.as_json())
    if dataclasses.is_dataclass(result) and not isinstance(result, type):
        return {
            name.rstrip("_"): as_values(value)
            for name, value in _fields(result).items()
        }
    if isinstance(result, Mapping):
        return {str(key): as_values(value) for key, value in result.items()}
    if isinstance(result, list | tuple):
        return [as_values(value) for value in result]
    return str(result) if isinstance(result, Path) else result


def _fields(result: Any) -> dict[str, Any]:
    names = (each.name for each in dataclasses.fields(result))
    return {name: getattr(result, name) for name in names if not name.startswith("_")}


def table(rows: Sequence[Mapping[str, Any]], **style: Any) -> Table:
    """Return a table of rows, whose keys are the headings; numbers stand to the right,
    and NaN is a dash."""
    made = Table(**({"box": None, "pad_edge": False, "padding": (0, 2, 0, 0)} | style))
    for heading, value in rows[0].items():
        made.add_column(
            heading,
            justify="right" if isinstance(value, int | float) else "left",
            overflow="fold",
        )
    for row in rows:
        made.add_row(*map(cell, row.values()))
    return made


def listing(entries: Iterable[tuple[str, Any]], **style: Any) -> Table:
    """Return a table without a head: a name and what it stands for in each line."""
    made = Table.grid(padding=(0, 2))
    made.add_column(**({"style": "dim", "overflow": "fold"} | style))
    made.add_column(overflow="fold")
    for name, value in entries:
        made.add_row(name, cell(value))
    return made


def cell(value: Any) -> str | Text:
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.3g}"
    return value if isinstance(value, Text) else Text(plain(str(value)))


def styled(style: str, words: str, rest: str = "") -> Text:
    """Return a line that begins with words in a style."""
    return Text.assemble((plain(words), style), plain(rest), no_wrap=True)


def percent(share: float, *, unknown: str = "-") -> str:
    """Return a share as a percentage; ``unknown`` if it is NaN.

    >>> percent(0.25), percent(float("nan"))
    ('25 %', '-')
    """
    return unknown if math.isnan(share) else f"{100 * share:.0f} %"


def live_display() -> AbstractContextManager[Live | None]:
    """Return a display on stderr that is redrawn in place; ``None`` where stderr is not
    a terminal."""
    console = log()
    return (
        Live(console=console, auto_refresh=False, transient=True)
        if console.replaces_lines
        else nullcontext()
    )


MOST_LETTERS = 4000
"""Letters of a message that are printed: what it quotes may come from anywhere."""


def print_error(message: str) -> None:
    print(plain(f"tactophone: {_bounded(message)}"), file=sys.stderr)


def _bounded(message: str) -> str:
    """Leave out the middle of a message too long to read: its end says what to do."""
    left_out = len(message) - MOST_LETTERS
    if left_out <= 0:
        return message
    half = MOST_LETTERS // 2
    return f"{message[:half]} ... ({left_out} letters) ... {message[-half:]}"


def note(line: str) -> None:
    """Print a line for people on stderr; one that ends in a carriage return stands
    until the next.

    From any thread: one besides the main thread goes on where the line cannot be
    written.
    """
    text = _bounded(line.rstrip("\r"))
    stands = not line.endswith("\r") or not log().replaces_lines
    try:
        log().print(text, soft_wrap=True, end="\n" if stands else "\r")
    except (OSError, SystemExit):  # the latter is a broken pipe
        if threading.current_thread() is threading.main_thread():
            raise


def warn(line: str) -> None:
    """Print what has gone wrong in a run that goes on, as `note` does."""
    note(f"! {line}")


@contextmanager
def progress(
    description: str, total: float | None = None, *, note: str = ""
) -> Iterator[Callable[..., None]]:
    """Show a progress bar on stderr, where that is a terminal.

    Yields the function that updates it, by ``completed`` or ``advance``, ``total`` and
    ``note``.
    """
    columns = (
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}", markup=False),
    )
    with Progress(
        TextColumn(description, markup=False),
        *columns,
        console=log(),
        transient=True,
        disable=not log().replaces_lines,
    ) as bar:
        yield functools.partial(bar.update, bar.add_task("", total=total, note=note))


@contextmanager
def tracked(
    entries: Iterable[Entry], description: str, total: float | None = None
) -> Iterator[Iterator[Entry]]:
    """Yield an iterator over entries that a progress bar counts; ``total`` is by
    default their length."""

    def counted() -> Iterator[Entry]:
        for entry in entries:
            yield entry
            update(advance=1)

    with progress(
        description, len(entries) if isinstance(entries, Sized) else total
    ) as update:
        yield counted()


@contextmanager
def as_private_as(*sources: Path) -> Iterator[None]:
    """Let nobody else read what is written meanwhile, where nobody else may read one of
    the files that it is made from."""
    kept = 0
    for source in sources:
        with suppress(OSError):  # whoever reads it says so
            mode = source.stat().st_mode
            kept |= 0 if mode & stat.S_IRGRP else stat.S_IRWXG
            kept |= 0 if mode & stat.S_IROTH else stat.S_IRWXO
    before = os.umask(0o777)
    os.umask(before | kept)
    try:
        yield
    finally:
        os.umask(before)


def make_folder(path: Path, option: str = "--out") -> None:
    """Make a folder for results, unless it exists; raises `ConfigError` if nothing can
    be written there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"{option} {path}: cannot be made ({error.strerror}); name a folder of "
            "your own"
        ) from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise ConfigError(
            f"{option} {path}: nothing can be written there; name a folder of your own"
        )


def refuse_unwritable(path: Path, option: str = "--out") -> None:
    """Raise `ConfigError` if a file for results cannot be written: a verb asks before a
    person strokes anything, or hours of training."""
    if path.is_dir():
        raise ConfigError(f"{option} {path}: is a folder; name a file")
    folder = next(each for each in path.absolute().parents if each.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigError(
            f"{option} {path}: nothing can be written there; name a file in a folder "
            "of your own"
        )
