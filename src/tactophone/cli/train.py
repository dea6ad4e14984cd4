"""``tactophone train``: from labelled recordings to a model file."""

import argparse
from pathlib import Path

from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_filter, joined, open_filtered
from tactophone.cli._support.training_options import add_training_options, recipe_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("data", type=Path, metavar="DIR", help="a data set: see `tactophone dataset`")
    parser.add_argument("--out", type=Path, default=Path("model.onnx"), metavar="FILE", help="the model file to write")
    parser.add_argument(
        "--also", type=Path, action="append", default=[], metavar="DIR",
        help="train on this data set too, all of it that is labelled; repeatable",
    )  # fmt: skip
    add_filter(parser)
    add_training_options(parser)
    parser.add_argument(
        "--from", type=Path, dest="start", metavar="MODEL",
        help="continue from this model's parameters instead of random ones (recipe paper)",
    )  # fmt: skip
    parser.add_argument(
        "--calibration", type=Path, metavar="FILE",
        help="contact threshold from `tactophone calibrate`, for labels and for the model's gate, in place of "
        "--contact-threshold (recipe paper)",
    )  # fmt: skip
    parser.add_argument(
        "--restart", action="store_true", help="start over even if an interrupted run of this training could resume"
    )


def run(args: argparse.Namespace) -> int:
    """Train and write the model file."""
    recipe = recipe_of(args)
    dataset = open_filtered(args.data, args.filter, channels=recipe.channels)
    dataset = joined([dataset, *(open_filtered(folder, None, channels=recipe.channels) for folder in args.also)])
    checkpoint = args.out.with_name(args.out.name + ".unfinished")
    if args.restart:
        checkpoint.unlink(missing_ok=True)
    with terminal.progress("training") as update:
        recipe.train(
            args.out, dataset, checkpoint=checkpoint, log=terminal.log().print,
            report=lambda done, total, note: update(completed=done, total=total, note=note),
        )  # fmt: skip
    checkpoint.unlink(missing_ok=True)
    print(args.out)
    return 0
