import os
import pty
import sys
import termios
from collections.abc import Iterator

import pytest

from tactophone.cli.console import RUN_KEYS, read_key, single_keys


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
        os.write(typist, b"ma")
        assert [read_key(1.0), read_key(1.0)] == ["m", "a"]


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
