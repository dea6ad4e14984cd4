"""``tactophone play``: the stone box, on a page that plays the vibration."""

import argparse
import secrets
from functools import partial
from multiprocessing import Pipe
from pathlib import Path

from tactophone.app import runs
from tactophone.cli import console, options, output, page
from tactophone.cli.options import SEED
from tactophone.cli.output import make_folder
from tactophone.cli.try_page import NEAR
from tactophone.core.errors import ConfigError
from tactophone.core.settings import change

EXAMPLES = (
    "tactophone play",
    "tactophone play --seed 3 --results rounds.jsonl",
    "tactophone play --lan --https",
)

ROUNDS = 1000
"""Number of prepared rounds; they repeat after that."""

SIMULATED = ["capture.source=finger", "output.actuator=none", "process.watchdog=false"]
"""Settings of both ends of `play`, without devices: the browser plays the vibration.

The watchdog protects from an actuator that a stalled process would keep driving; here
no actuator is driven."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = (
        "random seed of the first round's order, %(type)s; each further round adds 1 "
        "(default: random)"
    )
    parser.add_argument("--seed", type=SEED, metavar="N", help=words)
    parser.add_argument(
        "--results",
        type=Path,
        default=Path("stone-box.jsonl"),
        metavar="FILE",
        help="file to which each round's result is appended as one line of JSON",
    )
    options.add_settings(parser, "play", NEAR)


def run(args: argparse.Namespace) -> int:
    from tactophone_lab.game.game_page import open_finger, serve_game
    from tactophone_lab.game.stone_box import GameSettings
    from tactophone_lab.simulation.takes import shuffled

    settings = change(options.settings_of(args, NEAR), SIMULATED)
    if args.results.is_dir():
        raise ConfigError(f"--results {args.results}: a folder; name a file")
    make_folder(args.results.parent, "--results")
    name = settings.process.name or "play"
    seed = secrets.randbelow(10_000) if args.seed is None else args.seed
    inbox, finger = Pipe(duplex=False)
    game = GameSettings(
        name, [shuffled(seed + k) for k in range(ROUNDS)], seed, finger, args.results
    )
    # The page comes first: both sides take seconds to start, and it shows their
    # progress.
    with serve_game(game, **page.place(settings)) as served:
        page.announce(served, browser=settings.page.open)

        both = runs.both_sides(
            settings,
            name=name,
            open_source=partial(open_finger, inbox),
            report=output.note,
        )
        with (
            console.keys_obeyed(name) as keys,
            both as sides,
            runs.observed(settings, name),
        ):
            outcome = console.follow(sides, keys)
    return outcome.exit_code
