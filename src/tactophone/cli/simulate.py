"""``tactophone simulate``: sound from the simulated finger, for training, testing and play."""

import argparse
import os
import time
from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.dataset import write_metadata
from tactophone.errors import ConfigError
from tactophone.haptics import PROFILES
from tactophone.pipeline import open_pipeline
from tactophone.simulation.content.catalogue import PAPER, TestObject, catalogue, find
from tactophone.simulation.content.competition import DAYS, Run, make_finals, make_run, run_recording
from tactophone.simulation.content.generate import DURATION, Style, finish, make, plan
from tactophone.simulation.content.movement import TAKES, Take
from tactophone.simulation.participants.offline_pipeline import OfflinePipeline
from tactophone.simulation.participants.operator import make_bank, play, render_visits, tally
from tactophone.simulation.physics.source import RATE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's actions and their arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    _objects_arguments(_action(actions, "objects", "list the catalogue, with how rough each object truly is"))
    _dataset_arguments(
        _action(
            actions, "dataset", "make the paper's data set: seven takes of every object; goes on where it was cut off"
        )
    )
    _competition_arguments(
        _action(actions, "competition", "make runs over five stones in a box, on two days, with the truth over time")
    )
    _operator_arguments(
        _action(actions, "operator", "let a simulated operator feel five stones and pick the rough ones")
    )


def run(args: argparse.Namespace) -> int:
    """Run the chosen action."""
    code: int = args.action(args)
    return code


def _action(actions: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, line: str) -> (
    argparse.ArgumentParser
):  # fmt: skip
    return actions.add_parser(name, help=line, description=line, formatter_class=terminal.HelpFormatter)


def _objects_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.set_defaults(action=_objects)


def _dataset_arguments(parser: argparse.ArgumentParser) -> None:
    _sound_arguments(parser)
    parser.add_argument("--seconds", type=float, default=DURATION, help="length of a take, in s, over 0")
    parser.add_argument(
        "--objects", default="paper", metavar="LIST",
        help="numbers or names divided by commas, 'paper' for the 23 of the paper, or 'all'",
    )  # fmt: skip
    parser.add_argument(
        "--takes", default="all", metavar="LIST",
        help=f"takes divided by commas, of {', '.join(take.name for take in TAKES)}; or 'all'",
    )  # fmt: skip
    parser.add_argument("--scenarios", action="store_true", help="all that can be moved held, on a table and in a box")
    parser.add_argument("--opus", action="store_true", help="pass the sound through Opus and back, as the paper did")
    parser.add_argument(
        "--authors-layout", action="store_true", help="write opus/stereo/NN_variant.wav, as the paper's authors do"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes, 1 or more")
    parser.set_defaults(action=_dataset)


def _competition_arguments(parser: argparse.ArgumentParser) -> None:
    _sound_arguments(parser)
    parser.add_argument("--runs", type=int, default=5, help="runs a day, 1 or more")
    parser.add_argument(
        "--authors-layout", action="store_true", help="write finals_recordings/day_D_word.wav, as the authors do"
    )
    parser.set_defaults(action=_competition)


def _operator_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--model", default="", metavar="NAME|FILE", help="default: the one that ships for two channels")
    parser.add_argument("--profile", default="paper", metavar="NAME", help=f"one of {', '.join(PROFILES)}")
    parser.add_argument("--rounds", type=int, default=1000, help="rounds, 1 or more")
    parser.add_argument("--visits", type=int, default=12, help="stones of each kind to draw from, 1 or more")
    parser.add_argument("--seed", type=int, default=0, help="another seed gives other stones, strokes and noise")
    parser.add_argument("--json", action="store_true", help="print JSON instead of text")
    parser.set_defaults(action=_operator)


def _sound_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, metavar="OUT", help="folder to write to; what is there already is kept")
    parser.add_argument("--seed", type=int, default=0, help="another seed gives other sessions, strokes and noise")
    parser.add_argument("--bits", type=int, choices=(16, 24), default=16, help="bits a sample")


