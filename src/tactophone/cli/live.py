"""``tactophone send``, ``receive`` and ``loopback``, and what live verbs share: their options, and how a run ends.

Each log and each bridge is a process of its own that reads telemetry, so that none of them delays the sound.
"""

import argparse
import math
import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.app import sources
from tactophone.cli import console, options, output, page
from tactophone.cli.console import Outcome
from tactophone.core import extras
from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.settings import Settings
from tactophone.live.telemetry.layout import COUNTERS, STAGES

if TYPE_CHECKING:  # its import takes 0.3 s, which would slow down --help
    from tactophone.faces.bridges.process import Bridge
    from tactophone.live.runtime.supervisor import Supervisor
    from tactophone.live.runtime.wiring import OpenSource

EXAMPLES = {
    "send": (
        "tactophone send --peer operator.local",
        "tactophone send --peer operator.local --source finger --tip stylus",
        "tactophone send --peer 192.0.2.7:48470 --codec pcm16 --record run.mcap",
    ),
    "receive": (
        "tactophone receive --calibration calibration.toml --dashboard",
        "tactophone receive --actuator portaudio:DualSense --profile dualsense --ceiling 0.3",
        "tactophone receive --settings operator.toml --record run.csv --bridge foxglove",
    ),
    "loopback": (
        "tactophone loopback --source finger --actuator none --dashboard",
        "tactophone loopback --source file:stroke.wav --actuator file:vibration.wav --network wifi",
        "tactophone loopback --source finger --actuator none --duration 1",
    ),
}

BRIDGES = {
    "foxglove": "in Foxglove or Lichtblick, by default at 127.0.0.1:8765",
    "osc": "as OSC messages to HOST:PORT",
    "ros": "on ROS 2 over DDS, in the domain of that number or of ROS_DOMAIN_ID",
    "zenoh": "the same over Zenoh, as rmw_zenoh_cpp has it",
}
"""Each bridge, and what its address is."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings of a live verb, and all that a live run can show, record and pass on."""
    options.add_settings(parser, parser.get_default("verb"))
    options.add_fingers(parser)
    page.add_dashboard(parser)
    add_record(parser)
    add_end(parser)


def add_end(parser: argparse.ArgumentParser) -> None:
    """Add when a run ends, and what it then prints."""
    parser.add_argument("--duration", type=options.Within(float, 0, unit="s"), default=0.0, metavar="S",
        help="how long to run, %(type)s; 0: until interrupted")  # fmt: skip
    options.add_json(parser, "at the end, print all counters as JSON")


def add_record(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--record", type=Path, action="append", default=[], metavar="FILE",
        help="RUN.mcap: packets, sound, predictions, commands and settings, for `tactophone replay`; or RUN.csv: each "
        "prediction and command, as `tactophone feel` writes them; repeatable; complete up to 1 s if a process dies",
    )  # fmt: skip
    words = "; ".join(f"{name}: {what}" for name, what in BRIDGES.items())
    parser.add_argument("--bridge", action="append", default=[], metavar="NAME[=FOXGLOVE_ADDRESS]",
        help=f"show the run elsewhere, repeatable. {words}. Details: [bridges] in `tactophone settings`")  # fmt: skip


def run(args: argparse.Namespace) -> int:
    from tactophone.live.runtime.supervisor import supervised

    settings, open_source, microphone = options.settings_of(args), None, None
    name = settings.process.name or args.verb
    if args.verb == "loopback":
        settings = sources.for_one_microphone(settings)
    if args.verb != "receive":
        open_source, microphone = sources.source_of(settings, page=page.wanted(args, settings))
    sides: AbstractContextManager[Sequence[Supervisor]]
    if args.verb == "loopback":
        sides = both_sides(settings, name=name, open_source=open_source)
    else:
        sides = supervised(open_side(settings, name, open_source))
    return follow(args, settings, sides, name, microphone=microphone)


def open_side(settings: Settings, name: str, open_source: "OpenSource | None", **way: Any) -> "Supervisor":
    """Return the robot's side, or without a source the operator's, which is not started yet; ``way`` as of a call."""
    from tactophone.live.runtime.operator import run_operator
    from tactophone.live.runtime.robot import run_robot
    from tactophone.live.runtime.supervisor import Main, Supervisor

    main: Main = partial(run_robot, open_source=open_source, **way) if open_source else partial(run_operator, **way)
    return Supervisor(main, settings, name=name, report=output.note)


@contextmanager
def both_sides(
    settings: Settings, *, name: str, open_source: "OpenSource | None" = None
) -> "Iterator[Sequence[Supervisor]]":
    """Run operator and robot, in this order, with the simulated network between them.

    ``open_source`` replaces the way in which the settings' source is opened.
    """
    from tactophone.live.runtime import pairing
    from tactophone.live.runtime.priority import prioritize_thread

    @contextmanager
    def network(operator: Settings) -> Iterator[int]:
        from tactophone.lab.simulation.network import ImpairmentProxy, network_profile

        # The simulated network stands in front of the operator's port.
        prepare, profile = partial(prioritize_thread, operator.process.priority), network_profile(simulated.network)
        address = "127.0.0.1", operator.link.port
        with ImpairmentProxy(address, profile, seed=simulated.seed, prepare=prepare) as proxy:
            yield proxy.address[1]

    simulated, opened = settings.simulation, open_source or sources.open_source
    between = None if simulated.network == "clean" else network
    with pairing.both_sides(settings, name=name, open_source=opened, between=between, report=output.note) as sides:
        yield sides


