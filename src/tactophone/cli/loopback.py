"""``tactophone loopback``: robot and operator as two processes of this machine, for a first try."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from tactophone.cli._support import dashboard_options, flags, live_run, terminal
from tactophone.cli._support.ranges import SEED
from tactophone.settings import Settings

if TYPE_CHECKING:
    from tactophone.runtime import OpenSource, Supervisor

FLAGS = {
    "--source": "capture.source",
    "--device": "capture.device",
    "--tip": "capture.tip",
    "--actuator": "output.actuator",
    "--output": "output.device",
    "--actuator-port": "output.port",
    "--actuator-channel": "output.channel",
    "--codec": "link.codec",
    "--packet-duration": "link.packet_duration",
    "--send-predictions": "link.send_predictions",
    "--model": "detector.model",
    "--calibration": "detector.calibration",
    "--profile": "rendering.profile",
    "--ceiling": "rendering.ceiling",
    "--muted": "rendering.muted",
    "--name": "process.name",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    live_run.add_arguments(parser, FLAGS)
    parser.add_argument(
        "--network",
        default="clean",
        metavar="NETWORK",
        help="simulated network: clean, lan, wifi, wifi-busy, wifi-roaming, internet, bursty, "
        "or loss=0.05,burst=3,delay=0.01,jitter=0.002 (fractions of 1, seconds); all but clean need the extra sim",
    )
    parser.add_argument(
        "--seed", type=SEED, default=0, metavar="N", help="random seed of its losses and delays, %(type)s"
    )


def run(args: argparse.Namespace) -> int:
    """Run both sides until interrupted, or until the sound ends."""
    from tactophone.cli._support.page_source import for_one_microphone, source_of

    settings = for_one_microphone(flags.settings_of(args))
    name = settings.process.name or "loopback"
    source = source_of(settings, page=dashboard_options.wanted(args))
    sides = both_sides(settings, args.network, name=name, seed=args.seed, open_source=source.open)
    return live_run.follow(args, sides, name, microphone=source.microphone)


@contextmanager
def both_sides(
    settings: Settings, network: str, *, name: str, seed: int, open_source: "OpenSource | None" = None
) -> "Iterator[Sequence[Supervisor]]":
    """Run operator and robot, in this order, as two processes with that network between them and fresh keys.

    ``open_source`` replaces the way in which the settings' source is opened.
    """
    from tactophone.cli._support import sources
    from tactophone.runtime import Supervisor, pair_on_one_machine, run_operator, run_robot, supervised, temporary_keys

    with temporary_keys() as folder, ExitStack() as stack:
        robot, operator = pair_on_one_machine(settings, folder, name=name)
        receive = partial(run_operator, robot=robot.process.name)
        receiving = Supervisor(receive, operator, name=name, report=terminal.note)
        if network != "clean":
            port = _impaired_port(stack, operator, network, seed)
            robot = replace(robot, link=replace(robot.link, port=port))
        send = partial(run_robot, open_source=open_source or sources.open_source)
        sending = Supervisor(send, robot, name=robot.process.name, report=terminal.note)
        yield stack.enter_context(supervised(receiving, sending))


def _impaired_port(stack: ExitStack, operator: Settings, network: str, seed: int) -> int:
    """Start the simulated network in front of the operator's port; return the port that leads through it."""
    from tactophone.runtime import prioritize_thread
    from tactophone.simulation.network import ImpairmentProxy, network_profile

    prepare = partial(prioritize_thread, operator.process.priority)
    proxy = ImpairmentProxy(("127.0.0.1", operator.link.port), network_profile(network), seed=seed, prepare=prepare)
    return stack.enter_context(proxy).address[1]
