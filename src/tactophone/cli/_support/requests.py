"""Asking runs on this machine for something, from another terminal."""

import argparse
import contextlib
import os
import signal
import time

from tactophone.cli._support import terminal
from tactophone.errors import TactophoneError
from tactophone.telemetry import Action, State, Watcher, running

PATIENCE = 1.0
"""Seconds for a run to do what it is asked; it looks fifty times as often."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare which run is meant."""
    parser.add_argument("name", nargs="?", help="of the run, as --name gave it; default: all operators' runs here")


def ask(args: argparse.Namespace, action: Action) -> int:
    """Ask, wait for the answer, and print it; 1 when a run did not do it."""
    watchers = [watcher for name in _names(args) if (watcher := Watcher(name)).snapshot().state.role == "operator"]
    if not watchers:
        raise TactophoneError("no operator's run here to ask: start `tactophone receive` or loopback")
    return max(_ask(watcher, action) for watcher in watchers)


def _names(args: argparse.Namespace) -> list[str]:
    return [args.name] if args.name else running()


def _ask(watcher: Watcher, action: Action) -> int:
    watcher.ask(action)
    if action == "stop":
        with contextlib.suppress(ProcessLookupError):
            os.kill(watcher.pid, signal.SIGUSR1)  # twice is safer than once: the mailbox may be looked at too late
    until = time.monotonic() + PATIENCE
    while not _done(state := watcher.snapshot().state, action):
        if time.monotonic() > until:
            terminal.complain(f"{watcher.name} did not {action} within {PATIENCE:g} s: end process {watcher.pid}")
            return 1
        time.sleep(0.01)
    terminal.out().print(f"{watcher.name}: {state.muted_because or 'armed'}")
    return 0


def _done(state: State, action: Action) -> bool:
    return state.armed if action == "arm" else not state.armed
