"""``tactophone status``, ``stop``, ``mute`` and ``arm``: the runs of this machine, from
any of its terminals."""

import argparse
import contextlib
import os
import signal
import time
from dataclasses import dataclass

from tactophone.cli import options, output
from tactophone.core.errors import TactophoneError, did_you_mean
from tactophone.core.processes import began
from tactophone.live.telemetry.layout import Action
from tactophone.live.telemetry.memory import unreadable_runs
from tactophone.live.telemetry.watcher import Watcher, running, runs

EXAMPLES = {
    "status": ("tactophone status", "tactophone status --json"),
    "stop": ("tactophone stop", "tactophone stop receive"),
    "mute": ("tactophone mute", "tactophone mute receive"),
    "arm": ("tactophone arm", "tactophone arm receive"),
}

STATUS_TIMEOUT = 1.0
"""Seconds for a process to carry out a request; it looks for requests fifty times as
often."""


_VIBRATES = ("operator", "replay")
"""Roles of runs by which a finger vibrates: pages may feel a replay."""


OTHER_VERSION = "another version of Tactophone started it; use that one's command"
"""Said of a run whose memory this version cannot read."""


@dataclass(frozen=True, slots=True)
class RunStatus:
    """A run of this machine."""

    name: str
    role: str
    process: int
    link: str
    vibration: str
    """``armed``, or why it is muted; empty where nothing vibrates."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    if parser.get_default("verb") == "status":
        options.add_json(parser)
        return
    parser.add_argument(
        "name",
        nargs="?",
        help=(
            "name of the run, as `tactophone status` shows it (default: the only one "
            "that can vibrate here; stop takes all of them)"
        ),
    )


def run(args: argparse.Namespace) -> int:
    """List the runs; or send the request, wait until it is carried out, and return 1 if
    a process did not obey.

    A process that does not stop is killed.
    """
    if args.verb == "status":
        others = (
            RunStatus(name, "unknown", pid, "", OTHER_VERSION)
            for name, pid in unreadable_runs()
        )
        shown = sorted((*map(_run, runs()), *others), key=lambda status: status.name)
        if not shown:
            output.note("no run on this machine: `tactophone demo` makes one")
        output.show(shown, as_json=args.json)
        return 0
    watchers: list[Watcher] = []
    for watcher in runs(args.name or ""):
        if watcher.snapshot().state.role in _VIBRATES:
            watchers.append(watcher)
            # At once: neither the search for more, nor a run that stands still and is
            # waited for, must delay it.
            if args.verb == "stop":
                _ask(watcher, "stop")
    unseen = 0 if args.name and watchers else _signalled(args.name, args.verb)
    if not watchers and unseen:
        return 1
    if not watchers:
        raise _nobody_to_ask(args.name)
    if args.verb != "stop":
        if len(watchers) > 1 and not args.name:
            found = ", ".join(sorted(watcher.name for watcher in watchers))
            raise TactophoneError(
                f"{len(watchers)} runs can vibrate here ({found}): name the one to "
                f"{args.verb}"
            )
        if args.verb == "arm":
            # Of two runs of one name, the one that still has it.
            del watchers[1:]
            # Whoever stopped or muted while this command was starting did so after it
            # was entered.
            if watchers[0].silenced_at > began():
                raise TactophoneError(
                    f"somebody has stopped or muted {watchers[0].name} since this was "
                    "entered: enter it again"
                )
        for watcher in watchers:
            _ask(watcher, args.verb)
    codes = [_wait(watcher, args.verb) for watcher in watchers]
    if len(watchers) > 1:
        stopped = ", ".join(watcher.name for watcher in watchers)
        output.note(
            f"stopped all {len(watchers)} runs ({stopped}); `tactophone arm NAME` lets "
            "one vibrate again"
        )
    return max(unseen, *codes)


def _signalled(name: str | None, verb: Action) -> int:
    """Send an emergency stop to the runs that another version started, as a signal,
    which all versions obey; return 1 if there are any that a request is for.

    Whether they obey cannot be seen from here, so each is named.
    """
    found = 0
    for other, pid in unreadable_runs():
        if name not in (None, other):
            continue
        advice = f"`kill {pid}` ends it"
        if verb == "stop":
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGUSR1)
            advice = (
                "it got the stop as a signal, and whether it obeys cannot be seen from "
                f"here; {advice}"
            )
        elif name is None:
            continue
        found = 1
        output.print_error(f"{other} (process {pid}): {OTHER_VERSION}: {advice}")
    return found


def _nobody_to_ask(name: str | None) -> TactophoneError:
    names = running()
    if name and name not in names:
        there = (
            f"; there are {', '.join(names)}{did_you_mean(name, names)}"
            if names
            else ""
        )
        return TactophoneError(
            f"no run called {name}: start `tactophone receive` or loopback{there}"
        )
    others = f"; of {', '.join(names)} none vibrates" if names else ""
    return TactophoneError(
        f"no run here that vibrates: start `tactophone receive` or loopback{others}"
    )


def _run(watcher: Watcher) -> RunStatus:
    state = watcher.snapshot().state
    vibration = (state.muted_because or "armed") if state.role in _VIBRATES else ""
    return RunStatus(watcher.name, state.role, watcher.pid, state.link, vibration)


def _ask(watcher: Watcher, action: Action) -> None:
    watcher.ask(action)
    if action == "stop":
        # A signal besides the request: the process may look at its requests too late.
        # One that cannot be sent must not keep the other runs from being stopped.
        with contextlib.suppress(OSError):
            if watcher.exists:
                os.kill(watcher.pid, signal.SIGUSR1)


def _wait(watcher: Watcher, action: Action) -> int:
    """Wait until a request is carried out, say so, and return 1 if it is not."""
    deadline = time.monotonic() + STATUS_TIMEOUT
    while (state := watcher.snapshot().state).armed is not (action == "arm"):
        if time.monotonic() > deadline:
            if action == "stop":
                return _kill(watcher)
            output.print_error(
                f"{watcher.name} did not {action} within {STATUS_TIMEOUT:g} s: "
                f"`tactophone stop {watcher.name}` ends its process"
            )
            return 1
        time.sleep(0.01)
    output.out().print(f"{watcher.name}: {state.muted_because or 'armed'}")
    return 0


def _kill(watcher: Watcher) -> int:
    """Kill a process that did not stop: one that stands still is silent only then, as
    JACK repeats its last period. Return 1 if it is still there."""
    pid = watcher.pid
    # What is asked next holds for the process of that number.
    if pid > 0 and watcher.exists:
        with contextlib.suppress(OSError):
            os.kill(pid, signal.SIGKILL)
    deadline = time.monotonic() + STATUS_TIMEOUT
    while watcher.exists:
        if time.monotonic() > deadline:
            output.print_error(
                f"{watcher.name} did not stop, and process {pid} could not be killed: "
                "disconnect the actuator"
            )
            return 1
        time.sleep(0.01)
    output.warn(
        f"{watcher.name} did not stop within {STATUS_TIMEOUT:g} s and was killed: it "
        "is silent, and begins muted if its run goes on"
    )
    return 0
