"""``tactophone set-threshold``: the threshold of a model, chosen for a rate of false
bumps."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli import options, output
from tactophone.cli.options import Within, per_minute
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.cli.data import add_selection, bars, open_filtered, reading_of

if TYPE_CHECKING:
    from rich.text import Text

    from tactophone_lab.app.set_threshold import ThresholdChoice
    from tactophone_lab.evaluation.decision_rules import Goal, OperatingPoint

EXAMPLES = (
    "tactophone set-threshold texture --data recordings --false-bumps 2/min",
    "tactophone set-threshold finger.onnx --data recordings --false-positives 0.05 "
    "--dry-run",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("model", metavar="MODEL", help="a model file, or the name of a shipped one")
    add(
        "--data",
        type=Path,
        required=True,
        metavar="DIR",
        help="validation recordings, none of them trained on",
    )
    add_selection(parser)
    options.add_recorded_channels(parser)
    goal = parser.add_mutually_exclusive_group(required=True)
    words = (
        "false bumps to allow: rough predicted on smooth, over 0 to 600 a minute "
        "of contact"
    )
    goal.add_argument("--false-bumps", metavar="N/min", help=words)
    goal.add_argument(
        "--false-positives",
        type=Within(float, 0, 1, over=True),
        metavar="SHARE",
        help="share of smooth contact predicted rough, %(type)s",
    )
    add(
        "--out",
        type=Path,
        metavar="FILE",
        help="model file to write (default: MODEL itself; of a shipped one, a copy in "
        "this folder)",
    )
    add(
        "--plot",
        type=Path,
        metavar="PNG",
        help="draw the trade-off (default: beside the model file)",
    )
    add(
        "--dry-run",
        action="store_true",
        help="choose and draw, but do not write the model file",
    )
    add(
        "--anyway",
        action="store_true",
        help="write it even if smooth feels rough more often on objects left out",
    )
    options.add_json(parser, "print JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    goal: Goal
    if args.false_bumps is None:
        goal = "false_positive_rate"
        limit = args.false_positives
    else:
        goal = "false_bumps_per_minute"
        limit = per_minute(args.false_bumps)
    from tactophone_lab.app.set_threshold import set_threshold

    if args.out and not args.dry_run:
        output.refuse_unwritable(args.out)
    if args.plot:
        output.refuse_unwritable(args.plot, "--plot")
    channels = read_model(model_path(args.model)).card.channels
    dataset = open_filtered(
        args.data,
        args.filter,
        channels=channels,
        segments=True,
        reading=reading_of(args),
    )
    with bars() as report:
        choice = set_threshold(
            args.model,
            dataset,
            goal=goal,
            limit=limit,
            out=args.out,
            figure=args.plot,
            dry_run=args.dry_run,
            anyway=args.anyway,
            warn=output.log().print,
            report=report,
        )
    parts: list[output.Part] = [
        _rows(choice.before, choice.chosen),
        _verdict(choice),
        *(str(file) for file in choice.files),
    ]
    output.show(_values(choice), parts, as_json=args.json)
    return int(choice.refused)


def _values(choice: "ThresholdChoice") -> dict[str, Any]:
    """Return what ``--json`` prints."""
    values: dict[str, Any] = {}
    for name, point in {"before": choice.before, "chosen": choice.chosen}.items():
        values[name] = {
            "rough_on": point.rule.rough_on,
            "rough_off": point.rule.rough_off,
            **point.as_json(),
        }
    return {
        **values,
        "left_out": choice.left_out,
        "refused": choice.refused,
        "files": choice.files,
    }


def _verdict(choice: "ThresholdChoice") -> "str | Text":
    """Return what objects left out of the choice say of the rule."""
    if choice.left_out is None:
        return (
            "one object of a class: nothing says whether this rule holds on others; "
            "record two or more"
        )
    old = choice.left_out.before
    new = choice.left_out.chosen
    note = (
        "on objects left out of the choice, smooth as rough is now "
        f"{new} as rendered (was {old})"
    )
    if choice.refused:
        words = (
            f" {note}; nothing was written: record more smooth objects, or add --anyway"
        )
        return output.styled("red", "refused:", words)
    if new.value > old.value:
        words = f" {note}. Keep the old rule, or record more smooth objects"
        return output.styled("yellow", "warning:", words)
    return note


def _rows(before: "OperatingPoint", chosen: "OperatingPoint") -> list[dict[str, str]]:
    words: dict[str, Callable[[OperatingPoint], str]] = {
        "even odds at rough": lambda point: f"{point.rule.even_share:.3f}",
        "false bumps a minute": lambda point: point.false_bumps_per_minute.written(
            ".3g", ".2g"
        ),
        "smooth as rough": lambda point: point.false_positive_rate.written(
            ".3g", ".2g"
        ),
        "rough as rough": lambda point: point.rough_recall.written(".3g", ".2g"),
        "touch to rough, p50": lambda point: f"{1000 * point.delay:.0f} ms",
    }
    return [
        {"": name, "before": of(before), "chosen": of(chosen)}
        for name, of in words.items()
    ]