def _objects(args: argparse.Namespace) -> int:
    rows = [_row(thing) for thing in catalogue()]
    if args.json:
        terminal.print_json(rows)
        return 0
    table = Table(*(key.removesuffix("_um") + (" (µm)" if key.endswith("_um") else "") for key in rows[0]))
    for row in rows:
        table.add_row(*(f"{cell:.2f}" if isinstance(cell, float) else str(cell) for cell in row.values()))
    terminal.out().print(table)
    return 0


def _row(thing: TestObject) -> dict[str, object]:
    return {
        "number": thing.number,
        "object": thing.name,
        "label": thing.label.name.lower(),
        "material": thing.substance,
        "mounting": str(thing.mounting),
        "Ra_um": round(thing.roughness.ra * 1e6, 3),
        "Rq_um": round(thing.roughness.rq * 1e6, 3),
    }


def _dataset(args: argparse.Namespace) -> int:
    style = Style(args.seconds, args.seed, opus=args.opus, authors_layout=args.authors_layout, bits=args.bits)
    things = _things(args.objects)
    if args.authors_layout and (args.scenarios or any(thing.number not in PAPER for thing in things)):
        raise ConfigError("the authors' layout has numbers 00 to 22 and no scenarios; leave --scenarios and others out")
    if args.seconds <= 0 or args.jobs < 1:
        raise ConfigError(f"--seconds {args.seconds} --jobs {args.jobs}, but both must be over 0")
    jobs = plan(things, style, scenarios=args.scenarios, takes=_takes(args.takes))
    args.out.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    try:
        with terminal.progress("simulating") as bar:
            task = bar.add_task("", total=len(jobs), note="")
            for job in make(args.out, jobs, processes=args.jobs):
                bar.update(task, advance=1, note=job.name)
    finally:
        done = finish(args.out, jobs)
        terminal.complain(f"{done} of {len(jobs)} takes are there after {time.monotonic() - began:.0f} s")
    print(args.out)
    return 0


def _competition(args: argparse.Namespace) -> int:
    runs = [Run(day, number + 1, args.seed) for day in DAYS for number in range(args.runs)]
    args.out.mkdir(parents=True, exist_ok=True)
    if args.authors_layout:
        print(*make_finals(args.out, runs, bits=args.bits), sep="\n")
        return 0
    with terminal.progress("simulating") as bar:
        task = bar.add_task("", total=len(runs), note="")
        for one in runs:
            make_run(args.out, one, bits=args.bits)
            bar.update(task, advance=1, note=one.name)
    write_metadata(args.out, [run_recording(args.out, one) for one in runs])
    print(args.out)
    return 0


def _operator(args: argparse.Namespace) -> int:
    if args.rounds < 1 or args.visits < 1:
        raise ConfigError(f"--rounds {args.rounds} --visits {args.visits}, but both must be 1 or more")
    walk = open_pipeline(args.model, sample_rate=RATE, channels=2, profile=args.profile)
    visits = render_visits(visits=args.visits, seed=args.seed)
    rounds = play(make_bank(visits, OfflinePipeline(walk)), rounds=args.rounds, seed=args.seed)
    found = tally(rounds)
    if args.json:
        terminal.print_json(asdict(found))
        return 0
    print(f"simulated operator, {args.rounds} rounds of five stones, two rough")
    print(f"picked both rough stones:      {found.success:.1%}")
    print(f"the roughest picked was rough: {found.found:.1%}")
    print(f"time to decide:                {found.duration:.1f} s (half of the rounds within "
          f"{found.quartiles[0]:.1f} to {found.quartiles[1]:.1f} s)")  # fmt: skip
    return 0


def _things(names: str) -> list[TestObject]:
    if names == "all":
        return list(catalogue())
    if names == "paper":
        return [thing for thing in catalogue() if thing.number in PAPER]
    return [find(name.strip()) for name in names.split(",")]


def _takes(names: str) -> list[Take]:
    known = {take.name: take for take in TAKES}
    if names == "all":
        return list(TAKES)
    unknown = [name for name in names.split(",") if name not in known]
    if unknown:
        raise ConfigError(f"{unknown[0]!r} is no take; there are {', '.join(known)}")
    return [known[name] for name in names.split(",")]
