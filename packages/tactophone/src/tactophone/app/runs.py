"""Runs of the telephone on this machine: one side or both, recorded and shown elsewhere
meanwhile.

Each log and each bridge is a process of its own that reads telemetry, so that none of
them delays the sound.
"""

import math
import secrets
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from tactophone.app.sources import open_source as usual_source
from tactophone.app.sources import refuse_overwriting
from tactophone.core import extras
from tactophone.core.errors import ConfigError, TactophoneError, did_you_mean
from tactophone.core.settings import Settings
from tactophone.core.types import ignore

if TYPE_CHECKING:  # its import takes 0.3 s, which would slow down --help
    from tactophone.faces.bridges.process import Bridge, BridgeProcess
    from tactophone.live.runtime.supervisor import Supervisor
    from tactophone.live.runtime.wiring import OpenSource
    from tactophone.live.telemetry.watcher import Snapshot

Report = Callable[[str], None]

BRIDGES = {
    "foxglove": "in Foxglove or Lichtblick, by default at 127.0.0.1:8765",
    "osc": "as OSC messages to HOST:PORT",
    "ros": "on ROS 2 over DDS, in the domain of that number or of ROS_DOMAIN_ID",
    "zenoh": "the same over Zenoh, as rmw_zenoh_cpp has it",
}
"""Each bridge, and what its address is."""


def loopback(
    settings: Settings,
    *,
    name: str = "loopback",
    duration: float,
    record: Sequence[Path] = (),
    bridges: Sequence[str] = (),
    report: Report = ignore,
) -> "Snapshot":
    """Run both sides on this machine, and return the last snapshot of the operator:
    counters, gauges, state.

    - ``duration``: longest time, in s, once the run has started; it ends before if its
      sound does.
    - ``record``, ``bridges``, ``report``: as for `observed`.

    Raises `ConfigError` if a setting does not fit, and `TactophoneError` if no side
    ever started.
    """
    with (
        both_sides(settings, name=name, report=report) as sides,
        observed(
            settings, name, record=record, bridges=bridges, report=report, warn=report
        ),
    ):
        last = wait_for_end(sides, name, duration)
    if last is None:
        raise TactophoneError(
            f"{name}: no side started; `tactophone loopback` says why"
        )
    return last


def wait_for_end(
    sides: "Sequence[Supervisor]", name: str, duration: float
) -> "Snapshot | None":
    """Wait until a side ends, at most ``duration`` s from the start of the run of that
    name.

    Returns the last snapshot of the run; ``None`` if it never started.
    """
    from tactophone.live.telemetry.watcher import Watcher

    watcher: Watcher | None = None
    last: Snapshot | None = None
    deadline = math.inf
    while all(side.running for side in sides) and time.monotonic() < deadline:
        sides[0].wait(min(0.2, max(0.0, deadline - time.monotonic())))
        if watcher := watcher or Watcher.find(name):
            deadline = min(deadline, time.monotonic() + duration)
            watcher.follow(drain=False)
            last = watcher.snapshot()
    return last


def open_side(
    settings: Settings,
    name: str,
    open_source: "OpenSource | None",
    *,
    report: Report = ignore,
    **way: Any,
) -> "Supervisor":
    """Return the robot's side, or the operator's if there is no source; it is not
    started yet. ``way`` holds what a side of a call gets besides."""
    from tactophone.live.runtime.operator import run_operator
    from tactophone.live.runtime.robot import run_robot
    from tactophone.live.runtime.supervisor import Main, Supervisor

    refuse_overwriting(settings)
    main: Main = (
        partial(run_robot, open_source=open_source, **way)
        if open_source
        else partial(run_operator, **way)
    )
    return Supervisor(main, settings, name=name, report=report)


@contextmanager
def both_sides(
    settings: Settings,
    *,
    name: str,
    open_source: "OpenSource | None" = None,
    report: Report = ignore,
) -> "Iterator[Sequence[Supervisor]]":
    """Run operator and robot, in this order, with the simulated network between them.

    ``open_source`` replaces the way in which the settings' source is opened; ``report``
    is called with what people should know, from any thread.

    Raises `ConfigError` if the vibration would overwrite the recording that is heard.
    """
    from tactophone.live.runtime import pairing
    from tactophone.live.runtime.priority import prioritize_thread

    @contextmanager
    def network(operator: Settings) -> Iterator[int]:
        from tactophone.net.impairment import ImpairmentProxy, network_profile

        # The simulated network stands in front of the operator's port.
        prepare = partial(prioritize_thread, operator.process.priority)
        profile = network_profile(simulated.network)
        address = "127.0.0.1", operator.link.port
        with ImpairmentProxy(
            address, profile, seed=simulated.seed, prepare=prepare
        ) as proxy:
            yield proxy.address[1]

    refuse_overwriting(settings)
    simulated = settings.simulation
    opened = open_source or usual_source
    between = None if simulated.network == "clean" else network
    with pairing.both_sides(
        settings, name=name, open_source=opened, between=between, report=report
    ) as sides:
        yield sides


