"""Where a guided command shows its steps and is answered: the terminal, and a page of this machine if there is one."""

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from types import TracebackType
from typing import Any, Self

from rich.console import Group
from rich.live import Live
from rich.text import Text

from tactophone.cli._support import keyboard, terminal
from tactophone.cli._support.meters import Meters
from tactophone.errors import TactophoneError

LAST_LOOK = 0.3
"""Seconds for which the page of a command that waits for nobody stays, so that it shows the end."""

DONE = "done"
"""Button that ends the page."""


class GuidePage:
    """A guided command's page; a context manager that shows an error and, with ``wait``, waits for *Done*."""

    def __init__(self, *, wait: bool) -> None:
        from tactophone.pages import serve_guide  # for --dashboard alone: it imports processes

        self._orders, page_end = Pipe()
        self._wait, self._finished = wait, False
        self._page = serve_guide(page_end)

    def __enter__(self) -> Self:
        terminal.note(f"page: {self._page.url}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if isinstance(error, TactophoneError):
                self.show(findings=[str(error)])
            if kind is None or isinstance(error, TactophoneError):
                self._await_done()
        finally:
            self._page.__exit__()

    def show(self, **entries: Any) -> None:
        """Show something on the page, in the words of ``static/guide.js``."""
        with suppress(OSError):  # the page's process has ended: the terminal goes on
            self._orders.send(entries)

    def pressed(self, timeout: float = 0.0) -> str:
        """Return the name of the button that was pressed, waiting up to ``timeout`` s; empty if none was.

        Without the page's process no button is ever pressed, and nothing is left to wait for at the end.
        """
        try:
            return str(self._orders.recv()) if self._orders.poll(timeout) else ""
        except (EOFError, OSError):
            return DONE if self._finished else ""

    def _await_done(self) -> None:
        if not self._wait:
            time.sleep(LAST_LOOK)
            return
        self._finished = True
        self.show(instruction="", picture="", state="finished", levels=[], buttons={DONE: "Done"})
        terminal.log().print("the page stays until Done is pressed on it, or Ctrl-C here")
        while self.pressed(1.0) != DONE:
            pass


@dataclass(frozen=True, slots=True)
class GuideScreen:
    """A guided command's terminal and page."""

    live: Live | None = None
    """Display of the terminal, where there is one."""
    has_keyboard: bool = False
    """Whether keys of the terminal answer."""
    page: GuidePage | None = None
    steps: tuple[str, ...] = ()

    @property
    def answers(self) -> bool:
        """Whether somebody can answer."""
        return self.has_keyboard or self.page is not None

    def begin(self, step: int) -> None:
        """Mark a step as the one now; all before it are done."""
        if self.page is not None:
            self.page.show(steps=self.steps, step=step)

    def offer(self, buttons: Mapping[str, str]) -> None:
        """Show buttons, by name, on the page; a second press of the last ones is dropped."""
        if self.page is not None:
            while self.page.pressed():
                pass
            self.page.show(buttons=dict(buttons))

    def show(self, meters: Meters, instruction: str, state: str) -> None:
        """Show an instruction, what to do now, and the levels of the microphones."""
        levels = meters.levels()
        if self.live is not None:
            rows = meters.rows(levels)
            self.live.update(
                Group(Text(instruction, style="bold"), *rows, Text(f" {state}", style="cyan")), refresh=True
            )
        if self.page is not None:
            self.page.show(instruction=instruction, state=state, levels=levels)

    def pressed(self, timeout: float = 0.0) -> str:
        """Return the key or the button that was pressed, waiting up to ``timeout`` s for each; empty if none was."""
        key = keyboard.read_key(timeout) if self.has_keyboard else ""
        return key or (self.page.pressed(timeout) if self.page is not None else "")
