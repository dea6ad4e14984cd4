"""``tactophone evaluate``: scores of a model, or of recipes by cross-validation."""

import argparse
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from tactophone.cli import options, output
from tactophone.cli.data import add_filter, add_folds, add_kin, cache_of, open_filtered
from tactophone.cli.options import Within
from tactophone.cli.train import add_recipe, recipe_of
from tactophone.core.errors import ConfigError
from tactophone.lab.dataset.splits import KIN_SPLIT, SPLITS, Fold, split
from tactophone.lab.dataset.values import Dataset, tip_of
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path, tip_mismatch

if TYPE_CHECKING:
    from tactophone.lab.benchmark.folds import Cache, Method
    from tactophone.lab.evaluation.predict import TakePredictions
    from tactophone.lab.evaluation.report import Report

EXAMPLES = (
    "tactophone evaluate texture --data recordings",
    "tactophone evaluate --data recordings --recipe texture --baselines",
    "tactophone evaluate --data recordings --recipe paper-fast --vary epochs=1,5 --vary seed=0,1",
)

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
    add = parser.add_argument
    add("model", nargs="?", metavar="MODEL",
        help="a model file or the name of a shipped one; leave it out to cross-validate a recipe")  # fmt: skip
    add("--data", type=Path, required=True, metavar="DIR", help="a data set: see `tactophone dataset`")
    add_filter(parser)
    add_kin(parser)
    add("--by-recording", action="store_true", help="list every recording instead of surfaces")
    add("--note", metavar="NAME", help="write the scores into the model's card, under this name")
    options.add_json(parser, "print JSON instead of tables")
    group = parser.add_argument_group("a recipe that is cross-validated, without MODEL")
    group.add_argument(
        "--split",
        metavar="NAME",
        help=f"how to cross-validate: {', '.join(SPLITS)} (default: {KIN_SPLIT}; with --vary 5-fold)",
    )
    group.add_argument("--baselines", type=Within(int, 0), nargs="?", const=1, metavar="N",
        help="also cross-validate the recipe level, and the recipe on labels permuted over surfaces N times, %(type)s "
        "(without N: 1)")  # fmt: skip
    group.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="NAME=VALUE,VALUE...",
        help="an entry of a recipe file and its values, repeatable: every combination is tried, best first",
    )
    add_folds(group)
    add_recipe(group)


def run(args: argparse.Namespace) -> int:
    if args.note and not args.model:
        raise ConfigError("--note writes into a model's card: name the MODEL")
    if args.vary:
        if args.model:
            raise ConfigError("--vary tries recipes: leave out the MODEL")
        return _vary(args)
    channels = read_model(model_path(args.model)).card.channels if args.model else recipe_of(args).configured().channels
    dataset = open_filtered(args.data, args.filter, channels=channels, kin=args.kin)
    reports = {args.model: _score_model(args, dataset)} if args.model else _cross_validate(args, dataset)
    if args.note:
        _note(args, next(iter(reports.values())), dataset)
    output.show(reports, _parts(reports, by_recording=args.by_recording), as_json=args.json)
    if next(iter(reports.values())).rendered.balanced_accuracy.value < 0.25:
        output.note("beware: far worse than chance: check which labels are smooth, and the tip")
    return 0


def _score_model(args: argparse.Namespace, dataset: Dataset) -> "Report":
    from tactophone.app.recordings import recording_predictor
    from tactophone.lab.evaluation.report import make_report

    model = read_model(model_path(args.model))
    if model.card.training.get("sha256") == dataset.fingerprint:
        output.log().print("beware: the model was trained on these very recordings")
    if (tip := tip_of(dataset.recordings)) and tip_mismatch(model.card, tip):
        output.note(f"beware: the model is for the tip {model.card.tip}, but the recordings are of {tip}")
    predict = recording_predictor(args.model)
    with output.tracked(dataset.recordings, "predicting") as takes:
        return make_report([predict(take) for take in takes], decision=model.card.decision)


def _cross_validate(args: argparse.Namespace, dataset: Dataset) -> "dict[str, Report]":
    from tactophone.lab.benchmark.folds import permute_labels
    from tactophone.lab.benchmark.methods import method_of, recipe_method
    from tactophone.lab.evaluation.report import make_report
    from tactophone.lab.training.recipes import RECIPES

    recipe, how = recipe_of(args), args.split or KIN_SPLIT
    configured = recipe.configured()
    method, cache = method_of(configured), cache_of(args)
    rule = RECIPES[recipe.recipe].response_for(recipe.tip or tip_of(dataset.recordings)).decision
    reports = {method.name: make_report(_predict_folds(method, split(dataset, how), cache), decision=rule)}
    if args.baselines is not None:
        level = recipe_method("level", channels=configured.channels)
        reports[level.name] = make_report(_predict_folds(level, split(dataset, how), cache))
    for seed in range(args.baselines or 0):
        permuted = split(permute_labels(dataset, seed=seed), how)
        reports[f"permuted {seed + 1}"] = make_report(_predict_folds(method, permuted, cache), decision=rule)
    return reports


def _predict_folds(method: "Method", folds: Sequence[Fold], cache: "Cache | None") -> "list[TakePredictions]":
    from tactophone.lab.benchmark.folds import cross_validate

    with output.progress(method.name, len(folds)) as update:
        return cross_validate(method, folds, cache=cache, report=lambda done, name: update(completed=done, note=name))