@contextmanager
def observed(
    settings: Settings,
    name: str,
    *,
    record: Sequence[Path] = (),
    bridges: Sequence[str] = (),
    sends: bool = False,
    report: Report = ignore,
    warn: Report = ignore,
) -> Iterator[None]:
    """Record the run of that name meanwhile, and show it elsewhere; within the block of
    its sides. However the block is left, the run is muted first: a log may take a
    minute to end, and nothing may vibrate so long.

    - ``record``: Files: ``.mcap`` for `tactophone.app.replay`, or ``.csv`` for
      predictions and commands alone.
    - ``bridges``: each a name of `BRIDGES`, or ``NAME=ADDRESS``.
    - ``sends``: whether the run is a robot's side alone.
    - ``report``, ``warn``: called with what people should know, and with what has gone
      wrong in a run that goes on; from any thread.

    Raises `ConfigError` if something asked for would be ignored, or a file of the run
    would be overwritten.
    """
    from tactophone.live.telemetry.watcher import Watcher

    refuse_overwriting(settings, record)
    _check(settings, record, bridges, sends=sends)
    watcher = Watcher.find(name)
    with ExitStack() as stack:
        try:
            for path in record:
                if path.suffix == ".csv":
                    from tactophone.live.telemetry.prediction_log import PredictionLog

                    stack.enter_context(PredictionLog(name, path, report=warn))
                elif path.suffix == ".mcap":
                    stack.enter_context(log_process(name, path, report=warn))
            for build in _bridges(settings, name, bridges, report):
                from tactophone.faces.bridges.process import BridgeProcess

                stack.enter_context(BridgeProcess(build, report=warn))
            yield
        finally:
            if watcher:
                # Followed rather than found anew: its memory may have lost its name,
                # which another run may have taken.
                with suppress(OSError):
                    watcher.follow(drain=False)
                watcher.ask("mute")


def _check(
    settings: Settings, record: Sequence[Path], bridges: Sequence[str], *, sends: bool
) -> None:
    """Refuse what would be ignored: above all a stop to which nobody listens."""
    for path in record:
        if path.suffix not in (".mcap", ".csv"):
            raise ConfigError(
                f"--record {path}: wanted a file that ends in .mcap or .csv"
            )
        if path.suffix == ".csv" and sends and not settings.link.send_predictions:
            raise ConfigError(
                f"send --record {path} needs predictions on this side: add "
                "--send-predictions, or record at the operator's with receive --record"
            )
    names = [text.partition("=")[0] for text in bridges]
    for name in names:
        if name not in BRIDGES:
            raise ConfigError(
                f"--bridge {name}: one of "
                f"{', '.join(BRIDGES)}{did_you_mean(name, BRIDGES)}"
            )
    chosen = settings.bridges
    usual = Settings().bridges
    if chosen.finger != usual.finger and settings.is_hand:
        raise ConfigError(
            "bridges.finger names the only finger in OSC and ROS, but with --fingers "
            "each finger has its own name: leave it out"
        )
    ros = {"ros", "zenoh"}
    for setting, needed in {
        "osc_listen": {"osc"},
        "osc_avatar": {"osc"},
        "ros_sinks": ros,
        "ros_publish": ros,
        "finger": {"osc", *ros},
    }.items():
        if getattr(chosen, setting) != getattr(usual, setting) and not needed & set(
            names
        ):
            words = " or ".join(f"--bridge {name}" for name in sorted(needed))
            raise ConfigError(
                f"bridges.{setting} does nothing without {words}: add that, or leave "
                "it out"
            )
    if chosen.osc_listen and sends:
        raise ConfigError(
            "bridges.osc_listen stops the operator's vibration: set it for `tactophone "
            "receive`"
        )


def _bridges(
    settings: Settings,
    name: str,
    bridges: Sequence[str],
    report: Report,
) -> "Iterator[Callable[[], Bridge]]":
    chosen = settings.bridges
    for text in bridges:
        bridge, _, address = text.partition("=")
        if bridge == "foxglove":
            extras.require_modules("aiohttp")
            from tactophone.faces.bridges.foxglove import (
                FOXGLOVE_ADDRESS,
                LAYOUT,
                FoxgloveBridge,
            )

            if address.endswith(":0"):
                raise ConfigError(
                    f"--bridge {text}: a viewer has to know the port: name one, such "
                    f"as {FOXGLOVE_ADDRESS}"
                )

            token = secrets.token_urlsafe(24)
            yield partial(
                FoxgloveBridge, name, address or FOXGLOVE_ADDRESS, token=token
            )
            report(f"Foxglove: ws://{address or FOXGLOVE_ADDRESS}/{token}/")
            report(f"layout to import: {LAYOUT}")
        elif bridge == "osc":
            extras.require_modules("pythonosc")
            from tactophone.faces.bridges.osc import OscBridge

            yield partial(
                OscBridge,
                name,
                address,
                finger=chosen.finger,
                listen=chosen.osc_listen,
                avatar=chosen.osc_avatar,
            )
        else:
            extras.require_modules(
                "cyclonedds", *(("zenoh", "rosbags") if bridge == "zenoh" else ())
            )
            from tactophone.faces.bridges.ros import RosBridge

            if address and not address.isdecimal():
                raise ConfigError(
                    f"--bridge {text}: wanted the number of a ROS domain, such as "
                    f"{bridge}=0"
                )
            sinks = tuple(
                sink.strip() for sink in chosen.ros_sinks.split(",") if sink.strip()
            )
            yield partial(
                RosBridge,
                name,
                finger=chosen.finger,
                publish=chosen.ros_publish,
                sinks=sinks,
                domain=int(address) if address else None,
                over="zenoh" if bridge == "zenoh" else "dds",
            )


