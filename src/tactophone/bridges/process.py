"""A bridge in a process of its own: it can neither delay the sound nor end it."""

import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Protocol, Self

from tactophone.child_processes import ChildContext
from tactophone.errors import TactophoneError

START_TIMEOUT = 20.0
"""Seconds that a bridge may take to import its libraries and begin."""

END_TIMEOUT = 5.0
"""Seconds that a bridge may take to end, for a log to write its index."""

NICENESS = 5
"""On a busy machine a bridge waits, not the sound."""

_READY = ""


class Bridge(Protocol):
    """What runs in the process: entered, then `read` at its interval (s), then left."""

    @property
    def interval(self) -> float:
        """Seconds between two reads."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def read(self) -> None:
        """Pass on what is new; an expected error ends the bridge, and the run goes on."""


class BridgeProcess:
    """Runs a bridge while the context lasts.

    ``build`` must be picklable. ``report`` is called with a line when the bridge ends by itself, from another thread.
    Raises `TactophoneError` when the bridge cannot begin: its file cannot be written, its library is missing.
    """

    def __init__(self, build: Callable[[], Bridge], *, report: Callable[[str], None] = lambda line: None) -> None:
        self._build, self._report = build, report
        self._asked_to_end = False
        context = ChildContext()
        self._lines, child = context.Pipe()
        self._process = context.Process(target=_run, args=(build, child), name="tactophone-bridge", daemon=True)
        self._process.start()
        child.close()
        self._thread = threading.Thread(target=self._follow, name="bridge", daemon=True)

    @property
    def pid(self) -> int:
        """Of the bridge's process."""
        return self._process.pid or 0

    def __enter__(self) -> Self:
        first = self._next_line(START_TIMEOUT)
        if first != _READY:
            self._end()
            raise TactophoneError(first or "a bridge ended before it began")
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        if self._thread.is_alive():
            self._thread.join()

    def _next_line(self, timeout: float | None) -> str | None:
        try:
            return str(self._lines.recv()) if self._lines.poll(timeout) else "a bridge did not begin in time"
        except (EOFError, OSError):
            return None

    def _follow(self) -> None:
        while (line := self._next_line(None)) is not None:
            self._report(line)
        self._process.join()
        code = self._process.exitcode
        if code and not self._asked_to_end:
            name = getattr(self._build, "func", self._build).__name__
            how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
            self._report(f"{name} ended ({how}): the run goes on without it, and what it drove may keep its last value")

    def _end(self) -> None:
        self._asked_to_end = True
        with suppress(OSError):  # when it has ended by itself
            self._lines.send(None)  # asks it to end in order
        self._process.join(END_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _run(build: Callable[[], Bridge], lines: Connection) -> None:
    os.nice(NICENESS)
    try:
        with build() as bridge:
            lines.send(_READY)
            # The pipe wakes up for the parent's word and for its death alike.
            while not lines.poll(bridge.interval):
                bridge.read()
            bridge.read()
    except TactophoneError as error:
        lines.send(str(error))
    except ModuleNotFoundError as error:
        lines.send(f"{error.name} is not installed: see the extras in docs/guide/bridges.md")