def _note(args: argparse.Namespace, report: "Report", dataset: Dataset) -> None:
    from tactophone.lab.evaluation.metrics import SCORING_RULES
    from tactophone.lab.evaluation.report import RENDERED
    from tactophone.lab.training.export import add_scores

    scores: dict[str, Any] = {
        "dataset": dataset.name,
        "surfaces": report.surfaces,
        "recordings": report.recordings,
        "contact": round(report.contact, 3),
    }
    for name in RENDERED:
        scores[f"{name}, as rendered"] = getattr(report.rendered, name).rounded(3)
    for rule in SCORING_RULES:
        for name in _HEADLINE:
            scores[f"{name}, {rule} rule"] = report.rules[rule][name].rounded(3)
    add_scores(model_path(args.model), args.note, scores)


def _parts(reports: "Mapping[str, Report]", *, by_recording: bool) -> Iterator[output.Part]:
    """Yield the scores by the name of what was scored; the first is the model or the recipe, the others baselines."""
    from tactophone.lab.evaluation.metrics import SCORING_RULES

    first = next(iter(reports.values()))
    known = math.isfinite(first.rendered.balanced_accuracy.low)
    yield (
        f"{first.recordings} recordings of {first.surfaces} surfaces; {first.updates} updates, "
        f"{first.contact:.0%} of them in contact by the gate.\n"
        + (
            "In brackets: 90 % intervals, surfaces drawn anew.\n"
            if known
            else "No intervals: one surface of a class says nothing of others.\n"
        )
    )
    yield from _table(
        "as rendered",
        {
            name: {
                "balanced accuracy": report.rendered.balanced_accuracy,
                "smooth as rough": report.rendered.smooth_as_rough,
                "gaps": report.rendered.gaps,
            }
            for name, report in reports.items()
        },
    )
    bumps, dips = (f"{rate:.1f}" if math.isfinite(rate) else "-" for rate in (first.false_bumps, first.dips))
    yield f"false bumps a minute of smooth contact: {bumps}; dips a minute of rough contact: {dips}\n"
    unknown, inside, outside = map(output.percent, (first.unknown, first.unknown_wrong, first.known_wrong))
    yield f"unknown: {unknown} of contact; wrong: {inside} of unknown predictions, {outside} of all others\n"
    # Three columns of a score and its interval are what 80 characters hold.
    headings = dict(zip(_HEADLINE, ("balanced accuracy", "area under ROC", "recall at 1 %"), strict=False))
    for rule in SCORING_RULES if len(reports) > 1 else ():
        yield from _table(
            f"{rule} rule",
            {
                name: {heading: report.rules[rule][measure] for measure, heading in headings.items()}
                for name, report in reports.items()
            },
        )
    yield from _table(
        "",
        {
            words: {f"{rule} rule": first.rules[rule][name] for rule in SCORING_RULES}
            for name, words in _MEASURES.items()
        },
    )
    rows = first.by_recording if by_recording else first.by_surface
    table = Table("recording" if by_recording else "surface", "label", "updates", "contact", "authors",
                  "two-class", show_edge=False)  # fmt: skip
    for row in rows:
        shares = (row.contact, row.authors, row.two_class)
        cells = ("-" if math.isnan(share) else f"{share:.3f}" for share in shares)
        table.add_row(row.name, row.label, str(row.updates), *cells)
    yield table


def _table(corner: str, rows: Mapping[str, Mapping[str, Any]]) -> Iterator[output.Part]:
    yield output.table([{corner: name, **cells} for name, cells in rows.items()], **output.RULED)
    yield ""


def _vary(args: argparse.Namespace) -> int:
    from tactophone.lab.benchmark.folds import cross_validate, run_folds
    from tactophone.lab.benchmark.methods import method_of
    from tactophone.lab.evaluation.bootstrap import estimate
    from tactophone.lab.evaluation.predict import scores_of

    choices = {name: values.split(",") for name, values in options.assigned(args.vary, "--vary").items()}
    recipes = []
    for combination in itertools.product(*choices.values()):
        changes = dict(zip(choices, combination, strict=True))
        name = ", ".join(f"{key} {value}" for key, value in changes.items())
        recipes.append((name, recipe_of(args).changed(changes, where=f"--vary, {name}").configured()))
    dataset = open_filtered(
        args.data, args.filter, channels=max(recipe.channels for _, recipe in recipes), kin=args.kin
    )
    methods = [(name, method_of(recipe)) for name, recipe in recipes]
    folds, cache = split(dataset, args.split or "5-fold"), cache_of(args)
    todo = [(method, fold) for _, method in methods for fold in folds]
    with output.progress("varying", len(todo)) as update:
        run_folds(
            todo,
            cache,
            workers=args.workers,
            ray=args.ray,
            report=lambda done, name: update(completed=done, note=name),
        )
    trials: list[dict[str, Any]] = []
    for name, method in methods:
        found = estimate(scores_of(cross_validate(method, folds, cache=cache), "two-class"))
        scores = {key: str(found[key]) for key in _HEADLINE[:3]}
        trials.append({"settings": name, **scores, "score": found["balanced_accuracy"].value})
    trials.sort(key=lambda trial: -trial["score"])
    table = [{name.replace("_", " "): trial[name] for name in ("settings", *_HEADLINE[:3])} for trial in trials]
    output.show(trials, [table], as_json=args.json)
    output.log().print("the best of many is partly luck: score it again on surfaces that no trial was scored on")
    return 0
