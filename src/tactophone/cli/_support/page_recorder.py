"""A log begun and ended by the page's button: `--record` for whoever sits at this machine, in the middle of a run."""

import threading
import time
from collections.abc import Callable
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

from tactophone.bridges import BridgeProcess, McapLog
from tactophone.cli._support import extras
from tactophone.errors import TactophoneError


class PageRecorder:
    """Obeys the page's process, and answers it; a context manager that ends a log that is still open.

    ``report`` is called with a line when a log begins, ends, or fails, from another thread.

    Attributes
    ----------
    page
        The page's end: it sends true to begin and false to end, and receives what a page shows.
    """

    def __init__(self, name: str, folder: Path, *, report: Callable[[str], None] = lambda line: None) -> None:
        self._name, self._folder, self._report = name, folder, report
        self._orders, self.page = Pipe()
        self._log: BridgeProcess | None = None
        self._path = folder
        self._thread = threading.Thread(target=self._follow, name="page-recorder", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.page.close()
        self._thread.join()
        self._end()

    def _follow(self) -> None:
        while (order := _receive(self._orders)) is not None:
            try:
                if order and self._log is None:
                    self._begin()
                elif not order:
                    self._end()
                self._answer({"recording": str(self._path) if self._log else ""})
            except TactophoneError as error:
                self._answer({"refused": str(error)})

    def _begin(self) -> None:
        extras.require_modules("mcap", "zstandard")
        self._path = (self._folder / f"{self._name}-{time.strftime('%Y%m%d-%H%M%S')}.mcap").absolute()
        log = BridgeProcess(partial(McapLog, self._name, self._path), report=self._fail)
        log.__enter__()
        self._log = log
        self._report(f"recording to {self._path}")

    def _end(self) -> None:
        log, self._log = self._log, None
        if log is not None:
            log.__exit__()
            self._report(f"recorded: {self._path}")

    def _fail(self, line: str) -> None:
        """Pass on why the log ended by itself, from its thread: a full disk."""
        self._report(line)
        self._answer({"recording": "", "refused": line})

    def _answer(self, words: dict[str, Any]) -> None:
        try:
            self._orders.send(words)
        except OSError:  # the page has ended; the run goes on
            return


def _receive(orders: Connection) -> bool | None:
    try:
        return bool(orders.recv())
    except (EOFError, OSError):
        return None
