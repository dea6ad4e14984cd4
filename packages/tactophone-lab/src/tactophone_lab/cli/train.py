"""``tactophone train``: from labelled recordings to a model file; and the recipes that
`evaluate` scores too."""

import argparse
import shlex
from pathlib import Path

from tactophone.cli import options, output
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Dataset
from tactophone.core.tips import TIP_NAMES
from tactophone.signal.perception.calibration import Calibration
from tactophone_lab.app.train import (
    FOLDS,
    TrainedModel,
    joined,
    score_by_folds,
    train_model,
)
from tactophone_lab.cli.data import (
    add_selection,
    bars,
    is_mono,
    open_filtered,
    reading_of,
)
from tactophone_lab.datasets.shared_sound import leak_warnings
from tactophone_lab.training.recipes import RECIPES, RecipeFile

EXAMPLES = (
    "tactophone train recordings --recipe texture --out finger.onnx",
    "tactophone train recordings --also simulated --filter tier=core",
    "tactophone train recordings --recipe paper.toml --from general.onnx",
)


def add_recipe(parser: options.Container) -> None:
    """Add ``--recipe``, and the options for which nobody should need a file."""
    add = parser.add_argument
    add(
        "--recipe",
        metavar="NAME|FILE.toml",
        default="texture",
        help=f"%(default)s unless given; one of {', '.join(RECIPES)}; or a file with "
        "recipe = NAME and any of "
        f"{', '.join(RecipeFile.__struct_fields__[:-1])} (docs/guide/training.md)",
    )
    add(
        "--channels",
        type=options.microphones,
        metavar="N|N,N",
        help="how many microphones to use, 1 or 2 (default: as many as the recordings "
        "have); the recipes paper and paper-fast take them from variant. Two numbers, "
        "such as 3,4, are the channels of contact and air in files of more than two",
    )
    words = (
        "tip that the model is for, in recipes on features (default: the recordings')"
    )
    add("--tip", choices=TIP_NAMES, help=words)
    add(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="any other entry of a recipe file, such as variant=one-channel or "
        "seed=1; repeatable",
    )


def recipe_of(args: argparse.Namespace) -> RecipeFile:
    """Return the recipe that the options describe: defaults < file < options."""
    if args.recipe.endswith(".toml"):
        recipe = RecipeFile.read(Path(args.recipe))
    else:
        recipe = RecipeFile().changed({"recipe": args.recipe}, where="--recipe")
    given = {"tip": args.tip} if args.tip else {}
    if isinstance(args.channels, int):
        given["channels"] = args.channels
    return recipe.changed(given | options.assigned(args.set), where="--set")


def recipe_for(args: argparse.Namespace, folder: Path) -> RecipeFile:
    """Return the recipe that the options describe, for one microphone where the
    recordings have one and no option says.

    Raises `DatasetError` as `open_dataset` does.
    """
    recipe = recipe_of(args)
    is_network = RECIPES[recipe.recipe].features == "magnitudes"
    chosen = args.channels or any(
        text.startswith(("channels=", "variant=")) for text in args.set
    )
    if chosen or args.recipe.endswith(".toml"):
        return recipe
    if not is_mono(folder, reading_of(args)):
        return recipe
    change = {"variant": "one-channel"} if is_network else {"channels": 1}
    return recipe.changed(change, where="the recordings have one channel")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "data",
        type=Path,
        metavar="DIR",
        help="a data set, or class folders rough/ and smooth/",
    )
    add(
        "--out",
        type=Path,
        default=Path("model.onnx"),
        metavar="FILE",
        help="the model file to write",
    )
    add(
        "--also",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="train on this data set too, all of it that is labelled; repeatable",
    )
    add_selection(parser)
    add_recipe(parser)
    add(
        "--from",
        type=Path,
        dest="start",
        metavar="MODEL",
        help="continue from this model's parameters instead of random ones (recipe "
        "paper)",
    )
    add(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="contact threshold from `tactophone check`, for labels and for the "
        "model's gate, in place of "
        "contact_threshold in a recipe file (recipe paper)",
    )
    add(
        "--restart",
        action="store_true",
        help="start over even if an interrupted run of this training could resume",
    )
    add(
        "--no-score",
        action="store_true",
        help="do not cross-validate the recipe after the training",
    )


def run(args: argparse.Namespace) -> int:
    output.refuse_unwritable(args.out)
    calibration = Calibration.read(args.calibration) if args.calibration else None
    recipe_file = recipe_for(args, args.data)
    recipe = recipe_file.configured(start=args.start, calibration=calibration)
    datasets = [
        open_filtered(
            folder, wanted, channels=recipe.channels, reading=reading_of(args)
        )
        for folder, wanted in [
            (args.data, args.filter),
            *((also, None) for also in args.also),
        ]
    ]
    for warning in leak_warnings(datasets[0], ()):
        output.note(warning)
    with output.progress("training") as update:
        trained = train_model(
            recipe,
            datasets,
            args.out,
            restart=args.restart,
            warn=output.note,
            log=output.log().print,
            report=lambda done, total, note: update(
                completed=done, total=total, note=note
            ),
        )
    print(trained.path)
    output.note(
        f"trained on {trained.recordings} recordings of {trained.smooth} smooth and "
        f"{trained.rough} rough surfaces"
    )
    output.note(
        _score(recipe_file, joined(datasets), trained, args)
        or "score it on surfaces that it never met: "
        f"`tactophone evaluate {_selection(args)} --split {FOLDS}`"
    )
    output.note(f"feel with it: `tactophone feel FILE.wav --model {trained.path}`")
    return 0


def _score(
    recipe: RecipeFile,
    dataset: Dataset,
    trained: TrainedModel,
    args: argparse.Namespace,
) -> str:
    """Return the score by cross-validation as a sentence, or nothing where it was
    not asked for, takes too long, or would say too little."""
    if args.no_score or not trained.enough:
        return ""
    try:
        with bars() as report:
            found = score_by_folds(recipe, dataset, report=report)
    except DatasetError as error:
        # The model is written; only its score is not known.
        return f"not scored by leaving surfaces out: {error}"
    if found is None:
        return ""
    rendered = found.rendered
    return (
        f"felt of surfaces left out in turn ({FOLDS}): "
        f"{rendered.balanced_accuracy} right, balanced; smooth felt as rough "
        f"{rendered.smooth_as_rough}; every surface: "
        f"`tactophone evaluate {_selection(args)} --split {FOLDS}`"
    )


def _selection(args: argparse.Namespace) -> str:
    """Return the options with which `evaluate` reads the same recordings and
    recipe."""
    words = ["--data", str(args.data)]
    for option, given in (
        ("--labels", [args.labels]),
        ("--filter", args.filter or []),
        ("--recipe", [args.recipe]),
        ("--tip", [args.tip]),
        ("--set", args.set),
    ):
        words += [word for value in given if value for word in (option, value)]
    return shlex.join(words)
