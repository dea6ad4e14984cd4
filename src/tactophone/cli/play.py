"""``tactophone play`` and ``try``: feel something on a page, with no hardware but this
machine or a phone."""

import argparse
import secrets
from functools import partial
from multiprocessing import Pipe
from pathlib import Path

from tactophone.app import runs, sources
from tactophone.cli import console, live, options, output, page
from tactophone.cli.options import SEED
from tactophone.cli.output import make_folder
from tactophone.core.errors import ConfigError
from tactophone.core.settings import change

EXAMPLES = {
    "play": (
        "tactophone play",
        "tactophone play --seed 3 --results rounds.jsonl",
        "tactophone play --lan --https",
    ),
    "try": (
        "tactophone try",
        "tactophone try --lan --https",
        "tactophone try --source microphone --threshold -40 --record try.csv",
    ),
}

ROUNDS = 1000
"""Number of prepared rounds; they repeat after that."""

NEAR = ["link.codec=pcm16", "link.packet_duration=0.0025"]
"""Unless options say otherwise: both sides run on this machine, where a codec and long
packets only delay the sound."""

SIMULATED = ["capture.source=finger", "output.actuator=none", "process.watchdog=false"]
"""Settings of both ends of `play`, without devices: the browser plays the vibration.

The watchdog protects from an actuator that a stalled process would keep driving; here
there is none."""

TRY_SOURCES = {
    "browser": "the microphone of a page, on this machine or on a phone",
    "microphone": "this machine's own, by PortAudio",
    "finger": "the simulated finger",
}
"""What `try` listens to."""

USUAL_OF_TRY = [*NEAR, "output.actuator=none"]
"""Nothing drives an actuator unless it is named."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    verb = parser.get_default("verb")
    if verb == "play":
        words = "random seed of the first round's order, %(type)s; each further round adds 1 (default: random)"
        add("--seed", type=SEED, metavar="N", help=words)
        add(
            "--results",
            type=Path,
            default=Path("stone-box.jsonl"),
            metavar="FILE",
            help="file to which each round's result is appended as one line of JSON",
        )
        options.add_settings(parser, verb, NEAR)
        return
    words = "; ".join(f"{name}: {what}" for name, what in TRY_SOURCES.items())
    add(
        "--source",
        choices=tuple(TRY_SOURCES),
        default="browser",
        help=f"what listens: {words}",
    )
    live.add_record(parser)
    live.add_end(parser)
    options.add_settings(parser, verb, USUAL_OF_TRY)


def run(args: argparse.Namespace) -> int:
    return _play(args) if args.verb == "play" else _try(args)


def _play(args: argparse.Namespace) -> int:
    from tactophone.faces.web.game import open_finger, serve_game
    from tactophone.faces.web.game_rules import GameSettings
    from tactophone.lab.simulation.takes import shuffled

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

        with runs.both_sides(
            settings,
            name=name,
            open_source=partial(open_finger, inbox),
            report=output.note,
        ) as sides:
            outcome = console.follow(sides, name)
    return outcome.exit_code


def _try(args: argparse.Namespace) -> int:
    from tactophone.faces.web.server import watch

    usual = [*USUAL_OF_TRY, f"capture.source={args.source}"]
    settings = sources.for_one_microphone(options.settings_of(args, usual))
    if settings.output.actuator == "none":  # a stalled process then harms nobody
        settings = change(settings, ["process.watchdog=false"])
    name = settings.process.name or "try"
    open_source, microphone = sources.source_of(settings)
    with watch(name, microphone=microphone, **page.place(settings)) as served:
        page.announce(served, "try", browser=settings.page.open)
        both = runs.both_sides(
            settings, name=name, open_source=open_source, report=output.note
        )
        with both as sides, live.recorded(args, settings, name):
            outcome = console.follow(sides, name, duration=args.duration)
    return live.print_outcome(args, outcome)
