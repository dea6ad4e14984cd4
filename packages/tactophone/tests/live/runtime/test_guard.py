"""What a command plays without a run is stopped and watched like one."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from tactophone.core.errors import TactophoneError
from tactophone.core.settings import OutputSettings, Settings, change
from tactophone.live.runtime import guard
from tactophone.live.runtime.guard import guarded
from tactophone.live.runtime.watchdog import SILENT_TIMEOUT
from tactophone.live.telemetry.layout import Action
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry

NAME = f"test-guard-{os.getpid()}"
ON_JACK = change(Settings(), ["output.actuator=jack"])
OF_ANOTHER_PACKAGE = replace(Settings(), output=OutputSettings(actuator="plugged-in"))
UNWATCHED = change(Settings(), ["process.watchdog=false"])


def ask(action: Action) -> None:
    watcher = Watcher(NAME)
    assert watcher.state().armed
    watcher.ask(action)
    time.sleep(5.0)


def send(number: signal.Signals) -> None:
    assert signal.getsignal(number) is not signal.SIG_DFL
    signal.raise_signal(number)


@pytest.mark.parametrize(
    "interrupt",
    [
        partial(ask, "stop"),
        partial(ask, "mute"),
        partial(send, signal.SIGUSR1),
        partial(send, signal.SIGTSTP),
    ],
    ids=["stop", "mute", "SIGUSR1", "SIGTSTP"],
)
def test_a_stop_interrupts_what_plays(interrupt: Callable[[], None]) -> None:
    """``tactophone stop`` said that there was nothing to ask, and the next burst
    came."""
    watchers: list[Watcher] = []

    def play() -> None:
        with guarded(UNWATCHED, NAME):
            watchers.append(Watcher(NAME))
            interrupt()

    with pytest.raises(KeyboardInterrupt):
        play()
    assert not watchers[0].state().armed
    assert Watcher.find(NAME) is None
    assert signal.getsignal(signal.SIGUSR1) is signal.SIG_DFL


def test_what_plays_is_shown_to_whoever_watches() -> None:
    with guarded(UNWATCHED, NAME) as made:
        render = made.watched(lambda outs: outs[0].fill(-0.25))
        for _ in range(3):
            render([np.zeros(128, np.float32)])
        pulse = Watcher(NAME).pulse()
        assert (pulse.callbacks, pulse.amplitude) == (3, 0.25)
        assert pulse.period == pytest.approx(128 / 48_000)


def test_a_process_that_stalls_while_it_vibrates_is_killed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    killed: list[tuple[int, int]] = []
    monkeypatch.setattr(guard.os, "kill", lambda *signal: killed.append(signal))
    monkeypatch.setattr(guard, "prioritize_thread", lambda _: "")
    now = iter(range(10_000))
    monkeypatch.setattr(guard.time, "monotonic", lambda: next(now) * 0.005)
    with Telemetry(NAME) as telemetry:
        telemetry.gauge("output_amplitude", 0.1)
        telemetry.count("callbacks")
        looks: list[float] = []

        class Alive:
            def tell(self, _: object) -> None:
                pass

            def wants_end(self, timeout: float) -> bool:
                looks.append(timeout)
                return False

        parent: Any = Alive()
        guard._watch(parent, Settings(), NAME, 4711)
    assert killed == [(4711, signal.SIGKILL)]
    assert sum(looks) < 0.1 < SILENT_TIMEOUT


class Watchdog:
    """Stands in for the watchdog's process."""

    def __init__(self, *words: tuple[str, str], alive: bool = True) -> None:
        self.words = words
        self.alive = alive

    def messages(self, _: float) -> Iterator[tuple[str, str]]:
        yield from self.words

    def kill(self) -> None:
        pass


def test_a_watchdog_that_ends_ends_what_plays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bursts went on unwatched after it was killed."""
    watchdog = Watchdog(("ready", ""))
    monkeypatch.setattr(guard, "Child", lambda *_, **__: watchdog)

    def play() -> None:
        with guarded(ON_JACK, NAME):
            watchdog.alive = False
            time.sleep(5.0)

    with pytest.raises(TactophoneError, match="without the watchdog's process"):
        play()


@pytest.mark.parametrize("words", [(), (("error", "no memory"),)])
@pytest.mark.parametrize("settings", [ON_JACK, OF_ANOTHER_PACKAGE])
def test_nothing_plays_where_the_watchdog_does_not_start(
    settings: Settings,
    words: tuple[tuple[str, str], ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An actuator of another package had no watchdog at all."""
    monkeypatch.setattr(guard, "Child", lambda *_, **__: Watchdog(*words))
    with pytest.raises(TactophoneError, match="without the watchdog's process"):
        guarded(settings, NAME).__enter__()