def follow(
    args: argparse.Namespace, settings: Settings, sides: "AbstractContextManager[Sequence[Supervisor]]", name: str,
    *, microphone: Connection | None = None,
) -> int:  # fmt: skip
    """Start the sides, show and record the run of that name until it ends; return the verb's exit code.

    ``microphone`` takes the sound of a page's microphone.
    """
    with (
        sides as running,
        recorded(args, settings, name),
        page.shown(settings, name, page=page.wanted(args, settings), microphone=microphone),
    ):
        outcome = console.follow(running, name, duration=args.duration)
    return print_outcome(args, outcome)


@contextmanager
def recorded(args: argparse.Namespace, settings: Settings, name: str) -> Iterator[None]:
    """Record the run of that name meanwhile, and pass it on, as the options say."""
    _check(args, settings)
    with ExitStack() as stack:
        for path in args.record:
            if path.suffix == ".csv":
                from tactophone.live.telemetry.prediction_log import PredictionLog

                stack.enter_context(PredictionLog(name, path, report=output.warn))
        for build in _bridges(args, settings, name):
            from tactophone.faces.bridges.process import BridgeProcess

            stack.enter_context(BridgeProcess(build, report=output.warn))
        yield


def _check(args: argparse.Namespace, settings: Settings) -> None:
    """Refuse what would be ignored: above all a stop to which nobody listens."""
    for path in args.record:
        if path.suffix not in (".mcap", ".csv"):
            raise ConfigError(f"--record {path}: wanted a file that ends in .mcap or .csv")
        if path.suffix == ".csv" and args.verb == "send" and not settings.link.send_predictions:
            raise ConfigError(
                f"send --record {path} needs predictions on this side: add --send-predictions, or record at the "
                "operator's with receive --record"
            )
    names = [text.partition("=")[0] for text in args.bridge]
    for name in names:
        if name not in BRIDGES:
            raise ConfigError(f"--bridge {name}: one of {', '.join(BRIDGES)}{did_you_mean(name, BRIDGES)}")
    chosen, usual = settings.bridges, Settings().bridges
    if chosen.finger != usual.finger and settings.is_hand:
        raise ConfigError(
            "bridges.finger names the only finger in OSC and ROS, but those of --fingers have names: leave it out"
        )
    ros = {"ros", "zenoh"}
    for setting, needed in {
        "osc_listen": {"osc"}, "osc_avatar": {"osc"}, "ros_sinks": ros, "ros_publish": ros, "finger": {"osc", *ros},
    }.items():  # fmt: skip
        if getattr(chosen, setting) != getattr(usual, setting) and not needed & set(names):
            bridges = " or ".join(f"--bridge {name}" for name in sorted(needed))
            raise ConfigError(f"bridges.{setting} does nothing without {bridges}: add that, or leave it out")
    if chosen.osc_listen and args.verb == "send":
        raise ConfigError("bridges.osc_listen stops the operator's vibration: set it for `tactophone receive`")


def _bridges(args: argparse.Namespace, settings: Settings, name: str) -> "Iterator[Callable[[], Bridge]]":
    chosen = settings.bridges
    for path in args.record:
        if path.suffix == ".mcap":
            yield page.log_of(name, path)
    for text in args.bridge:
        bridge, _, address = text.partition("=")
        if bridge == "foxglove":
            extras.require_modules("aiohttp")
            from tactophone.faces.bridges.foxglove import FOXGLOVE_ADDRESS, LAYOUT, FoxgloveBridge

            if address.endswith(":0"):
                raise ConfigError(
                    f"--bridge {text}: a viewer has to know the port: name one, such as {FOXGLOVE_ADDRESS}"
                )

            token = secrets.token_urlsafe(24)
            yield partial(FoxgloveBridge, name, address or FOXGLOVE_ADDRESS, token=token)
            output.note(f"Foxglove: ws://{address or FOXGLOVE_ADDRESS}/{token}/")
            output.log().print(f"layout to import: {LAYOUT}", style="dim", soft_wrap=True)
        elif bridge == "osc":
            extras.require_modules("pythonosc")
            from tactophone.faces.bridges.osc import OscBridge

            yield partial(
                OscBridge, name, address, finger=chosen.finger, listen=chosen.osc_listen, avatar=chosen.osc_avatar
            )
        else:
            extras.require_modules("cyclonedds", *(("zenoh", "rosbags") if bridge == "zenoh" else ()))
            from tactophone.faces.bridges.ros import RosBridge

            if address and not address.isdecimal():
                raise ConfigError(f"--bridge {text}: wanted the number of a ROS domain, such as {bridge}=0")
            sinks = tuple(sink.strip() for sink in chosen.ros_sinks.split(",") if sink.strip())
            yield partial(
                RosBridge, name, finger=chosen.finger, publish=chosen.ros_publish, sinks=sinks,
                domain=int(address) if address else None, over="zenoh" if bridge == "zenoh" else "dds",
            )  # fmt: skip


def print_outcome(args: argparse.Namespace, outcome: Outcome) -> int:
    last = outcome.last
    if last is None:
        return 1
    summary = {"counters": last.counters, "gauges": last.gauges, "state": last.state, "restarts": outcome.restarts}
    output.show(summary, counts_and_budget(last.counters, last.gauges), as_json=args.json)
    return outcome.exit_code


def counts_and_budget(counters: dict[str, Any], gauges: dict[str, float]) -> Iterator[output.Part]:
    """Yield what was counted, and the median latency by stage where it is known."""
    counted = ((str(counters[name]), words) for name, words in COUNTERS.items() if counters[name])
    yield output.listing(counted, justify="right", style="")
    if math.isfinite(gauges["latency_total"]):
        stages = (*STAGES, "total")
        yield [{stage: f"{1000 * gauges[f'latency_{stage}']:.2f} ms" for stage in stages}]
        yield "total: from the middle of a packet's sound to its vibration (`latency` measures a touch's first one)"
