"""``tactophone play``: the stone box, in a browser: find the two rough stones of five by touch alone."""

import argparse
import secrets
from functools import partial
from multiprocessing import Pipe
from pathlib import Path

from tactophone.cli._support import dashboard_options, flags
from tactophone.cli._support.folders import make_folder
from tactophone.cli._support.ranges import SEED
from tactophone.errors import ConfigError
from tactophone.settings import change

ROUNDS = 1000
"""Number of prepared rounds; they repeat after that."""

FLAGS = {
    "--tip": "capture.tip",
    "--model": "detector.model",
    "--profile": "rendering.profile",
    "--codec": "link.codec",
    "--packet-duration": "link.packet_duration",
    "--name": "process.name",
}

SIMULATED = ["capture.source=finger", "output.actuator=none", "process.watchdog=false"]
"""Settings of both ends without devices: the browser plays the vibration.

The watchdog protects from an actuator that a stalled process would keep driving; here there is none."""

NEAR = ["link.codec=pcm16", "link.packet_duration=0.0025"]
"""Unless flags say otherwise: on one machine, a codec and long packets only delay the press's sound."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "--seed",
        type=SEED,
        metavar="N",
        help="random seed of the first round's order, %(type)s; each further round adds 1 (default: random)",
    )
    parser.add_argument(
        "--results",
        type=Path,
        default=Path("stone-box.jsonl"),
        metavar="FILE",
        help="file to which each round's result is appended as one line of JSON",
    )
    dashboard_options.add_address(parser)
    flags.add_settings(parser, FLAGS, NEAR)


def run(args: argparse.Namespace) -> int:
    """Serve the game until interrupted."""
    from tactophone.pages import GameSettings, open_finger, serve_game
    from tactophone.simulation.takes import shuffled  # not by the door, which loads numba

    settings = change(flags.settings_of(args, NEAR), SIMULATED)
    if args.results.is_dir():
        raise ConfigError(f"--results {args.results}: a folder; name a file")
    make_folder(args.results.parent, "--results")
    name = settings.process.name or "play"
    seed = secrets.randbelow(10_000) if args.seed is None else args.seed
    inbox, finger = Pipe(duplex=False)
    game = GameSettings(name, [shuffled(seed + k) for k in range(ROUNDS)], seed, finger, args.results)
    # The page comes first: both sides take seconds to start, and it shows their progress.
    with serve_game(game, **dashboard_options.place(args)) as page:
        dashboard_options.announce(page)

        from tactophone.cli._support import console
        from tactophone.cli.loopback import both_sides

        with both_sides(settings, "clean", name=name, seed=0, open_source=partial(open_finger, inbox)) as sides:
            outcome = console.follow(sides, name)
    return outcome.exit_code
