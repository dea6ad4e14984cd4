"""``--record`` and the bridges of a live run: each a process of its own that reads telemetry."""

import argparse
import secrets
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli._support import extras, terminal
from tactophone.cli._support.ranges import Within
from tactophone.errors import ConfigError

if TYPE_CHECKING:
    from tactophone.bridges import Bridge

FOXGLOVE_ADDRESS = "127.0.0.1:8765"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    group = parser.add_argument_group("logs and other systems (docs/guide/bridges.md)")
    add = group.add_argument
    add(
        "--record",
        type=Path,
        metavar="FILE",
        help="MCAP file for packets, sound, predictions, commands, events and settings, which `tactophone replay` "
        "computes again to the bit; written by another process, and complete up to 1 s if one is killed",
    )
    add(
        "--foxglove", nargs="?", const=FOXGLOVE_ADDRESS, metavar="HOST:PORT",
        help=f"show the run live in Foxglove or Lichtblick (default: {FOXGLOVE_ADDRESS}); prints the address to open",
    )  # fmt: skip
    add("--osc", metavar="HOST:PORT", help="send predictions and vibration as OSC messages")
    add(
        "--osc-listen", type=Within(int, 0, (1 << 16) - 1), default=0, metavar="PORT",
        help="obey /tactophone/stop at this UDP port of this machine, %(type)s; 0: none",
    )  # fmt: skip
    add("--osc-avatar", action="store_true", help="send VRChat's avatar parameters too")
    add("--finger", metavar="NAME", help="finger in the names of OSC and ROS, where there is no hand (default: index)")
    add(
        "--ros-over", choices=("dds", "zenoh"), default="dds",
        help="how ROS 2 is reached; zenoh is that of rmw_zenoh_cpp",
    )  # fmt: skip
    add("--ros", action="store_true", help="publish to ROS 2, in the domain of ROS_DOMAIN_ID (default: 0)")
    add(
        "--ros-sink", action="append", default=[], metavar="KIND[:TOPIC]",
        help="drive a ROS 2 device with the vibration, after its limits: joy, senseglove, manus, haptx, haptx-left or "
        "float32",
    )  # fmt: skip


@contextmanager
def recorded(args: argparse.Namespace, name: str) -> Iterator[None]:
    """Record the run of that name meanwhile, and pass it on, as the options say."""
    _check(args)
    with ExitStack() as stack:
        for build in _bridges(args, name):
            from tactophone.bridges import BridgeProcess

            stack.enter_context(BridgeProcess(build, report=terminal.warn))
        yield


def _check(args: argparse.Namespace) -> None:
    """Refuse what would be ignored: above all a stop to which nobody listens."""
    if args.finger and args.fingers:
        raise ConfigError(
            "--finger names the only finger in OSC and ROS, but those of --fingers have names: leave it out"
        )
    ros = args.ros or args.ros_sink
    for option, value, has_bridge, bridge in (
        ("--osc-listen", args.osc_listen, args.osc, "--osc HOST:PORT"),
        ("--osc-avatar", args.osc_avatar, args.osc, "--osc HOST:PORT"),
        ("--ros-over", args.ros_over == "zenoh", ros, "--ros or --ros-sink"),
        ("--finger", args.finger, args.osc or ros, "--osc, --ros or --ros-sink"),
    ):
        if value and not has_bridge:
            raise ConfigError(f"{option} does nothing without {bridge}: add that, or leave it out")
    if args.osc_listen and args.verb == "send":
        raise ConfigError("--osc-listen stops the operator's vibration: give it to `tactophone receive`")


def _bridges(args: argparse.Namespace, name: str) -> "Iterator[Callable[[], Bridge]]":
    if args.record is not None:
        extras.require_modules("mcap", "zstandard")
        from tactophone.bridges import McapLog

        yield partial(McapLog, name, args.record.absolute())
    if args.foxglove:
        extras.require_modules("aiohttp")
        from tactophone.bridges.foxglove import LAYOUT, FoxgloveBridge

        token = secrets.token_urlsafe(24)
        yield partial(FoxgloveBridge, name, args.foxglove, token=token)
        terminal.note(f"Foxglove: ws://{args.foxglove}/{token}/")
        terminal.log().print(f"layout to import: {LAYOUT}", style="dim", soft_wrap=True)
    if args.osc:
        extras.require_modules("pythonosc")
        from tactophone.bridges.osc import OscBridge

        yield partial(
            OscBridge, name, args.osc, finger=args.finger or "index", listen=args.osc_listen, avatar=args.osc_avatar
        )
    if args.ros or args.ros_sink:
        extras.require_modules("cyclonedds", *(("zenoh", "rosbags") if args.ros_over == "zenoh" else ()))
        from tactophone.bridges.ros import RosBridge

        yield partial(
            RosBridge,
            name,
            finger=args.finger or "index",
            publish=args.ros,
            sinks=tuple(args.ros_sink),
            over=args.ros_over,
        )
