"""Guards an actuator that a command drives in its own process, without the two sides of
a run: ``tactophone stop`` ends it, and a watchdog in another process kills it when it
stalls."""

import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import NoReturn

import numpy as np

from tactophone.core.errors import TactophoneError
from tactophone.core.processes import Child, Parent, never_suspended
from tactophone.core.settings import Settings
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.live.audio.actuator import RenderHand
from tactophone.live.runtime.output_gate import EMERGENCY_STOP
from tactophone.live.runtime.priority import prioritize_thread
from tactophone.live.runtime.watchdog import (
    CHECK_INTERVAL,
    HARMLESS,
    Verdict,
    Watchdog,
)
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry

GUARD_INTERVAL = 0.02
"""Seconds between two looks for requests."""

GUARD_START = 60.0
"""Seconds that the watchdog's process may take to start on a busy machine."""

NO_WATCHDOG = "nothing may vibrate without the watchdog's process"

_ARMED = RunState(role="operator", fingers=(FingerState(armed=True),))
_STOPPED = RunState(
    role="operator",
    fingers=(FingerState(armed=False, muted_because=EMERGENCY_STOP),),
)


class Guard:
    """What is guarded, as a run of that name shows it."""

    def __init__(self, telemetry: Telemetry) -> None:
        self._telemetry = telemetry

    def watched(self, render: RenderHand) -> RenderHand:
        """Return a render that shows what it plays, and that it goes on."""

        def shown(outs: Sequence[FloatArray]) -> None:
            render(outs)
            peak = max(float(np.abs(out).max(initial=0.0)) for out in outs)
            self._telemetry.gauge("device_period", len(outs[0]) / LIVE_SAMPLE_RATE)
            self._telemetry.gauge("output_amplitude", peak)
            self._telemetry.count("callbacks")

        return shown


@contextmanager
def guarded(settings: Settings, name: str) -> Iterator[Guard]:
    """Guard the actuator that is open meanwhile; in the main thread.

    Raises `KeyboardInterrupt` there on ``tactophone stop`` or `mute`, and on Ctrl-Z.
    Raises `TactophoneError` if a run has that name, or if the watchdog does not start
    or ends.
    """
    with Telemetry(name) as telemetry, ExitStack() as stack:
        watchdog: Child | None = None
        before = signal.signal(signal.SIGUSR1, _interrupt)
        stack.callback(signal.signal, signal.SIGUSR1, before)
        stack.enter_context(never_suspended(_interrupt))
        ended = threading.Event()

        def keep_house() -> None:
            while not ended.wait(GUARD_INTERVAL):
                asked = {request.action for request in telemetry.requests()}
                telemetry.update(_ARMED, now=time.monotonic())
                unwatched = watchdog is not None and not watchdog.alive
                if asked & {"stop", "mute"} or unwatched:
                    os.kill(os.getpid(), signal.SIGUSR1)
                    return

        telemetry.update(_ARMED, now=time.monotonic())
        thread = threading.Thread(target=keep_house, name="guard", daemon=True)
        thread.start()
        try:
            if settings.process.watchdog and settings.output.actuator not in HARMLESS:
                watchdog = Child(_watch, settings, name, os.getpid(), name="watchdog")
                stack.callback(watchdog.kill)
                kind, text = next(watchdog.messages(GUARD_START), ("", "it ended"))
                if kind != "ready":
                    raise TactophoneError(f"{NO_WATCHDOG}: {text}")
            yield Guard(telemetry)
        except KeyboardInterrupt:
            if watchdog is not None and not watchdog.alive:
                raise TactophoneError(f"{NO_WATCHDOG}: it has ended") from None
            raise
        finally:
            ended.set()
            thread.join()
            telemetry.update(_STOPPED, now=time.monotonic())


def _interrupt(*_: object) -> NoReturn:
    # Only the first counts: another would cut the closing of the device short.
    for number in (signal.SIGUSR1, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def _watch(parent: Parent, settings: Settings, name: str, pid: int) -> None:
    """Kill the process of that number when it stalls, until it ends."""
    prioritize_thread(settings.process.priority)
    watchdog = Watchdog(settings.process.stall_timeout)
    watcher = Watcher(name)
    parent.tell(("ready", ""))
    while not parent.wants_end(CHECK_INTERVAL):
        if watchdog.check(watcher.pulse(), now=time.monotonic()) in (
            Verdict.LATE,
            Verdict.STALLED,
        ):
            os.kill(pid, signal.SIGKILL)
            return
