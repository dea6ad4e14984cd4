"""The keys of a running operator process (emergency stop, mute, arm), and how single keys are read from a terminal."""

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tactophone.telemetry import Action

KEYS: dict[str, Action] = {" ": "stop", "m": "mute", "a": "arm"}
"""Which key makes which request; the space bar is the emergency stop, as it is the largest key."""

QUIT_KEYS = ("q", "\x03", "\x04")
"""Keys that end the run: q, Ctrl-C and Ctrl-D."""

HELP = "space: emergency stop   m: mute   a: arm   q: quit"


@contextmanager
def single_keys() -> Iterator[bool]:
    """Read keys as they are pressed, without Enter; yields whether there is a keyboard to read from."""
    if not sys.stdin.isatty() or os.name != "posix":
        yield False
        return
    import termios
    import tty

    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    try:
        tty.setcbreak(terminal)
        yield True
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def read_key(timeout: float) -> str:
    """Wait up to ``timeout`` seconds for a key; empty when none is pressed in time."""
    ready, _, _ = select.select([sys.stdin], [], [], timeout)
    return os.read(sys.stdin.fileno(), 1).decode(errors="ignore") if ready else ""
