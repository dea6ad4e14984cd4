"""``tactophone simulate``: sound of the simulated finger, for training and tests."""

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli import options, output
from tactophone.cli.options import PROCESSES, SEED, Within
from tactophone.core.tips import DEFAULT_TIP, TIP_NAMES
from tactophone_lab.simulation.room_sound_levels import BARE_DISC_DB, VOICE_DBFS
from tactophone_lab.simulation.takes import TAKES, takes_named

if TYPE_CHECKING:
    from tactophone_lab.app.simulate import RenderedSet
    from tactophone_lab.simulation.catalogue import SimulatedObject

EXAMPLES = (
    "tactophone simulate objects",
    "tactophone simulate objects --objects random:48:7",
    "tactophone simulate dataset simulated --objects 0,5 --takes "
    "short_light,long_light --seconds 2",
    "tactophone simulate competition competition --runs 1",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_action = options.add_actions(parser)
    words = "list objects, of the catalogue or drawn at random, with their roughness"
    listing = add_action("objects", words, _objects)
    _add_objects(listing.add_argument, default="all")
    options.add_json(listing, "print JSON instead of a table")
    words = (
        "render the paper's data set, seven takes of each object; continues after "
        "an interruption"
    )
    add = add_action("dataset", words, _dataset).add_argument
    takes = ", ".join(take.name for take in TAKES)
    cores = os.cpu_count() or 1
    _add_sound(add)
    add(
        "--seconds",
        type=Within(float, 0.1, 600, unit="s"),
        default=30.0,
        metavar="S",
        help="length of a take, %(type)s",
    )
    _add_objects(add, default="paper")
    words = f"takes separated by commas, of {takes}; or 'all'"
    add("--takes", default="all", metavar="LIST", help=words)
    add(
        "--scenarios",
        action="store_true",
        help="render movable objects held, on a table and in a box",
    )
    add(
        "--opus",
        action="store_true",
        help="pass the sound through Opus, as the paper did",
    )
    add(
        "--hall",
        action="store_true",
        help="in the competition's noise: a hall full of people, and running motors",
    )
    _add_room_sound(add)
    words = (
        "gains and noise of the microphones: first, as the shipped models were "
        "trained; derived, from data sheets and the authors' code (default: "
        "%(default)s)"
    )
    add("--levels", choices=("first", "derived"), default="first", help=words)
    add(
        "--authors-layout",
        action="store_true",
        help="write opus/stereo/NN_variant.wav, as the paper's authors do",
    )
    words = (
        "gain of the contact preamplifier, %(type)s; at -12 hardly any take "
        "clips, but models expect 0"
    )
    add(
        "--gain",
        type=Within(float, -40, 40, unit="dB"),
        default=0.0,
        metavar="DB",
        help=words,
    )
    words = (
        "angle between the finger's bed and the surface, %(type)s; the printed "
        "finger's bed leans by 30 degrees"
    )
    add(
        "--tilt",
        type=Within(float, 0, 75, unit="°"),
        default=0.0,
        metavar="DEGREES",
        help=words,
    )
    add(
        "--jobs",
        type=PROCESSES,
        default=cores,
        metavar="N",
        help="processes, %(type)s",
    )
    words = (
        "render runs over five stones in a box, on two days, with the truth over time"
    )
    add = add_action("competition", words, _competition).add_argument
    _add_sound(add)
    add(
        "--runs",
        type=Within(int, 1, 1000),
        default=5,
        metavar="N",
        help="runs per day, %(type)s",
    )
    words = (
        "finals: levels from data sheets and the authors' code, knobs set anew each "
        "day, light, slow and short touches"
    )
    add("--task", choices=("box", "finals"), default="box", help=words)
    add(
        "--opus",
        action="store_true",
        help="pass the sound through Opus, as the operator's side gets it",
    )
    add(
        "--authors-layout",
        action="store_true",
        help="write finals_recordings/day_D_word.wav, as the authors do",
    )
    words = (
        "let the fingers of a hand stroke a smooth and a rough stone, and write "
        "the sound and labels of each"
    )
    add = add_action("hand", words, _hand).add_argument
    add(
        "out",
        type=Path,
        metavar="OUT",
        help="folder to write to, with a recording for each finger",
    )
    add(
        "--fingers",
        default="5",
        metavar="N|FILE",
        help="their number, 1 to 10, or a TOML file with a table for each",
    )
    add(
        "--seed",
        type=SEED,
        default=0,
        metavar="N",
        help="random seed of set-up, strokes and noise, %(type)s",
    )
    add("--tip", choices=TIP_NAMES, default=DEFAULT_TIP, help="tip that touches")


def _add_room_sound(add: Callable[..., object]) -> None:
    words = (
        "WAV or FLAC file of a sound that plays in the room, such as a voice; both "
        "microphones hear it"
    )
    add("--room-sound", type=Path, metavar="FILE", help=words)
    words = (
        "level of its loudest second at the air microphone, %(type)s (default: "
        "%(default)g)"
    )
    add(
        "--room-sound-level",
        type=Within(float, -80, 0, unit="dBFS"),
        default=VOICE_DBFS,
        metavar="DBFS",
        help=words,
    )
    words = (
        "how much fainter the contact microphone hears it, %(type)s; 20 is assumed of "
        "a bare disc, 67 derived for one under a pad (default: %(default)g)"
    )
    add(
        "--isolation",
        type=Within(float, 0, 120, unit="dB"),
        default=BARE_DISC_DB,
        metavar="DB",
        help=words,
    )


def _add_objects(add: Callable[..., object], *, default: str) -> None:
    words = (
        "numbers or names separated by commas, 'paper' for the paper's 23, 'all' for "
        "the catalogue, or random:COUNT:SEED for objects drawn at random"
    )
    add("--objects", default=default, metavar="LIST", help=words)


def _add_sound(add: Callable[..., object]) -> None:
    add(
        "out",
        type=Path,
        metavar="OUT",
        help="folder to write to; finished files are kept",
    )
    add(
        "--seed",
        type=SEED,
        default=0,
        metavar="N",
        help="random seed of sessions, strokes and noise, %(type)s",
    )
    add("--bits", type=int, choices=(16, 24), default=16, help="bits per sample")
    add("--tip", choices=TIP_NAMES, default=DEFAULT_TIP, help="tip that touches")


def _objects(args: argparse.Namespace) -> int:
    from tactophone_lab.app.simulate import objects_named

    rows = [_row(obj) for obj in objects_named(args.objects)]
    table = [
        {
            key.replace("_um", " (µm)"): f"{cell:.2f}"
            if isinstance(cell, float)
            else cell
            for key, cell in row.items()
        }
        for row in rows
    ]
    output.show(rows, [table], as_json=args.json)
    return 0


def _row(obj: "SimulatedObject") -> dict[str, Any]:
    return {
        "number": obj.number,
        "object": obj.name,
        "label": obj.label.name.lower(),
        "material": obj.substance,
        "mounting": str(obj.mounting),
        "Ra_um": round(obj.roughness.ra * 1e6, 3),
        "Rq_um": round(obj.roughness.rq * 1e6, 3),
    }


def _dataset(args: argparse.Namespace) -> int:
    from tactophone_lab.app.simulate import (
        objects_named,
        plan_recordings,
        render_recordings,
    )
    from tactophone_lab.simulation.render import RenderOptions
    from tactophone_lab.simulation.room_sound import RoomSound

    room_sound = (
        RoomSound(args.room_sound, args.room_sound_level, args.isolation)
        if args.room_sound
        else None
    )
    chosen = RenderOptions(
        args.seconds,
        args.seed,
        opus=args.opus,
        hall=args.hall,
        authors_layout=args.authors_layout,
        bits=args.bits,
        tip=args.tip,
        gain_db=args.gain,
        tilt=args.tilt,
        levels=args.levels,
        room_sound=room_sound,
    )
    objects = objects_named(args.objects)
    takes = takes_named(args.takes)
    plan = plan_recordings(objects, takes, chosen, scenarios=args.scenarios)
    output.make_folder(args.out)
    with output.progress("simulating", len(plan)) as update:
        render_recordings(
            args.out,
            plan,
            processes=args.jobs,
            finish=_print_finished,
            report=lambda job: update(advance=1, note=job.name),
        )
    print(args.out)
    return 0


def _print_finished(rendered: "RenderedSet") -> None:
    output.log().print(
        f"{rendered.finished} of {rendered.planned} takes are finished after "
        f"{rendered.seconds:.0f} s"
    )


def _competition(args: argparse.Namespace) -> int:
    from tactophone_lab.app.simulate import (
        plan_competition,
        render_competition,
    )
    from tactophone_lab.simulation.competition import write_finals

    runs = plan_competition(
        args.runs,
        task=args.task,
        seed=args.seed,
        tip=args.tip,
        authors_layout=args.authors_layout,
        opus=args.opus,
    )
    output.make_folder(args.out)
    if args.authors_layout:
        print(*write_finals(args.out, runs, bits=args.bits), sep="\n")
        return 0
    with output.progress("simulating", len(runs)) as update:
        render_competition(
            args.out,
            runs,
            bits=args.bits,
            report=lambda run: update(advance=1, note=run.name),
        )
    print(args.out)
    return 0


def _hand(args: argparse.Namespace) -> int:
    from tactophone.core.hand import names_of, with_fingers
    from tactophone.core.settings import Settings
    from tactophone_lab.simulation.demonstration import write_demonstration

    names = names_of(with_fingers(Settings(), args.fingers))
    output.make_folder(args.out)
    print(*write_demonstration(args.out, names, seed=args.seed, tip=args.tip), sep="\n")
    return 0
