"""``tactophone set-threshold``: set when a model believes *rough*, for a chosen rate of false bumps, and write it down."""

import argparse
from pathlib import Path

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_choice, choose
from tactophone.cli.calibrate import per_minute
from tactophone.dataset import Dataset
from tactophone.errors import ConfigError
from tactophone.evaluation import operating_point as points
from tactophone.evaluation.bootstrap import Estimate
from tactophone.evaluation.operating_point import Goal, Point
from tactophone.evaluation.predictions import TakePredictions, predictor_for
from tactophone.perception import Model, model_path, read_model


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("model", metavar="MODEL", help="a model file, or the name of a shipped one")
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="validation recordings, none of them trained on"
    )
    add_choice(parser)
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument(
        "--false-bumps", metavar="N/min", help="rough felt on smooth, over 0 to 600 times a minute of contact"
    )
    wanted.add_argument(
        "--false-positives", type=float, metavar="SHARE", help="share of smooth contact felt as rough, over 0 to 1"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="model file to write (default: MODEL itself)")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="draw the trade-off (default: beside the model file)")
    parser.add_argument("--dry-run", action="store_true", help="choose and draw, but leave the model file alone")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    """Choose the rule, draw the trade-off, write the model file."""
    goal, limit = _goal(args)
    model = read_model(model_path(args.model))
    out = args.out or model_path(args.model)
    dataset = choose(args.data, args.where)
    rules = points.candidates()
    outcome = points.try_rules(_judge(model, dataset), rules)
    place = points.choose(outcome, rules, goal=goal, limit=limit)
    before, chosen = (points.describe(outcome, at, rules[at]) for at in (0, place))
    picture = args.plot or out.with_suffix(".trade-off.png")
    points.draw_trade_off(picture, outcome, rules, chosen=chosen, before=before, limit=(goal, limit))
    if not args.dry_run:
        _write(args, out, chosen, dataset)
    _tell(args, {"before": before, "chosen": chosen}, [picture] if args.dry_run else [out, picture])
    return 0


def _goal(args: argparse.Namespace) -> tuple[Goal, float]:
    if args.false_bumps is not None:
        return "false_bumps_per_minute", per_minute(args.false_bumps)
    if not 0 < args.false_positives <= 1:
        raise ConfigError(f"--false-positives {args.false_positives:g}: a share over 0 to 1, such as 0.01")
    return "false_positive_rate", args.false_positives


def _judge(model: Model, dataset: Dataset) -> list[TakePredictions]:
    if model.card.training.get("sha256") == dataset.fingerprint:
        terminal.log().print("beware: the model was trained on these very recordings, and knows them too well")
    judge = predictor_for(model)
    with terminal.progress("judging") as bar:
        return [judge(one) for one in bar.track(dataset.recordings, task_id=bar.add_task("", note=""))]


def _write(args: argparse.Namespace, out: Path, chosen: Point, dataset: Dataset) -> None:
    from tactophone.cli.train import prepare_torch

    prepare_torch()
    from tactophone.training.model_export import set_decision

    told = {"dataset": dataset.name, "sha256": dataset.fingerprint, **chosen.as_json()}
    set_decision(model_path(args.model), chosen.rule, told, out=out)


def _tell(args: argparse.Namespace, told: dict[str, Point], files: list[Path]) -> None:
    if args.json:
        rules = {name: {"rough_on": p.rule.rough_on, "rough_off": p.rule.rough_off, "confirm": p.rule.confirm}
                 for name, p in told.items()}  # fmt: skip
        figures = {name: {**rules[name], **point.as_json()} for name, point in told.items()}
        terminal.print_json({**figures, "files": [str(file) for file in files]})
        return
    table = Table("", *told, box=None)
    table.add_row("rough from, until", *(f"{p.rule.rough_on:.3f}, {p.rule.rough_off:.3f}" for p in told.values()))
    table.add_row("updates in a row", *(str(p.rule.confirm) for p in told.values()))
    table.add_row("false bumps a minute", *(_brief(p.false_bumps_per_minute) for p in told.values()))
    table.add_row("smooth felt as rough", *(_brief(p.false_positive_rate) for p in told.values()))
    table.add_row("rough found", *(_brief(p.rough_recall) for p in told.values()))
    table.add_row("touch to rough, median", *(f"{1000 * p.delay:.0f} ms" for p in told.values()))
    terminal.out().print(table)
    for file in files:
        terminal.out().print(file, soft_wrap=True)


def _brief(estimate: Estimate) -> str:
    return f"{estimate.value:.3g} ({estimate.low:.2g}-{estimate.high:.2g})"
