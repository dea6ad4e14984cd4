"""``tactophone train``: from labelled recordings to a model file."""

import argparse
import importlib.util
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_choice, choose
from tactophone.dataset import Dataset
from tactophone.errors import ConfigError
from tactophone.perception.sensor_health.calibration_file import Calibration
from tactophone.training.network.recipe import FOLLOWING, PRECISIONS, VARIANTS, Recipe, paper

if TYPE_CHECKING:
    from tactophone.benchmark.crossvalidation import Method
    from tactophone.link import Codec
    from tactophone.perception import Gate
    from tactophone.training.features.feature_tracks import FeatureSpec
    from tactophone.training.network.training_job import TrainingJob

RECIPE_NAMES = (
    "paper", "ours", "level", "rules", "median-frequency", "scalogram-cnn", "surface", "impulses", "logistic",
    "boosting",
)  # fmt: skip
"""The paper's, and every name of `training.ways.RECIPES`, which is not imported for a list of words."""

_OVERRIDES = {
    "epochs": (int, "passes over the windows, 1 or more"),
    "least_steps": (int, "least number of batches, whatever the epochs, 0 or more"),
    "batch_size": (int, "windows a batch, 1 or more; the paper has 6000"),
    "hop": (int, "samples at 2 kHz from one window to the next, 1 or more; the paper's authors have 1"),
    "learning_rate": (float, "of Adam, over 0"),
    "noise": (float, "standard deviation of the noise added to each window, of full scale, 0 or more"),
}
"""Numbers of a recipe that options may change; their defaults are the recipe's."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("data", type=Path, metavar="DIR", help="a data set: see `tactophone dataset`")
    parser.add_argument("--out", type=Path, default=Path("model.onnx"), metavar="FILE", help="the model file to write")
    add_choice(parser)
    add_recipe(parser)
    parser.add_argument(
        "--from", type=Path, dest="start", metavar="MODEL", help="go on from this model's parameters, not random ones"
    )
    parser.add_argument(
        "--calibration", type=Path, metavar="FILE",
        help="what `tactophone calibrate` wrote: where contact begins, for labels and for the model's gate; for the "
        "recipe paper, in place of --gate",
    )  # fmt: skip
    parser.add_argument(
        "--restart", action="store_true", help="begin anew even if a killed run of this very training could go on"
    )


def add_recipe(parser: argparse._ActionsContainer) -> None:
    """Add the options that make a recipe."""
    standard = paper("general")
    parser.add_argument(
        "--recipe", choices=RECIPE_NAMES, default="paper",
        help="what to train; the options that follow are of the paper's, but for --opus and --channels",
    )  # fmt: skip
    parser.add_argument(
        "--channels", type=int, choices=(1, 2), default=2, help="that recipes other than the paper's hear"
    )
    parser.add_argument("--variant", choices=VARIANTS, default="general", help="which of the paper's three models")
    parser.add_argument(
        "--following", choices=FOLLOWING, default="paper",
        help="the paper's text or its authors' code, where they differ: docs/training.md",
    )  # fmt: skip
    for name, (kind, line) in _OVERRIDES.items():
        option = f"--{name.replace('_', '-')}"
        told = f"{line} (default: {getattr(standard, name):g})"
        parser.add_argument(option, type=kind, default=None, metavar="N", help=told)
    parser.add_argument(
        "--precision", choices=PRECISIONS, default=standard.precision,
        help="of the network's arithmetic; bfloat16 is faster on processors that have it",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=int, default=0, help="of all that is random; the same seed gives the same bits (default: 0)"
    )
    parser.add_argument(
        "--gate", metavar="DBFS",
        help="level from which the model will feel contact, -200 to 0 dBFS RMS; or 'off' for recordings that hold "
        "nothing but contact: every window is trained on and judged (default: -26 RMS with the paper, -46 mean "
        "absolute with its authors)",
    )  # fmt: skip
    parser.add_argument(
        "--opus", type=int, metavar="KBPS",
        help="pass the sound through the link's Opus at this bitrate first, in kbit/s, 16 to 512; wants 48 kHz; other "
        "recipes than the paper's are then trained on it as it is, and through 4 and through 8 kHz of Opus",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Train and write the model file."""
    if args.recipe != "paper":
        return _train_way(args)
    course = training_job_of(args)
    dataset = choose(args.data, args.where)
    saved = args.out.with_name(args.out.name + ".unfinished.npz")
    if args.restart:
        saved.unlink(missing_ok=True)
    _train(args.out, course, dataset, saved=saved)
    saved.unlink(missing_ok=True)
    return 0


def training_job_of(args: argparse.Namespace) -> "TrainingJob":
    """Turn the options into a training run.

    Raises
    ------
    ConfigError
        If an option is out of range, or torch is not installed.
    """
    prepare_torch()
    from tactophone.training.network.training_job import TrainingJob

    recipe, gate = _recipe(args), _gate(args.gate)
    if calibrated := getattr(args, "calibration", None):
        recipe, gate = _calibrated(recipe, Calibration.read(calibrated))
    codec = _codec(args.opus, recipe.channels)
    return TrainingJob(recipe, args.seed, codec, getattr(args, "start", None), gate)


