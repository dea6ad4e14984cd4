"""What a person sees and can press while a side runs in its own process: one line, and the news under it."""

import contextlib
import signal
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.live import Live
from rich.text import Text

from tactophone.cli._support import keyboard as keys
from tactophone.cli._support import terminal
from tactophone.errors import TactophoneError
from tactophone.runtime import Supervisor
from tactophone.telemetry import Action, Snapshot, State, Watcher
from tactophone.types import Touch

EVERY = 0.2
"""Seconds between two looks; a person reads no faster, and this process also hosts the watchdog."""

KEYS: dict[str, Action] = {" ": "stop", "m": "mute", "a": "arm"}
"""Which key asks for what; `q` ends the run."""

HELP = "space: emergency stop   m: mute   a: arm   q: quit"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run went: the last look at it, if it ever lived."""

    last: Snapshot | None
    restarts: int


def follow(supervisors: Sequence[Supervisor], name: str, *, duration: float = 0.0) -> Outcome:
    """Show a run until a side ends by itself, somebody quits, or the time is over.

    Parameters
    ----------
    supervisors
        Of the sides that run; the first to end by itself ends all.
    name
        Of the run that is shown and asked.
    duration
        Seconds; 0 is for ever.
    """
    face = _ConsoleView(name)
    until = time.monotonic() + duration if duration else float("inf")
    with _signals(supervisors), keys.listening() as keyboard, _live(keyboard=keyboard) as live:
        while time.monotonic() < until and all(side.running for side in supervisors):
            face.look()
            if live is not None:
                live.update(face.line(), refresh=True)
            if keyboard and not face.press(keys.pressed(EVERY)):
                break
            if not keyboard and supervisors[0].wait(min(EVERY, max(0.0, until - time.monotonic()))):
                break
    return Outcome(face.last, sum(side.restarts for side in supervisors))


class _ConsoleView:
    def __init__(self, name: str) -> None:
        self.last: Snapshot | None = None
        self._name = name
        self._watcher: Watcher | None = None
        self._said: dict[str, str] = {}

    def look(self) -> None:
        """Take a look, and say what is new in words."""
        if self._watcher is None or (self.last and not self.last.alive):
            with contextlib.suppress(TactophoneError):
                self._watcher = Watcher(self._name)
        if self._watcher is not None:
            self.last = self._watcher.snapshot()
            self._tell(self.last.state)

    def press(self, key: str) -> bool:
        """Do what a key asks; false when it asks to end."""
        if key in KEYS and self._watcher is not None:
            self._watcher.ask(KEYS[key])
        return key not in ("q", "\x03", "\x04")

    def line(self) -> Text:
        """What is felt now, in one line."""
        if self.last is None or not self.last.alive:
            return Text("waiting for the sound ...", style="yellow")
        return _line(self.last)

    def _tell(self, state: State) -> None:
        news = {fault.code: f"! {fault.text}" for fault in state.faults} | {"line": state.link}
        if state.role == "operator":
            news["muted"] = f"muted: {state.muted_because}" if state.muted_because else "armed"
        for code, words in news.items():
            if self._said.get(code) != words:
                terminal.log().print(words, soft_wrap=True)
        self._said = news


def _live(*, keyboard: bool) -> contextlib.AbstractContextManager[Live | None]:
    """Make the line that changes, where there is a terminal to change it on."""
    console = terminal.log()
    if keyboard:
        console.print(Text(HELP, style="dim"))
    return (
        Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else contextlib.nullcontext()
    )


def _line(snapshot: Snapshot) -> Text:
    sound = np.abs(snapshot.sound[-4800:]).max(axis=0, initial=1e-6)
    contact, air = 20 * np.log10(np.maximum(sound, 1e-6))
    parts = [f"contact {contact:4.0f}  air {air:4.0f} dBFS"]
    if snapshot.ticks.size and snapshot.state.role == "operator":
        tick = snapshot.ticks[-1]
        parts.append(f"{Touch(tick['touch']).name.lower():6} {tick['frequency']:3.0f} Hz {tick['amplitude']:4.2f}")
    counters = snapshot.counters
    packets = counters["packets_received"] or counters["packets_sent"]
    parts.append(f"{counters['packets_lost']} lost of {packets}")
    total = snapshot.gauges["latency_total"]
    if np.isfinite(total):
        parts.append(f"{1000 * total:.1f} ms")
    style = "green" if snapshot.state.role != "operator" or snapshot.state.armed else "yellow"
    return Text("  ".join(parts), style=style, no_wrap=True, overflow="ellipsis")


@contextlib.contextmanager
def _signals(supervisors: Sequence[Supervisor]) -> Iterator[None]:
    """SIGTERM ends the run in order; SIGUSR1 stops all vibration and lets the run go on."""

    def end(*_: object) -> None:
        raise KeyboardInterrupt

    def stop(*_: object) -> None:
        for side in supervisors:
            side.stop_emergency()

    before = [signal.signal(signal.SIGTERM, end), signal.signal(signal.SIGUSR1, stop)]
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGUSR1, before[1])
