"""The options that describe a training, shared by `train`, `evaluate` and `sweep`."""

import argparse

import msgspec

from tactophone.cli._support.ranges import SEED, Within
from tactophone.errors import ConfigError
from tactophone.perception import Calibration
from tactophone.training import (
    PRECISIONS,
    RECIPES,
    VARIANTS,
    ConfiguredRecipe,
    TrainingOptions,
    network_settings,
)
from tactophone.types import TIP_NAMES

NUMBERS = {
    "epochs": (Within(int, 1), "passes over the windows"),
    "least_steps": (Within(int, 0), "least number of batches, whatever the epochs; paper-fast: 500"),
    "batch_size": (Within(int, 1), "windows in a batch; paper-fast: 1000"),
    "hop": (Within(int, 1), "samples at 2 kHz from one window to the next; the paper's authors use 1"),
    "learning_rate": (Within(float, 0, over=True), "of Adam"),
    "noise": (Within(float, 0), "standard deviation of the noise added to each window, of full scale"),
}
"""Numbers of the paper's network: range, help. The defaults are those of its settings."""

BITRATE = Within(int, 16, 512, unit="kbit/s")


def add_training_options(parser: argparse._ActionsContainer) -> None:
    """Add the options of recipes."""
    defaults = network_settings("general")
    parser.add_argument(
        "--recipe",
        choices=RECIPES,
        default="paper-fast",
        help="which detector to train; paper: with the paper's own figures",
    )
    parser.add_argument(
        "--channels", type=int, choices=(1, 2), default=2,
        help="microphones to use; the recipes paper and paper-fast take them from --variant",
    )  # fmt: skip
    parser.add_argument(
        "--microphone", choices=("contact", "air"), default="contact",
        help="which one a model of one channel uses (recipes on features; default: contact)",
    )  # fmt: skip
    parser.add_argument(
        "--tip", choices=TIP_NAMES,
        help="that the model is for (recipes on features; default: the one that the recordings name)",
    )  # fmt: skip
    parser.add_argument(
        "--opus-bitrate", type=BITRATE, metavar="KBPS",
        help="pass the sound through the link's Opus at this bitrate first, %(type)s; needs 48 kHz. `train` "
        "uses each recording as it is, and through Opus of 4 and of 8 kHz; with the recipe paper, through 4 kHz alone",
    )  # fmt: skip
    network = parser.add_argument_group("the recipe paper") if isinstance(parser, argparse.ArgumentParser) else parser
    network.add_argument(
        "--variant", choices=VARIANTS, default="general", help="which of the paper's three models (recipe paper)"
    )
    network.add_argument(
        "--reference-code", action="store_true",
        help="follow the authors' code where it differs from the paper's text: docs/guide/training.md (recipe paper)",
    )  # fmt: skip
    for name, (number, line) in NUMBERS.items():
        network.add_argument(
            f"--{name.replace('_', '-')}", type=number, metavar="N",
            help=f"{line}, %(type)s (recipe paper; default: {getattr(defaults, name):g})",
        )  # fmt: skip
    network.add_argument(
        "--precision", choices=PRECISIONS, default=defaults.precision,
        help="of the network's arithmetic; bfloat16 is faster on processors that have it (recipe paper)",
    )  # fmt: skip
    network.add_argument(
        "--seed", type=SEED, default=0,
        help="of everything random, %(type)s; the same seed gives the same bits (recipe paper)",
    )  # fmt: skip
    network.add_argument(
        "--contact-threshold", metavar="DBFS",
        help="level from which the model detects contact, -200 to 0 dBFS RMS; or 'off' for recordings that hold "
        "nothing but contact: every window is trained on and classified (recipe paper; default: -26 RMS, -46 mean "
        "absolute with --reference-code)",
    )  # fmt: skip


def recipe_of(args: argparse.Namespace) -> ConfiguredRecipe:
    """Return the recipe that the options describe; raises `ConfigError` if an option is out of range."""
    # argparse has checked the options of a command line, but not what `sweep --vary` puts in their place.
    if args.recipe not in RECIPES:
        raise ConfigError(f"--recipe {args.recipe}: one of {', '.join(RECIPES)}")
    given = {name: value for name in TrainingOptions.__struct_fields__ if (value := getattr(args, name)) is not None}
    if (threshold := args.contact_threshold) is not None and threshold != "off":
        try:
            given["contact_threshold"] = float(threshold)
        except ValueError:
            raise ConfigError(f"--contact-threshold {threshold}: must be a level of -200 to 0 dBFS, or 'off'") from None
    try:
        options = msgspec.convert(given, TrainingOptions)
    except msgspec.ValidationError as error:
        raise ConfigError(f"{error}; see `tactophone train --help`") from None
    calibration = getattr(args, "calibration", None)
    return RECIPES[args.recipe].with_options(
        options,
        start=getattr(args, "start", None),
        calibration=Calibration.read(calibration) if calibration else None,
    )
