"""However a run is left, its finger is silent before what shows and records it ends:
that may take a minute."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tactophone.app import runs, sources
from tactophone.cli import call, console, live, main, page
from tactophone.core.errors import DeviceError
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.prediction_log import PredictionLog
from tactophone.live.telemetry.writer import Telemetry

VERBS = {
    "receive": [],
    "loopback": ["--source", "file:stroke.wav"],
    "try": [],
    "call": ["--operator"],
    "answer": ["3-escapade-peachy", "--yes"],
}


class Ending(AbstractContextManager["Ending", None]):
    """Stands for a part of a run, and notes its end."""

    agent = None

    def __init__(self, end: Callable[[], object]) -> None:
        self.end = end

    def __exit__(self, *_: object) -> None:
        self.end()

    def begin(self) -> None: ...

    def await_start(self) -> None: ...

    def say(self, progress: str) -> None: ...

    def steps(self) -> Iterator[Any]:
        return iter(())


@pytest.fixture
def ended(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[list[str]]:
    """Which parts of the run named after ``tmp_path`` have ended, in order, and what it
    was asked meanwhile; it is left by that way."""
    ended: list[str] = []

    def part(name: str) -> Callable[..., Ending]:
        def end() -> None:
            ended.extend(request.action for request in telemetry.requests())
            if name not in ended:
                ended.append(name)

        return lambda *_, **__: Ending(end)

    def follow(*_: object, **__: object) -> None:
        if way == "interrupted":
            raise KeyboardInterrupt
        if way == "error":
            raise DeviceError("the terminal is gone")

    def bridges(*_: object) -> Iterator[None]:
        if way == "no bridge":
            raise DeviceError("the OSC bridge did not begin")
        yield from ()

    @contextmanager
    def supervised(*sides: Ending) -> Iterator[tuple[Ending, ...]]:
        with sides[0]:
            yield sides

    for where, name, what in (
        (console, "follow", follow),
        (console, "keys_obeyed", part("keys")),
        (page, "shown", part("page")),
        (page, "announce", lambda *_, **__: None),
        (live, "print_outcome", lambda *_: part("figures")().end() or 0),
        (call, "_identity", lambda _: SimpleNamespace(name="pc", fingerprint="")),
        (call, "find_other_end", lambda *_: None),
        (call, "report_changes", lambda *_: None),
        (call, "hang_up_if_forgotten", lambda *_: None),
        (sources, "source_of", lambda *_, **__: (None, None)),
        (runs, "open_side", part("side")),
        (runs, "both_sides", part("side")),
        (runs, "_bridges", bridges),
        (PredictionLog, "__exit__", lambda *_: part("log")().end()),
    ):
        monkeypatch.setattr(where, name, what)
    for path, what in (
        ("live.runtime.supervisor.supervised", supervised),
        ("faces.web.server.watch", part("page")),
        ("net.call.process.CallProcess", part("call")),
    ):
        monkeypatch.setattr(f"tactophone.{path}", what)
    with Telemetry(f"test-{tmp_path.name}") as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        yield ended


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(
    "way", ["in order", "nothing recorded", "interrupted", "error", "no bridge"]
)
def test_a_run_is_muted_and_its_side_has_ended_before_anything_else_ends(
    verb: str, way: str, ended: list[str], tmp_path: Path
) -> None:
    """A call vibrated until its page, the page's log and its keys had ended."""
    record = ["--record", str(tmp_path / "run.csv")]
    arguments = [] if way == "nothing recorded" else record
    main([verb, *VERBS[verb], "--name", f"test-{tmp_path.name}", *arguments])
    expected = ["mute", "log", "side", "call", "keys", "page", "figures"]
    if way == "nothing recorded":
        expected.remove("log")
    elif way != "in order":
        expected.remove("figures")
    if verb not in ("call", "answer"):
        expected.remove("call")
    assert ended == expected


@pytest.mark.parametrize("way", ["in order"])
def test_a_service_manager_ends_a_call_in_order_that_waits_for_the_other_end(
    ended: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was ended by the signal itself, and told nobody."""

    def wait(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(call, "find_other_end", wait)
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with pytest.raises(SystemExit):
            main(["call", "--name", f"test-{tmp_path.name}"])
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)
    assert ended == ["side", "call"]
