"""``tactophone export-lerobot``: a recorded run beside a robot's own data."""

import argparse
from pathlib import Path

from tactophone.cli import options, output

EXAMPLES = (
    "tactophone export-lerobot run.mcap --with robot-data --out felt-data",
    "tactophone export-lerobot run.mcap --with robot-data --out felt-data --episode 3 "
    "--start 1767225600.25",
    "tactophone export-lerobot run.mcap --with robot-data --out felt-data "
    "--into-state roughness,contact",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("log", type=Path, metavar="LOG", help="MCAP file written by --record")
    words = "folder of the robot's own data set"
    add(
        "--with",
        dest="dataset",
        type=Path,
        required=True,
        metavar="DATASET",
        help=words,
    )
    add(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="new folder: a copy with what was felt",
    )
    add(
        "--episode",
        type=options.Within(int, 0),
        default=0,
        metavar="N",
        help="episode that the log belongs to, %(type)s",
    )
    add(
        "--start",
        type=options.Within(float, 0, unit="s since 1970"),
        metavar="S",
        help="time of the episode's first frame, %(type)s; by default the time of "
        "the log's first prediction",
    )
    add(
        "--into-state",
        type=lambda words: tuple(words.split(",")),
        default=(),
        metavar="NAMES",
        help="also append the newest values of these columns to observation.state, "
        "the one feature that policies read: "
        "roughness,contact,amplitude",
    )
    options.add_json(parser, "print the summary as JSON")


def run(args: argparse.Namespace) -> int:
    from lerobot_export_tactophone.export import export

    with output.as_private_as(args.log):
        found = export(
            args.log,
            args.dataset,
            args.out,
            episode=args.episode,
            start=args.start,
            into_state=args.into_state,
        )
    words = (
        f"{found.folder}: {len(found.features)} features of {found.rows} predictions "
        f"in {found.felt} of "
        f"{found.frames} frames; {len(found.sound)} files of sound"
    )
    output.show(found, [words], as_json=args.json)
    return 0
