import errno
import os
import pty
import signal
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tactophone.cli import console, live, page
from tactophone.cli.console import (
    ALONE,
    REFRESH_INTERVAL,
    RUN_KEYS,
    _ConsoleView,
    follow,
    keys_obeyed,
    read_key,
    single_keys,
)
from tactophone.core.settings import Settings
from tactophone.live.runtime import supervisor
from tactophone.live.runtime.supervisor import Supervisor
from tactophone.live.telemetry.layout import Action, RunState
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry

NAME = f"test-keyboard-{os.getpid()}"


class Own(Supervisor):
    """A side whose memory this process writes, and which notes its emergency stops."""

    stops = 0

    @property
    def pid(self) -> int:
        return os.getpid()

    def stop_emergency(self) -> None:
        self.stops += 1


@pytest.fixture
def side(monkeypatch: pytest.MonkeyPatch) -> Own:
    """A side that still starts."""
    side = Own(cast(Any, None), Settings(), name=NAME)
    side.state = "starting"
    monkeypatch.setitem(supervisor._sides, NAME, side)
    return side


@pytest.fixture
def running(side: Own) -> Own:
    side.state = "running"
    return side


@pytest.fixture
def typist(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The typing end of a terminal that the test has to itself."""
    typist, terminal = pty.openpty()
    with os.fdopen(terminal, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield typist
    os.close(typist)


def test_a_key_counts_without_enter(typist: int) -> None:
    with single_keys() as has_keyboard:
        assert has_keyboard
        for key in (b"m", b"a"):
            os.write(typist, key)
            assert read_key(1.0) == key.decode()


@pytest.mark.parametrize(
    ("typed", "key"),
    [
        (b"\x1b[a", ""),
        (b"\x1bOa", ""),
        (b"\x1ba", ""),
        (b"lamp", "m"),
        (b"a lamp", " "),
        (b"aaa", "a"),
        (b"ma ", " "),
        (b"\xc3\xa4a", ""),
        (b"A", "A"),
        (b"\x1b", ""),
        (b"\x1b\x1b", ""),
        (b"\x1b[A\x1b[Aa", ""),
        (b"\x1bOm", ""),
        (b"\x1bOq", ""),
    ],
    ids=repr,
)
def test_only_a_key_of_its_own_arms(typist: int, typed: bytes, key: str) -> None:
    """Shift with an arrow, Alt with a letter and a paste armed a stopped run."""
    with single_keys():
        os.write(typist, typed)
        assert read_key(1.0) == key
        assert read_key(0.0) == ""


@pytest.mark.parametrize(
    ("typed", "key"),
    [
        (b"\x1b ", " "),
        (b"\0", " "),
        ("\u00a0".encode(), " "),
        ("\u202f".encode(), " "),
        ("\u3000".encode(), " "),
        (b"\x1b\0", " "),
        (b"\x1b[A ", " "),
        (b"\x1b[1;5A \x1b[B", " "),
        (b"\x1bOA ", " "),
        (b"\x1b[ ", " "),
        (b"\x1b bn", " "),
        (b"\x1b\x1b \x1b", " "),
        (b"M", "m"),
        (b"\x1bm", "m"),
        (b"Q", "q"),
    ],
    ids=repr,
)
def test_what_silences_counts_in_any_company(
    typist: int, typed: bytes, key: str
) -> None:
    """The space bar did nothing with Alt, Ctrl or AltGr, or after an arrow."""
    with single_keys():
        os.write(typist, typed)
        assert read_key(1.0) == key
        assert read_key(0.0) == ""


def test_a_space_within_a_moment_of_an_arrow_counts(typist: int) -> None:
    with single_keys():
        os.write(typist, b"\x1b[A")
        assert read_key(1.0) == ""
        os.write(typist, b" ")
        assert read_key(1.0) == " "


def test_no_key_returns_an_empty_text(typist: int) -> None:
    with single_keys():
        assert read_key(0.0) == ""


def test_the_terminal_is_restored(typist: int) -> None:
    before = termios.tcgetattr(sys.stdin.fileno())
    with pytest.raises(KeyboardInterrupt), single_keys():
        raise KeyboardInterrupt
    assert termios.tcgetattr(sys.stdin.fileno()) == before


def test_a_pipe_is_not_a_keyboard(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with single_keys() as has_keyboard:
            assert not has_keyboard
    os.close(writing)


def test_the_space_bar_is_the_emergency_stop() -> None:
    assert RUN_KEYS[" "] == "stop"


def test_without_a_standard_input_there_is_no_keyboard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As after ``tactophone loopback <&-``."""
    monkeypatch.setattr("sys.stdin", None)
    with single_keys() as keyboard:
        assert not keyboard


def test_in_the_background_there_is_no_keyboard_and_none_is_read(
    typist: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system stops whoever takes the keys there: ``tactophone loopback &``."""
    monkeypatch.setattr("os.tcgetpgrp", lambda _: os.getpgrp() + 1)
    before = termios.tcgetattr(sys.stdin.fileno())
    with single_keys() as keyboard:
        assert not keyboard
    assert termios.tcgetattr(sys.stdin.fileno()) == before
    os.write(typist, b"m\n")
    assert read_key(0.0) == ""


def test_a_run_that_goes_to_the_background_leaves_the_terminal_as_it_is(
    typist: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    with single_keys():
        during = termios.tcgetattr(sys.stdin.fileno())
        monkeypatch.setattr("os.tcgetpgrp", lambda _: os.getpgrp() + 1)
    assert termios.tcgetattr(sys.stdin.fileno()) == during


def test_ctrl_s_holds_nothing_up_while_keys_are_read(typist: int) -> None:
    """A terminal that stood still took the space bar away."""
    with single_keys():
        assert not termios.tcgetattr(sys.stdin.fileno())[0] & termios.IXON
        os.write(typist, b"\x13")
        assert read_key(1.0) == "\x13"


def test_a_terminal_that_is_gone_is_no_key(
    typist: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone(*_: object) -> bytes:
        raise OSError

    os.write(typist, b"m\n")
    monkeypatch.setattr("tactophone.cli.console.os.read", gone)
    assert read_key(0.01) == ""


def test_keys_are_obeyed_while_the_terminal_stands_still(
    running: Own, typist: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever writes to it waits, as where its window is suspended."""
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())

        def stand_still(_: object) -> None:
            for key, action in ((b" ", "stop"), (b"q", "mute")):
                os.write(typist, key)
                end = time.monotonic() + 5.0
                while not (asked := telemetry.requests()):
                    assert time.monotonic() < end
                    time.sleep(0.01)
                assert [request.action for request in asked] == [action]

        monkeypatch.setattr(_ConsoleView, "update", stand_still)
        side = SimpleNamespace(running=True, restarts=0, wait=lambda _: False)
        with keys_obeyed(NAME) as keys:
            follow([cast(Supervisor, side)], keys)


@pytest.mark.parametrize("key", RUN_KEYS)
def test_keys_are_obeyed_from_before_a_run_starts_until_it_has_ended(
    running: Own, key: str, typist: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """While a log or a bridge started, and while one ended, what vibrated was deaf."""
    found: list[list[str]] = []

    def type_and_see() -> None:
        os.write(typist, key.encode())
        time.sleep(ALONE + 0.2)
        found.append([request.action for request in telemetry.requests()])

    @contextmanager
    def sides() -> Iterator[list[Supervisor]]:
        type_and_see()
        yield [cast(Supervisor, SimpleNamespace(running=False, restarts=0))]
        telemetry.requests()
        type_and_see()

    monkeypatch.setattr(page, "wanted", lambda *_: False)
    args = SimpleNamespace(
        verb="receive",
        record=[tmp_path / "run.csv"],
        bridge=[],
        duration=0.0,
        json=True,
    )
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        live.follow(args, Settings(), sides(), NAME)
    # Once it ends, nothing arms any more.
    assert found == [[RUN_KEYS[key]], [RUN_KEYS[key]] if key != "a" else []]


@pytest.mark.parametrize("heir", [False, True])
def test_keys_reach_a_run_whose_memory_has_lost_its_name(
    running: Own, heir: bool, typist: int
) -> None:
    """Another run may have taken it, and was stopped instead."""
    with Telemetry(NAME) as telemetry, ExitStack() as stack:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        with keys_obeyed(NAME):
            time.sleep(2 * REFRESH_INTERVAL)
            Path(f"/dev/shm/tactophone-{NAME}").unlink()
            if heir:
                other = stack.enter_context(Telemetry(NAME))
                other.update(RunState(role="operator"), now=time.monotonic())
            os.write(typist, b" ")
            time.sleep(REFRESH_INTERVAL)
            asked = [request.action for request in telemetry.requests()]
    assert asked == ["stop"]


@pytest.mark.parametrize(
    ("pieces", "gap", "asked"),
    [
        (["a"], 0.0, ["arm"]),
        (["aaa"], 0.0, []),
        (list("banana"), 0.0, []),
        (list("banana"), 0.02, []),
        (list("hi a"), 0.02, ["stop"]),
        (["\x1b", "a"], 0.03, []),
        (["m", "a"], 2 * ALONE, ["arm", "mute"]),
    ],
    ids=["alone", "held", "slow", "slower", "stop", "escape", "two"],
)
def test_no_paste_arms_however_it_comes(
    pieces: list[str], gap: float, asked: list[str], typist: int, running: Own
) -> None:
    """Its last letter, or each of them on a slow line, was taken for a key."""
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        with keys_obeyed(NAME):
            for piece in pieces:
                os.write(typist, piece.encode())
                time.sleep(gap)
            time.sleep(2 * ALONE + REFRESH_INTERVAL)
            requests = telemetry.requests()
    assert sorted(request.action for request in requests) == asked


@pytest.mark.parametrize("silenced", ["stop", "mute"])
def test_the_key_that_arms_releases_nothing_that_came_after_it(
    silenced: Action, typist: int, running: Own, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It waits whether it is part of a paste, and then released a stop of meanwhile."""
    waits = console._waits

    def meanwhile(seconds: float) -> bool:
        if seconds == ALONE:
            Watcher(NAME).ask(silenced)
        return waits(seconds)

    monkeypatch.setattr(console, "_waits", meanwhile)
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        with keys_obeyed(NAME):
            time.sleep(2 * REFRESH_INTERVAL)
            os.write(typist, b"a")
            asked: list[str] = []
            for _ in range(100):
                time.sleep(REFRESH_INTERVAL)
                asked += [request.action for request in telemetry.requests()]
                if asked:
                    break
            time.sleep(2 * ALONE)
            asked += [request.action for request in telemetry.requests()]
    assert asked == [silenced]


def test_no_memory_at_a_key_takes_no_key_away(
    running: Own, typist: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread of the keys ended with a traceback, and the run went on."""

    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        with keys_obeyed(NAME):
            time.sleep(2 * REFRESH_INTERVAL)
            monkeypatch.setattr(Watcher, "find", full)
            monkeypatch.setattr(Watcher, "follow", full)
            os.write(typist, b" ")
            time.sleep(2 * REFRESH_INTERVAL)
            asked = [request.action for request in telemetry.requests()]
    assert asked == ["stop"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_run_ends_where_its_keys_fail(
    typist: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing = threading.Event()

    def fail(_: float) -> bytes:
        failing.wait(5.0)
        raise RuntimeError("a mistake of ours")

    monkeypatch.setattr("tactophone.cli.console._typed", fail)
    with keys_obeyed(NAME) as keys:
        keys.following.set()
        failing.set()
        assert keys.ending.wait(5.0)


@pytest.mark.parametrize("key", [" ", "m", "q", "a"])
def test_what_silences_is_kept_for_a_run_that_is_not_there_yet(
    key: str, typist: int, side: Own, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The space bar did nothing in the first seconds of a start."""
    monkeypatch.delitem(supervisor._sides, NAME)
    with keys_obeyed(NAME) as keys:
        keys.following.set()
        os.write(typist, key.encode())
        time.sleep(ALONE + REFRESH_INTERVAL)
        monkeypatch.setitem(supervisor._sides, NAME, side)
        end = time.monotonic() + 5.0
        while not side.stops and key != "a" and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(2 * REFRESH_INTERVAL)
        assert side.stops == (key != "a")
        assert keys.ending.is_set() == (key == "q")


def start_with_keys(typist: int, key: str = "") -> None:
    with keys_obeyed(NAME):
        os.write(typist, key.encode())
        time.sleep(5.0)
        pytest.fail("it has started")


@pytest.mark.parametrize("key", ["q", "\x04"])
def test_a_key_that_ends_a_run_ends_its_start(key: str, typist: int, side: Own) -> None:
    """It went on, and the finger began to vibrate."""
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as ended:
        start_with_keys(typist, key)
    assert ended.value.code == 0
    assert side.stops == 1
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize("key", RUN_KEYS)
def test_the_keys_of_a_start_reach_no_other_run_of_its_name(
    key: str, typist: int, side: Own
) -> None:
    """`a` released the emergency stop of a run that goes on in another terminal."""
    with Telemetry(NAME) as other, keys_obeyed(NAME):
        other.update(RunState(role="operator"), now=time.monotonic())
        os.write(typist, key.encode())
        time.sleep(ALONE + 2 * REFRESH_INTERVAL)
        assert not other.requests()
        assert side.stops == (key != "a")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_start_ends_where_its_keys_fail(
    typist: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: float) -> bytes:
        raise RuntimeError("a mistake of ours")

    monkeypatch.setattr("tactophone.cli.console._typed", fail)
    with pytest.raises(SystemExit):
        start_with_keys(typist)
