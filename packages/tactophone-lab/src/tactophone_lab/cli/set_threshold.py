"""``tactophone set-threshold``: the decision rule of a model, chosen for a rate of false
bumps."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text

from tactophone.cli import options, output
from tactophone.cli.options import Within, per_minute
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.model_file import Model, read_model
from tactophone.signal.perception.models import model_path, shipped_models
from tactophone_lab.cli.data import add_filter, open_filtered

if TYPE_CHECKING:
    from tactophone_lab.evaluation.bootstrap import Estimate
    from tactophone_lab.evaluation.predict import TakePredictions
    from tactophone_lab.evaluation.rules import Goal, OperatingPoint

EXAMPLES = (
    "tactophone set-threshold texture --data recordings --false-bumps 2/min",
    "tactophone set-threshold finger.onnx --data recordings --false-positives 0.05 --dry-run",
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
    add_filter(parser)
    goal = parser.add_mutually_exclusive_group(required=True)
    words = "false bumps to allow: rough predicted on smooth, over 0 to 600 a minute of contact"
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
        help="model file to write (default: MODEL itself; of a shipped one, a copy in this folder)",
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
    goal: Goal = (
        "false_positive_rate" if args.false_bumps is None else "false_bumps_per_minute"
    )
    limit = (
        args.false_positives
        if args.false_bumps is None
        else per_minute(args.false_bumps)
    )
    from tactophone_lab.evaluation import rules as trials

    path = model_path(args.model)
    # The package's own files stay as they are: other programs of this installation use
    # them.
    out = args.out or (Path(path.name) if args.model in shipped_models() else path)
    model = read_model(path)
    dataset = open_filtered(
        args.data, args.filter, channels=model.card.channels, segments=True
    )
    rules = trials.candidate_rules(model.card.decision)
    outcomes = trials.try_rules(_predict(model, dataset), rules)
    place = trials.choose_rule(outcomes, rules, goal=goal, limit=limit)
    before, chosen = (trials.measure_rule(outcomes, at, rules[at]) for at in (0, place))
    left_out = trials.choose_left_out(outcomes, rules, goal=goal, limit=limit)
    picture = args.plot or out.with_suffix(".trade-off.png")
    trials.draw_trade_off(
        picture, outcomes, rules, chosen=chosen, before=before, limit=(goal, limit)
    )
    shown: str | Text = (
        "one object of a class: nothing says whether this rule holds on others; record two or more"
    )
    refused = False
    if left_out:
        old, new = (
            _rendered(model, outcomes.recordings, own)
            for own in ([rules[0]] * len(left_out), left_out)
        )
        # A share that was asked for may be more than before.
        asked = goal == "false_positive_rate" and new.value <= limit
        refused = not (args.anyway or asked) and old.is_exceeded_by(new.value)
        shown = note = (
            f"on objects left out of the choice, smooth as rough is now {new} as rendered (was {old})"
        )
        if refused:
            words = f" {note}; nothing was written: record more smooth objects, or add --anyway"
            shown = output.styled("red", "refused:", words)
        elif new.value > old.value:
            shown = output.styled(
                "yellow",
                "warning:",
                f" {note}. Keep the old rule, or record more smooth objects",
            )
    files = [picture]
    if not args.dry_run and not refused:
        from tactophone_lab.training.export import set_decision

        scores = {
            "dataset": dataset.name,
            "sha256": dataset.fingerprint,
            **chosen.as_json(),
        }
        set_decision(path, chosen.rule, scores, out=out)
        files = [out, picture]
    values: dict[str, Any] = {
        name: {
            key: getattr(point.rule, key)
            for key in ("rough_on", "rough_off", "confirm")
        }
        | point.as_json()
        for name, point in {"before": before, "chosen": chosen}.items()
    }
    values |= {
        "left_out": {"before": old, "chosen": new} if left_out else None,
        "refused": refused,
        "files": files,
    }
    output.show(
        values,
        [_rows(before, chosen), shown, *(str(file) for file in files)],
        as_json=args.json,
    )
    return int(refused)


def _predict(model: Model, dataset: Dataset) -> "list[TakePredictions]":
    from tactophone_lab.evaluation.predict import by_label, model_predictor

    if model.card.training.get("sha256") == dataset.fingerprint:
        output.log().print(
            "warning: the model was trained on these recordings, so the rates are too good"
        )
    predict = model_predictor(model)
    with output.tracked(dataset.recordings, "predicting") as takes:
        return [part for take in takes for part in by_label(predict(take))]


def _rendered(
    model: Model, recordings: Sequence[Recording], rules: Sequence[DecisionRule]
) -> "Estimate":
    """Return how much smooth is rendered as rough, with a rule for each recording."""
    from tactophone_lab.app.evaluation import recording_predictor
    from tactophone_lab.evaluation.report import rendered_scores

    with output.tracked(
        list(zip(recordings, rules, strict=True)), "rendering"
    ) as takes:
        found = [
            recording_predictor(
                replace(model, card=replace(model.card, decision=rule))
            )(recording)
            for recording, rule in takes
        ]
    return rendered_scores(found, rules[0]).smooth_as_rough


def _rows(before: "OperatingPoint", chosen: "OperatingPoint") -> list[dict[str, str]]:
    words: dict[str, Callable[[OperatingPoint], str]] = {
        "rough from, until": lambda point: (
            f"{point.rule.rough_on:.3f}, {point.rule.rough_off:.3f}"
        ),
        "updates in a row": lambda point: str(point.rule.confirm),
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