LOG_END_TIMEOUT = 60.0
"""Seconds that a log may take to end. It runs at a low priority and writes what is left
and its index, so that a busy machine with a slow disk keeps it waiting; a file without
its end is worse than a verb that returns late."""


def log_process(
    name: str, path: Path, *, report: Callable[[str], None]
) -> "BridgeProcess":
    """Return the process that writes the log of a run, to be entered.

    ``report`` is called from another thread when it fails or does not end in order.
    """
    extras.require_modules("mcap", "zstandard")
    from tactophone.faces.bridges.process import BridgeProcess
    from tactophone.live.log.mcap import McapLog

    return BridgeProcess(
        partial(McapLog, name, path.absolute()),
        report=report,
        end_timeout=LOG_END_TIMEOUT,
        unfinished=(
            f"{path} lacks its end; `tactophone replay` and `feel` read it as it is, "
            f"and `tactophone replay {path} --repair finished.mcap` finishes it for "
            "other programs"
        ),
    )


class PageRecorder:
    """Obeys a page's process, which sends true to begin a log and false to end it, at
    ``page``, and answers it with what it does.

    A context manager that ends a log that is still open. ``report`` is called from
    another thread, with a line when a log begins, ends or fails.

    Each answer has a ``"recording"``: its ``phase`` (starting, on, ending, saved or
    failed), the ``file`` with its ``folder``; while it is on, ``since`` (s of the
    monotonic clock) and whether it is ``whole``, from the start of the run; at its end
    ``seconds``, ``bytes``, and ``trouble``, what was lost.
    """

    def __init__(
        self, name: str, folder: Path, *, report: Callable[[str], None] = ignore
    ) -> None:
        self._name = name
        self._folder = folder
        self._report = report
        self._orders, self.page = Pipe()
        self._log: BridgeProcess | None = None
        self._path = folder
        self._begun = 0.0
        self._whole = False
        self._trouble = ""
        self._thread = threading.Thread(
            target=self._follow, name="page-recorder", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.page.close()
        self._thread.join()
        self._end()

    def _follow(self) -> None:
        while (order := _receive(self._orders)) is not None:
            try:
                if order and self._log is None:
                    self._begin()
                elif not order:
                    self._end()
            except TactophoneError as error:
                self._answer("failed", trouble=str(error))

    def _begin(self) -> None:
        from tactophone.live.telemetry.watcher import Watcher

        self._path = (
            self._folder / f"{self._name}-{time.strftime('%Y%m%d-%H%M%S')}.mcap"
        ).absolute()
        self._trouble = ""
        # Its libraries take seconds to import on a busy machine.
        self._answer("starting")
        log = log_process(self._name, self._path, report=self._note_trouble)
        log.__enter__()
        self._log = log
        self._begun = time.monotonic()
        # Asked once the log is open: what it finds now, the log has found too.
        watcher = Watcher.find(self._name)
        self._whole = watcher is not None and watcher.knows_its_start
        self._answer("on", since=self._begun, whole=self._whole)
        self._report(f"recording to {self._path}")

    def _end(self) -> None:
        log = self._log
        if log is None:
            return
        self._answer("ending")
        seconds = time.monotonic() - self._begun
        # From now on a line of the log's process belongs to its end.
        self._log = None
        log.__exit__()
        size = self._path.stat().st_size if self._path.exists() else 0
        self._answer(
            "saved",
            seconds=seconds,
            bytes=size,
            whole=self._whole,
            trouble=self._trouble,
        )
        self._report(f"recorded: {self._path}, {seconds:.0f} s, {size / 1e6:.1f} MB")

    def _note_trouble(self, line: str) -> None:
        """Take a line of the log's process, from another thread: what it lost at its
        end, or why it ended by itself, such as a full disk."""
        self._report(line)
        self._trouble = line
        if self._log is not None:
            self._answer("failed", trouble=line)

    def _answer(self, phase: str, **words: Any) -> None:
        answer = {
            "phase": phase,
            "file": self._path.name,
            "folder": str(self._path.parent),
            **words,
        }
        try:
            self._orders.send({"recording": answer})
        except OSError:  # the page has ended; the run goes on
            return


def _receive(orders: Connection) -> bool | None:
    try:
        return bool(orders.recv())
    except (EOFError, OSError):
        return None
