"""``tactophone set-threshold``: choose a decision rule for a rate of false bumps, and write it into the model."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_filter, open_filtered
from tactophone.cli._support.ranges import Within
from tactophone.cli.calibrate import per_minute
from tactophone.dataset import Dataset
from tactophone.perception import Model, model_path, read_model, shipped_models

if TYPE_CHECKING:
    from tactophone.evaluation import Estimate, Goal, OperatingPoint, TakePredictions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("model", metavar="MODEL", help="a model file, or the name of a shipped one")
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="validation recordings, none of them trained on"
    )
    add_filter(parser)
    goal = parser.add_mutually_exclusive_group(required=True)
    goal.add_argument(
        "--false-bumps", metavar="N/min", help="rough predicted on smooth, over 0 to 600 times a minute of contact"
    )
    goal.add_argument(
        "--false-positives", type=Within(float, 0, 1, over=True), metavar="SHARE",
        help="share of smooth contact predicted rough, %(type)s",
    )  # fmt: skip
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="model file to write (default: MODEL itself; of a shipped one, a copy in this folder)",
    )
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw the trade-off (default: beside the model file)")
    parser.add_argument("--dry-run", action="store_true", help="choose and draw, but do not write the model file")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    """Choose the rule, draw the trade-off, write the model file."""
    goal, limit = _goal(args)
    from tactophone.evaluation import candidate_rules, choose_rule, draw_trade_off, measure_rule, try_rules

    path = model_path(args.model)
    # The package's own files stay as they are: other programs of this installation use them.
    out = args.out or (Path(path.name) if args.model in shipped_models() else path)
    model = read_model(path)
    dataset = open_filtered(args.data, args.filter, channels=model.card.channels)
    rules = candidate_rules(abstain_from=model.card.decision.abstain_from)
    outcomes = try_rules(_predict(model, dataset), rules)
    place = choose_rule(outcomes, rules, goal=goal, limit=limit)
    # The first candidate is the plain threshold of 0.5.
    before, chosen = (measure_rule(outcomes, at, rules[at]) for at in (0, place))
    picture = args.plot or out.with_suffix(".trade-off.png")
    draw_trade_off(picture, outcomes, rules, chosen=chosen, before=before, limit=(goal, limit))
    if not args.dry_run:
        from tactophone.training import set_decision

        scores = {"dataset": dataset.name, "sha256": dataset.fingerprint, **chosen.as_json()}
        set_decision(path, chosen.rule, scores, out=out)
    _print(args, {"before": before, "chosen": chosen}, [picture] if args.dry_run else [out, picture])
    return 0


def _goal(args: argparse.Namespace) -> "tuple[Goal, float]":
    if args.false_bumps is not None:
        return "false_bumps_per_minute", per_minute(args.false_bumps)
    return "false_positive_rate", args.false_positives


def _predict(model: Model, dataset: Dataset) -> "list[TakePredictions]":
    from tactophone.evaluation import model_predictor

    if model.card.training.get("sha256") == dataset.fingerprint:
        terminal.log().print("beware: the model was trained on these recordings, so the rates are too good")
    predict = model_predictor(model)
    with terminal.tracked(dataset.recordings, "predicting") as takes:
        return [predict(take) for take in takes]


def _print(args: argparse.Namespace, points: "dict[str, OperatingPoint]", files: Sequence[Path]) -> None:
    if args.json:
        figures = {
            name: {
                "rough_on": point.rule.rough_on,
                "rough_off": point.rule.rough_off,
                "confirm": point.rule.confirm,
                **point.as_json(),
            }
            for name, point in points.items()
        }
        terminal.print_json({**figures, "files": [str(file) for file in files]})
        return
    table = Table("", *points, box=None)
    table.add_row("rough from, until", *(f"{p.rule.rough_on:.3f}, {p.rule.rough_off:.3f}" for p in points.values()))
    table.add_row("updates in a row", *(str(p.rule.confirm) for p in points.values()))
    table.add_row("false bumps a minute", *(_brief(p.false_bumps_per_minute) for p in points.values()))
    table.add_row("smooth as rough", *(_brief(p.false_positive_rate) for p in points.values()))
    table.add_row("rough as rough", *(_brief(p.rough_recall) for p in points.values()))
    table.add_row("touch to rough, p50", *(f"{1000 * p.delay:.0f} ms" for p in points.values()))
    terminal.out().print(table)
    for file in files:
        terminal.out().print(file, soft_wrap=True)


def _brief(estimate: "Estimate") -> str:
    return f"{estimate.value:.3g} ({estimate.low:.2g}-{estimate.high:.2g})"
