"""``tactophone evaluate``: scores of a model, or of a recipe by cross-validation."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_filter, add_kin, open_filtered
from tactophone.cli._support.ranges import Within
from tactophone.cli._support.training_options import add_training_options, recipe_of
from tactophone.dataset import KIN_SPLIT, SPLITS, Dataset, Fold, split
from tactophone.errors import ConfigError
from tactophone.perception import model_path, read_model

if TYPE_CHECKING:
    from tactophone.benchmark import Cache, Method
    from tactophone.evaluation import Report, Rule, TakePredictions

_MEASURES = {
    "balanced_accuracy": "balanced accuracy",
    "smooth_accuracy": "smooth called smooth, of smooth",
    "rough_accuracy": "rough called rough, of rough",
    "false_positive_rate": "smooth called rough, of smooth",
    "auc": "area under ROC curve",
    "recall_at_1": "rough recall at 1 % false positives",
    "rough_as_rough": "rough called rough, of all",
    "rough_as_smooth": "rough called smooth, of all",
    "smooth_as_rough": "smooth called rough, of all",
    "smooth_as_smooth": "smooth called smooth, of all",
}

_HEADLINE = ("balanced_accuracy", "auc", "recall_at_1", "false_positive_rate")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "model", nargs="?", metavar="MODEL",
        help="a model file or the name of a shipped one; leave it out to cross-validate a recipe",
    )  # fmt: skip
    parser.add_argument("--data", type=Path, required=True, metavar="DIR", help="a data set: see `tactophone dataset`")
    add_filter(parser)
    add_kin(parser)
    parser.add_argument(
        "--split", metavar="NAME", default=KIN_SPLIT,
        help=f"how to cross-validate a recipe: {', '.join(SPLITS)}",
    )  # fmt: skip
    parser.add_argument(
        "--baselines", type=Within(int, 0), nargs="?", const=1, metavar="N",
        help="also cross-validate the recipe level, and the recipe on labels permuted over surfaces N times, %(type)s "
        "(without N: 1)",
    )  # fmt: skip
    parser.add_argument("--by-recording", action="store_true", help="list every recording instead of surfaces")
    parser.add_argument("--note", metavar="NAME", help="write the scores into the model's card, under this name")
    parser.add_argument("--no-cache", action="store_true", help="train folds anew even if their results are cached")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    add_training_options(parser.add_argument_group("the recipe that is cross-validated, without MODEL"))


def run(args: argparse.Namespace) -> int:
    """Score a model, or cross-validate a recipe with its baselines."""
    if args.note and not args.model:
        raise ConfigError("--note writes into a model's card: name the MODEL")
    channels = read_model(model_path(args.model)).card.channels if args.model else recipe_of(args).channels
    dataset = open_filtered(args.data, args.filter, channels=channels, kin=args.kin)
    reports = {args.model: _score_model(args, dataset)} if args.model else _cross_validate(args, dataset)
    if args.note:
        _note(args, next(iter(reports.values())), dataset)
    if args.json:
        terminal.print_json({name: report.as_json() for name, report in reports.items()})
        return 0
    _print(reports, by_recording=args.by_recording)
    return 0


def _score_model(args: argparse.Namespace, dataset: Dataset) -> "Report":
    from tactophone.evaluation import make_report, model_predictor

    model = read_model(model_path(args.model))
    if model.card.training.get("sha256") == dataset.fingerprint:
        terminal.log().print("beware: the model was trained on these very recordings")
    predict = model_predictor(model, own_floor=True)
    with terminal.tracked(dataset.recordings, "predicting") as takes:
        return make_report([predict(take) for take in takes], decision=model.card.decision)


def _cross_validate(args: argparse.Namespace, dataset: Dataset) -> "dict[str, Report]":
    from tactophone.benchmark import default_cache, permute_labels
    from tactophone.benchmark.methods import method_of, recipe_method
    from tactophone.evaluation import make_report
    from tactophone.training import RECIPES, tip_of

    recipe = recipe_of(args)
    method, cache = method_of(recipe), None if args.no_cache else default_cache()
    rule = RECIPES[args.recipe].response_for(args.tip or tip_of(dataset.recordings)).decision
    reports = {method.name: make_report(_predict_folds(method, split(dataset, args.split), cache), decision=rule)}
    if args.baselines is not None:
        level = recipe_method("level", channels=recipe.channels)
        reports[level.name] = make_report(_predict_folds(level, split(dataset, args.split), cache))
    for seed in range(args.baselines or 0):
        permuted = permute_labels(dataset, seed=seed)
        reports[f"permuted {seed + 1}"] = make_report(
            _predict_folds(method, split(permuted, args.split), cache), decision=rule
        )
    return reports


def _predict_folds(method: "Method", folds: Sequence[Fold], cache: "Cache | None") -> "list[TakePredictions]":
    from tactophone.benchmark import cross_validate

    with terminal.progress(method.name, len(folds)) as update:
        return cross_validate(method, folds, cache=cache, report=lambda done, name: update(completed=done, note=name))


def _note(args: argparse.Namespace, report: "Report", dataset: Dataset) -> None:
    from tactophone.evaluation import RENDERED, RULES
    from tactophone.training import add_scores

    scores: dict[str, Any] = {
        "dataset": dataset.name,
        "surfaces": report.surfaces,
        "recordings": report.recordings,
        "contact": round(report.contact, 3),
    }
    for name in RENDERED:
        estimate = getattr(report.rendered, name)
        scores[f"{name}, as rendered"] = [round(value, 3) for value in (estimate.value, estimate.low, estimate.high)]
    for rule in RULES:
        for name in _HEADLINE:
            found = report.rules[rule][name]
            scores[f"{name}, {rule} rule"] = [round(value, 3) for value in (found.value, found.low, found.high)]
    add_scores(model_path(args.model), args.note, scores)


def _print(reports: "dict[str, Report]", *, by_recording: bool) -> None:
    from tactophone.evaluation import RULES

    first = next(iter(reports.values()))
    terminal.out().print(
        f"{first.recordings} recordings of {first.surfaces} surfaces; {first.updates} updates, {first.contact:.0%} of "
        "them in contact by the gate.\nIn brackets: 90 % intervals, surfaces drawn anew.\n"
    )
    terminal.out().print(_rendered(reports), "")
    if len(reports) > 1:
        for rule in RULES:
            terminal.out().print(_comparison(reports, rule), "")
    terminal.out().print(_measures(first), "")
    terminal.out().print(_rows(first, by_recording=by_recording))


def _rendered(reports: "dict[str, Report]") -> Table:
    table = Table("as rendered", "balanced accuracy", "smooth as rough", "gaps", show_edge=False)
    for name, report in reports.items():
        rendered = report.rendered
        table.add_row(name, *map(str, (rendered.balanced_accuracy, rendered.smooth_as_rough, rendered.gaps)))
    return table


def _comparison(reports: "dict[str, Report]", rule: "Rule") -> Table:
    # Three columns of a score and its interval are what 80 characters hold.
    table = Table(f"{rule} rule", "balanced accuracy", "area under ROC", "recall at 1 %", show_edge=False)
    for name, report in reports.items():
        table.add_row(name, *(str(report.rules[rule][measure]) for measure in _HEADLINE[:3]))
    return table


def _measures(report: "Report") -> Table:
    from tactophone.evaluation import RULES

    table = Table("", *(f"{rule} rule" for rule in RULES), show_edge=False)
    for name, line in _MEASURES.items():
        table.add_row(line, *(str(report.rules[rule][name]) for rule in RULES))
    return table


def _rows(report: "Report", *, by_recording: bool) -> Table:
    rows = report.by_recording if by_recording else report.by_surface
    name = "recording" if by_recording else "surface"
    table = Table(name, "label", "updates", "contact", "authors", "two-class", show_edge=False)
    for row in rows:
        shares = (row.contact, row.authors, row.two_class)
        cells = ("-" if math.isnan(share) else f"{share:.3f}" for share in shares)
        table.add_row(row.name, row.label, str(row.updates), *cells)
    return table
