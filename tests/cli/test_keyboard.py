import os
import pty
import sys
import termios
from collections.abc import Iterator

import pytest

from tactophone.cli._support import keyboard as keys


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A terminal of the test's own; gives the end at which one types."""
    typist, terminal = pty.openpty()
    with os.fdopen(terminal, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield typist
    os.close(typist)


def test_a_key_counts_without_enter(keyboard: int) -> None:
    with keys.listening() as there:
        assert there
        os.write(keyboard, b"ma")
        assert [keys.pressed(1.0), keys.pressed(1.0)] == ["m", "a"]


def test_no_key_is_no_news(keyboard: int) -> None:
    with keys.listening():
        assert keys.pressed(0.0) == ""


def test_the_terminal_is_left_as_it_was(keyboard: int) -> None:
    before = termios.tcgetattr(sys.stdin.fileno())
    with pytest.raises(KeyboardInterrupt), keys.listening():
        raise KeyboardInterrupt
    assert termios.tcgetattr(sys.stdin.fileno()) == before


def test_a_pipe_is_no_keyboard(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with keys.listening() as there:
            assert not there
    os.close(writing)
