"""``tactophone play``: the stone box, in a browser: find the rough ones of five stones by touch alone."""

import argparse
import secrets
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

from tactophone import config
from tactophone.cli._support import console as face
from tactophone.cli._support import dashboard_options as page
from tactophone.cli._support import flags
from tactophone.config import Settings
from tactophone.dashboard import Box, play
from tactophone.game.finger import StoneBox
from tactophone.runtime import Supervisor, run_operator, run_robot
from tactophone.runtime.pairing import on_one_machine
from tactophone.simulation import shuffled
from tactophone.types import Source

ROUNDS = 1000
"""Rounds shuffled beforehand; then they come again."""

FLAGS = {
    "--model": "judge.model",
    "--profile": "feel.profile",
    "--codec": "link.codec",
    "--packet": "link.packet_duration",
    "--name": "process.name",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add = parser.add_argument
    add(
        "--seed",
        type=int,
        metavar="N",
        help="of the first round's order, from 0; the next round has N + 1 (default: drawn)",
    )
    add(
        "--results",
        type=Path,
        default=Path("stone-box.jsonl"),
        metavar="FILE",
        help="appended to: one line of JSON a round",
    )
    page.add_address(parser)
    flags.add_settings(parser, FLAGS)


def run(args: argparse.Namespace) -> int:
    """Serve the box until interrupted."""
    settings = _simulated(flags.settings_of(args))
    name = settings.process.name or "play"
    seed = secrets.randbelow(10_000) if args.seed is None else args.seed
    inbox, hand = Pipe(duplex=False)
    box = Box(name, [shuffled(seed + k) for k in range(ROUNDS)], seed, hand, args.results)
    with TemporaryDirectory(prefix="tactophone-") as folder:
        robot, operator = on_one_machine(settings, Path(folder), name=name)
        with (
            Supervisor(partial(run_operator, robot=f"{name}-robot"), operator, name=name) as receiving,
            Supervisor(partial(run_robot, open_source=partial(_lay, inbox)), robot, name=f"{name}-robot") as sending,
            play(box, args.dashboard_address) as served,
        ):
            page.announce(served)
            face.follow([receiving, sending], name)
    return 0


def _simulated(settings: Settings) -> Settings:
    """No device on either end: the finger is simulated, and the browser plays the vibration.

    Nor is there an actuator that a stalled process could drive for ever, which is what the watchdog is for.
    """
    return config.change(settings, ["capture.source=finger", "output.actuator=none", "process.watchdog=false"])


def _lay(inbox: Connection, settings: Settings) -> Source:
    return StoneBox(inbox, block_size=settings.capture.block_size)
