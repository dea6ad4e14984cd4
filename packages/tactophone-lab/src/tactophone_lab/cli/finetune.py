"""``tactophone finetune``: improve a model on new objects, and show what that costs
elsewhere."""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli import options, output
from tactophone.cli.options import SEED
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.cli.data import add_selection, bars, open_filtered, reading_of

if TYPE_CHECKING:
    from rich.text import Text

    from tactophone_lab.app.finetune import FinetunedModel
    from tactophone_lab.evaluation.bootstrap import Change

EXAMPLES = (
    "tactophone finetune general.onnx recordings --general simulated",
    "tactophone finetune paper recordings --general simulated --strategy fine-tuned "
    "--out mine.onnx",
)

SCORE_NAMES = {
    "balanced_accuracy": "balanced accuracy",
    "false_positive_rate": "smooth as rough",
}
"""What the table calls each score."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "model",
        metavar="MODEL",
        help="model to start from: a file, or the name of a shipped one",
    )
    add(
        "new",
        type=Path,
        metavar="DIR",
        help="recordings of two or more new objects, two takes or more",
    )
    add(
        "--general",
        type=Path,
        required=True,
        metavar="DIR",
        help="general data, to train on again and test with",
    )
    add(
        "--out",
        type=Path,
        default=Path("finetuned.onnx"),
        metavar="FILE",
        help="model file to write",
    )
    add(
        "--strategy",
        choices=("blend", "fine-tuned"),
        default="blend",
        help="train on both and mix with the old parameters, or the paper's own "
        "fine-tuning",
    )
    add(
        "--anyway",
        action="store_true",
        help="write it even if smooth feels rough more often on the general data",
    )
    add(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="contact threshold of the new recordings",
    )
    add("--seed", type=SEED, default=0, metavar="N", help="random seed, %(type)s")
    options.add_json(parser, "print JSON instead of a table")
    add_selection(parser)
    options.add_recorded_channels(parser)


def run(args: argparse.Namespace) -> int:
    output.refuse_unwritable(args.out)
    from tactophone_lab.app.finetune import finetune_model

    start = model_path(args.model)
    channels = read_model(start).card.channels
    new = open_filtered(
        args.new, args.filter, channels=channels, reading=reading_of(args)
    )
    general = open_filtered(
        args.general, None, channels=channels, reading=reading_of(args)
    )
    calibration = Calibration.read(args.calibration) if args.calibration else None
    with bars() as report:
        tuned = finetune_model(
            start,
            new,
            general,
            args.out,
            strategy=args.strategy,
            seed=args.seed,
            calibration=calibration,
            anyway=args.anyway,
            report=report,
        )
    if not (args.json or tuned.worthwhile):
        output.log().print(
            "warning: no better on the new objects, or 2 points worse elsewhere; keep "
            "the old model"
        )
    values = {
        **tuned.changes,
        "share": tuned.share,
        "seconds": tuned.seconds,
        "file": tuned.file,
    }
    output.show(values, _parts(tuned), as_json=args.json)
    return 0 if tuned.file else 1


def _parts(tuned: "FinetunedModel") -> Iterator[output.Part]:
    from tactophone_lab.app.finetune import GENERAL

    rows: list[tuple[str | Text, ...]] = []
    for name, changes in tuned.changes.items():
        rows.append((output.styled("bold", name), "", "", ""))
        rows += [_row(SCORE_NAMES[score], change) for score, change in changes.items()]
    headings = ("", "before", "after", "change, points")
    yield [dict(zip(headings, row, strict=True)) for row in rows]
    yield (
        f"share of the new parameters: {tuned.share:.0%}; {tuned.seconds:.0f} s; "
        "intervals: 90 %"
    )
    if tuned.file:
        yield str(tuned.file)
        return
    rate = tuned.changes[GENERAL]["false_positive_rate"]
    yield output.styled(
        "red",
        "refused:",
        f" elsewhere smooth as rough is now {rate.after} (was {rate.before}); "
        "nothing was written: record smooth objects too, or add --anyway",
    )


def _row(score: str, change: "Change") -> tuple[str, str, str, str]:
    """Return the cells of a score: before, after, and the change in points."""
    if math.isnan(change.before.value):
        return (f"  {score}", "none smooth", "", "")
    difference = change.difference
    points = f"{100 * difference.value:+.1f}"
    if not math.isnan(difference.low):
        points += f" ({100 * difference.low:+.1f} to {100 * difference.high:+.1f})"
    return (f"  {score}", str(change.before), str(change.after), points)
