"""``tactophone stop``, ``mute`` and ``arm``: requests to an operator process, from any terminal of its machine."""

import argparse
import contextlib
import os
import signal
import time

from tactophone.cli._support import terminal
from tactophone.errors import TactophoneError
from tactophone.telemetry import Action, State, Watcher, running

TIMEOUT = 1.0
"""Seconds for a process to carry out a request; it looks for requests fifty times as often."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare which process is meant."""
    parser.add_argument("name", nargs="?", help="of the process, as set by --name; default: all operators' here")


def run(args: argparse.Namespace) -> int:
    """Send the request, wait until it is carried out, and print the new state; 1 if a process did not obey."""
    names = [args.name] if args.name else running()
    watchers = [watcher for name in names if (watcher := Watcher(name)).snapshot().state.role == "operator"]
    if not watchers:
        raise TactophoneError("no operator process here to ask: start `tactophone receive` or loopback")
    return max([_ask(watcher, args.verb) for watcher in watchers])


def _ask(watcher: Watcher, action: Action) -> int:
    watcher.ask(action)
    if action == "stop":
        # A signal besides the request: the process may look at its requests too late.
        with contextlib.suppress(ProcessLookupError):
            os.kill(watcher.pid, signal.SIGUSR1)
    deadline = time.monotonic() + TIMEOUT
    while not _done(state := watcher.snapshot().state, action):
        if time.monotonic() > deadline:
            terminal.print_error(f"{watcher.name} did not {action} within {TIMEOUT:g} s: end process {watcher.pid}")
            return 1
        time.sleep(0.01)
    terminal.out().print(f"{watcher.name}: {state.muted_because or 'armed'}")
    return 0


def _done(state: State, action: Action) -> bool:
    return state.armed if action == "arm" else not state.armed