def _calibrated(recipe: Recipe, calibration: Calibration) -> "tuple[Recipe, Gate]":
    """Take windows for contact from the calibrated level, unless the recipe's is relative; and gate there."""
    from tactophone.perception import Gate

    gate = Gate(calibration.threshold_dbfs)
    if recipe.labelling.relative:
        return recipe, gate
    labelling = replace(recipe.labelling, loudness="rms", threshold=10 ** (calibration.window_dbfs / 20))
    return replace(recipe, labelling=labelling), gate


def feature_spec_of(args: argparse.Namespace) -> "FeatureSpec":
    """Turn the options into how a recipe other than the paper's hears; its kind is the recipe's own."""
    prepare_torch()
    from tactophone.training.features.feature_tracks import RATE
    from tactophone.training.recipes import RECIPES

    return RECIPES[args.recipe].ear(args.channels, _codec(args.opus, args.channels, bandwidth=RATE / 2))


def method_of(args: argparse.Namespace) -> "Method":
    """Turn the options into a method that can be cross-validated.

    Raises
    ------
    ConfigError
        If an option is out of range, or torch is not installed.
    """
    if args.recipe not in RECIPE_NAMES:
        raise ConfigError(f"--recipe {args.recipe}: one of {', '.join(RECIPE_NAMES)}")
    if args.recipe != "paper":
        ear = feature_spec_of(args)
        from tactophone.benchmark.recipe_methods import RecipeMethod

        return RecipeMethod(args.recipe, ear)
    course = training_job_of(args)
    # torch has been prepared: the methods may now import it.
    from tactophone.benchmark.paper_methods import PaperMethod

    return PaperMethod(course)


def _codec(bitrate_kbps: int | None, channels: int, *, bandwidth: float = 0) -> "Codec | None":
    from tactophone.link import Codec

    if bitrate_kbps is None:
        return None
    if not 16 <= bitrate_kbps <= 512:
        raise ConfigError(f"--opus {bitrate_kbps}: from 16 to 512 kbit/s")
    wanted = {"bandwidth": bandwidth} if bandwidth else {}
    return Codec("opus", channels=channels, packet_size=480, bitrate_bps=1000 * bitrate_kbps, **wanted)


def _train_way(args: argparse.Namespace) -> int:
    prepare_torch()
    from tactophone.training.features.feature_tracks import RATE
    from tactophone.training.recipes import RECIPES, train_way

    dataset = choose(args.data, args.where)
    channels = RECIPES[args.recipe].ear(args.channels).channels
    codecs = [_codec(args.opus, channels, bandwidth=band) for band in (0.0, RATE / 2)]
    with terminal.progress("learning") as bar:
        bar.add_task("", total=None, note=args.recipe)
        train_way(args.out, dataset, args.recipe, channels=channels, through=list(filter(None, codecs)))
    print(args.out)
    return 0


def prepare_torch() -> None:
    """Make sure that training can run, before torch is first imported.

    Raises
    ------
    ConfigError
        If the extra is not installed.
    """
    for name in ("torch", "onnx"):
        if importlib.util.find_spec(name) is None:
            raise ConfigError(f"training needs {name}, which is not installed: pip install 'tactophone[train]'")
    # Threads that spin while they wait ruin each other as soon as anything else runs: a step took ten times as long
    # beside one busy neighbour. Read by OpenMP when torch is first imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def _recipe(args: argparse.Namespace) -> Recipe:
    changes = {name: getattr(args, name) for name in _OVERRIDES if getattr(args, name) is not None}
    for name, value in changes.items():
        least = 0 if name in ("noise", "least_steps") else 1e-9 if name == "learning_rate" else 1
        if not least <= value < float("inf"):
            raise ConfigError(f"--{name.replace('_', '-')} {value:g}: {_OVERRIDES[name][1]}")
    recipe = replace(paper(args.variant, following=args.following), precision=args.precision, **changes)
    if args.gate == "off":
        return replace(recipe, labelling=replace(recipe.labelling, threshold=0.0, relative=False))
    return recipe


def _gate(text: str | None) -> "Gate | None":
    from tactophone.perception import Gate

    if text is None:
        return None
    try:
        return Gate(-200.0 if text == "off" else float(text))
    except ValueError:
        raise ConfigError(f"--gate {text}: wanted a level of -200 to 0 dBFS, or 'off'") from None


def _train(out: Path, course: "TrainingJob", dataset: Dataset, *, saved: Path) -> None:
    from tactophone.training.network.trainer import Progress
    from tactophone.training.network.training_job import find_windows, learn, write_trained
    from tactophone.training.network.worker_group import init_distributed

    with terminal.progress("reading") as bar:
        task = bar.add_task("", total=len(dataset.recordings), note="")
        windows = find_windows(course, dataset.recordings, report=lambda done: bar.update(task, completed=done))
    terminal.log().print(f"{len(dataset.recordings)} recordings, {len(dataset.surfaces)} surfaces: {windows}")
    with terminal.progress("training") as bar:
        task = bar.add_task("", total=None, note="")

        def show(told: Progress) -> None:
            bar.update(task, completed=told.steps, total=told.of, note=f"loss {told.loss:.4f}")

        weights = learn(course, windows, saved=saved, report=show)
    # Under torchrun all processes end with the same weights; one of them writes.
    if init_distributed().leads:
        write_trained(out, course, weights, dataset=dataset)
        print(out)
