"""``tactophone loopback``: robot and operator as two processes of this machine, for a first try."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from tactophone.cli._support import console as face
from tactophone.cli._support import dashboard_options as page
from tactophone.cli._support import flags, sources
from tactophone.cli._support import run_summary as outcome
from tactophone.config import Settings
from tactophone.runtime import Supervisor, run_operator, run_robot
from tactophone.runtime.pairing import on_one_machine
from tactophone.simulation.network.impairments import network
from tactophone.simulation.network.proxy import ImpairmentProxy

FLAGS = {
    "--source": "capture.source",
    "--device": "capture.device",
    "--actuator": "output.actuator",
    "--output": "output.device",
    "--codec": "link.codec",
    "--packet": "link.packet_duration",
    "--judge": "link.judge",
    "--model": "judge.model",
    "--calibration": "judge.calibration",
    "--profile": "feel.profile",
    "--ceiling": "feel.ceiling",
    "--muted": "feel.muted",
    "--name": "process.name",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    flags.add_settings(parser, FLAGS)
    parser.add_argument(
        "--network",
        default="clean",
        metavar="LINE",
        help="what the line does to packets: clean, lan, wifi, wifi-busy, wifi-roaming, internet, bursty, "
        "or loss=0.05,burst=3,delay=0.01,jitter=0.002 (shares 0 to 1, seconds)",
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the line's losses and delays")
    page.add_arguments(parser)
    outcome.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run both sides until interrupted, or until the sound ends."""
    settings = flags.settings_of(args)
    name = settings.process.name or "loopback"
    with both_sides(settings, args.network, name=name, seed=args.seed) as sides, page.shown(args, name):
        ended = face.follow(sides, name, duration=args.duration)
    return outcome.print_outcome(args, ended)


@contextmanager
def both_sides(settings: Settings, line: str, *, name: str, seed: int) -> Iterator[list[Supervisor]]:
    """Run operator and robot, in this order, as two processes with that line between them, sealed by fresh keys."""
    with TemporaryDirectory(prefix="tactophone-") as folder, ExitStack() as stack:
        robot, operator = on_one_machine(settings, Path(folder), name=name)
        receive = partial(run_operator, robot=robot.process.name)
        receiving = stack.enter_context(Supervisor(receive, operator, name=name))
        if line != "clean":
            proxy = ImpairmentProxy(("127.0.0.1", operator.link.port), network(line), seed=seed)
            port = stack.enter_context(proxy).address[1]
            robot = replace(robot, link=replace(robot.link, port=port))
        send = partial(run_robot, open_source=sources.open_source)
        yield [receiving, stack.enter_context(Supervisor(send, robot, name=robot.process.name))]
