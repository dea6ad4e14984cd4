"""A bridge in a process of its own: it can neither delay the sound nor end it."""

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Protocol, Self

from tactophone.core.errors import TactophoneError
from tactophone.core.processes import Child, Parent
from tactophone.core.types import ignore

BRIDGE_START_PATIENCE = 20.0
"""Seconds of waiting for a bridge to import its libraries and begin, after which the
user is told; a busy machine takes this long."""

BRIDGE_START_TIMEOUT = 120.0
"""Seconds after which a bridge that has not begun ends the start of the run."""

BRIDGE_END_TIMEOUT = 5.0
"""Seconds that a bridge may take to pass on what is left and to end."""

BRIDGE_NICENESS = 5
"""On a busy machine a bridge waits, not the sound."""


class Bridge(AbstractContextManager[Any, None], Protocol):
    """What runs in the process: entered, then `read` at its interval (s), then left."""

    @property
    def interval(self) -> float:
        """Seconds between two reads."""

    @property
    def title(self) -> str:
        """What messages call it: "the OSC bridge"."""

    def lost(self) -> str:
        """Return what was lost as this process or its receiver was too late, the oldest
        first, with its unit; empty if nothing."""

    def read(self) -> None:
        """Pass on what is new; an expected error ends the bridge, and the run goes
        on."""


class BridgeProcess:
    """Runs a bridge while the context lasts.

    ``build`` must be picklable. ``report`` is called with a line, from another thread,
    when the bridge ends by itself or does not end in order; a bridge that has not ended
    ``end_timeout`` s after it was asked to is killed. ``unfinished`` says what a bridge
    that did not end in order leaves behind. Raises `TactophoneError` when the bridge
    cannot begin: its file cannot be written, its library is missing.
    """

    def __init__(
        self,
        build: Callable[[], Bridge],
        *,
        report: Callable[[str], None] = ignore,
        end_timeout: float = BRIDGE_END_TIMEOUT,
        unfinished: str = "what it drove may keep its last value",
    ) -> None:
        bridge: Any = getattr(build, "func", build)
        self._name: str = bridge.title
        self._report = report
        self._end_timeout = end_timeout
        self._unfinished = unfinished
        self._asked_to_end = False
        # Set before the kill, so that the thread which sees the end knows its cause.
        self._overdue = False
        self._child = Child(
            _run, build, name="tactophone-bridge", niceness=BRIDGE_NICENESS
        )
        self.pid = self._child.pid
        self._thread = threading.Thread(target=self._follow, name="bridge", daemon=True)

    def __enter__(self) -> Self:
        kind, text = self._first_message()
        if kind != "ready":
            self._end()
            raise TactophoneError(text)
        self._thread.start()
        return self

    def _first_message(self) -> tuple[str, str]:
        begun = time.monotonic()
        while True:
            asked = time.monotonic()
            message = next(self._child.messages(BRIDGE_START_PATIENCE), None)
            if message is not None:
                return message
            now = time.monotonic()
            if not self._child.alive or now - asked < BRIDGE_START_PATIENCE:
                # Its end of the pipe was closed, which only its own end does.
                return "", f"{self._name} did not begin ({self._child.how_ended()})"
            if now - begun >= BRIDGE_START_TIMEOUT:
                waited = f"{BRIDGE_START_TIMEOUT:g} s"
                return "", f"{self._name} did not begin within {waited}"
            self._report(f"{self._name} still starts ({now - begun:.0f} s)")

    def __exit__(self, *_: object) -> None:
        self._end()
        if self._thread.is_alive():
            self._thread.join()

    def _follow(self) -> None:
        told = [
            text
            for kind, text in self._child.messages(None)
            if kind in ("error", "progress")
        ]
        how = self._child.how_ended()
        if told:
            self._report(told[-1])
        if not how:
            return
        if self._overdue:
            waited = f"{self._end_timeout:g} s"
            self._report(
                f"{self._name} had not ended after {waited} and was killed: "
                f"{self._unfinished}"
            )
        elif self._asked_to_end:
            self._report(
                f"{self._name} did not end in order ({how}): {self._unfinished}"
            )
        elif not told:
            self._report(
                f"{self._name} ended ({how}): the run goes on without it, and "
                f"{self._unfinished}"
            )

    def _end(self) -> None:
        self._asked_to_end = True
        self._child.ask_to_end()
        self._overdue = not self._child.wait(self._end_timeout)
        self._child.kill()


def _run(parent: Parent, build: Callable[[], Bridge]) -> None:
    try:
        with build() as bridge:
            parent.tell(("ready", ""))
            while not parent.wants_end(bridge.interval):
                bridge.read()
            bridge.read()
            if lost := bridge.lost():
                parent.tell(("progress", f"{bridge.title} came too late for {lost}"))
    except ModuleNotFoundError as error:
        raise TactophoneError(
            f"{error.name} is not installed: see the extras in docs/guide/bridges.md"
        ) from None
