"""``tactophone evaluate``: scores of a model, or of recipes by cross-validation."""

import argparse
import itertools
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli import options, output
from tactophone.cli.options import Within
from tactophone.core import extras
from tactophone.core.errors import ConfigError
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.app.evaluate import (
    compare_recipes,
    evaluate_model,
    evaluate_recipe,
    note_scores,
)
from tactophone_lab.cli.data import (
    add_folds,
    add_kin,
    add_selection,
    bars,
    cache_of,
    open_filtered,
    reading_of,
)
from tactophone_lab.cli.train import add_recipe, recipe_for, recipe_of
from tactophone_lab.datasets.shared_sound import leak_warnings
from tactophone_lab.datasets.splits import KIN_SPLIT, SPLITS, split

if TYPE_CHECKING:
    from tactophone_lab.evaluation.bootstrap import Estimate
    from tactophone_lab.evaluation.scores import Report

EXAMPLES = (
    "tactophone evaluate texture --data recordings",
    "tactophone evaluate --data recordings --recipe texture --baselines",
    "tactophone evaluate --data recordings --recipe paper-fast --vary epochs=1,5 "
    "--vary seed=0,1",
)

FLICKER = 60.0
"""False bumps or dips a minute over which their number says no more."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "model",
        nargs="?",
        metavar="MODEL",
        help="a model file or the name of a shipped one; leave it out to "
        "cross-validate a recipe",
    )
    add(
        "--data",
        type=Path,
        required=True,
        metavar="DIR",
        help="a data set, or class folders rough/ and smooth/",
    )
    add_selection(parser)
    add_kin(parser)
    add(
        "--by-recording",
        action="store_true",
        help="list every recording instead of surfaces",
    )
    add(
        "--note",
        metavar="NAME",
        help="write the scores into the model's card, under this name",
    )
    options.add_json(parser, "print JSON instead of tables")
    group = parser.add_argument_group("a recipe that is cross-validated, without MODEL")
    words = (
        f"how to cross-validate: {', '.join(SPLITS)} (default: {KIN_SPLIT}; with "
        "--vary 5-fold)"
    )
    group.add_argument("--split", metavar="NAME", help=words)
    group.add_argument(
        "--baselines",
        type=Within(int, 0),
        nargs="?",
        const=1,
        metavar="N",
        help="also cross-validate the recipe level, and the recipe on labels permuted "
        "over surfaces N times, %(type)s "
        "(without N: 1)",
    )
    words = (
        "an entry of a recipe file and its values, repeatable: every combination "
        "is tried, the best felt first"
    )
    group.add_argument(
        "--vary", action="append", default=[], metavar="NAME=VALUE,VALUE...", help=words
    )
    add_folds(group)
    add_recipe(group)


def run(args: argparse.Namespace) -> int:
    if args.note and not args.model:
        raise ConfigError("--note writes into a model's card: name the MODEL")
    if args.vary and args.model:
        raise ConfigError("--vary tries recipes: leave out the MODEL")
    if not args.model:
        extras.require_extras("train")
    if args.vary:
        return _vary(args)
    recipe = recipe_of(args) if args.model else recipe_for(args, args.data)
    channels = (
        read_model(model_path(args.model)).card.channels
        if args.model
        else recipe.configured().channels
    )
    dataset = open_filtered(
        args.data,
        args.filter,
        channels=channels,
        kin=args.kin,
        reading=reading_of(args),
    )
    with bars() as report:
        if args.model:
            found, warnings = evaluate_model(args.model, dataset, report=report)
            warnings += leak_warnings(dataset, ())
            reports = {args.model: found}
        else:
            how = args.split or KIN_SPLIT
            warnings = leak_warnings(dataset, split(dataset, how))
            reports = evaluate_recipe(
                recipe,
                dataset,
                how=how,
                baselines=args.baselines,
                cache=cache_of(args),
                report=report,
            )
    for warning in warnings:
        output.note(warning)
    if args.note:
        note_scores(args.model, args.note, reports[args.model], dataset)
    output.show(
        reports, _parts(reports, by_recording=args.by_recording), as_json=args.json
    )
    if next(iter(reports.values())).rendered.balanced_accuracy.value < 0.25:
        output.note(
            "warning: far worse than chance: check which labels are smooth, and the tip"
        )
    return 0


def _parts(
    reports: "Mapping[str, Report]", *, by_recording: bool
) -> Iterator[output.Part]:
    """Yield the scores by the name of what was scored; the first is the model or the
    recipe, the others baselines."""
    from tactophone_lab.evaluation.bootstrap import FEWEST_SURFACES

    first = next(iter(reports.values()))
    known = math.isfinite(first.rendered.balanced_accuracy.low)
    yield (
        f"{first.recordings} recordings of {first.surfaces} surfaces; {first.updates} "
        "updates, "
        f"{first.contact:.0%} of them in contact by the gate.\n"
        + (
            "In brackets: 90 % intervals, surfaces drawn anew.\n"
            if known
            else f"No intervals: fewer than {FEWEST_SURFACES} surfaces of a class say "
            "too little of others.\n"
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
    if not known and any(name.startswith("permuted") for name in reports):
        yield (
            "Of so few surfaces a permutation keeps or exchanges most labels, so "
            "one control may lie far from 0.5.\n"
        )
    bumps = _per_minute(first.false_bumps)
    dips = _per_minute(first.dips)
    yield (
        f"false bumps a minute of smooth contact: {bumps}; dips a minute of rough "
        f"contact: {dips}\n"
    )
    if not math.isnan(first.unknown):
        unknown, inside, outside = map(
            output.percent, (first.unknown, first.unknown_wrong, first.known_wrong)
        )
        yield (
            f"unknown: {unknown} of contact; rendered wrong: {inside} of that, "
            f"{outside} of the rest\n"
        )
    # What a better threshold could reach: the model's own does not count here.
    yield from _table(
        "single windows",
        {
            name: {
                "area under ROC": report.windows["auc"],
                "rough recall at 1 %": report.windows["recall_at_1"],
            }
            for name, report in reports.items()
        },
    )
    rows = first.by_recording if by_recording else first.by_surface
    heading = "recording" if by_recording else "surface"
    shown = [
        {
            heading: row.name,
            "label": row.label,
            "updates": row.updates,
            "contact": _share(row.contact),
            "right": _share(row.right),
        }
        for row in rows
    ]
    yield output.table(shown, **output.RULED)


def _share(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3f}"


def _table(corner: str, rows: Mapping[str, Mapping[str, Any]]) -> Iterator[output.Part]:
    yield output.table(
        [{corner: name, **cells} for name, cells in rows.items()], **output.RULED
    )
    yield ""


def _vary(args: argparse.Namespace) -> int:
    choices = {
        name: values.split(",")
        for name, values in options.assigned(args.vary, "--vary").items()
    }
    recipes = {}
    for combination in itertools.product(*choices.values()):
        changes = dict(zip(choices, combination, strict=True))
        name = ", ".join(f"{key} {value}" for key, value in changes.items())
        recipes[name] = recipe_of(args).changed(changes, where=f"--vary, {name}")
    channels = max(recipe.configured().channels for recipe in recipes.values())
    dataset = open_filtered(
        args.data,
        args.filter,
        channels=channels,
        kin=args.kin,
        reading=reading_of(args),
    )
    for warning in leak_warnings(dataset, split(dataset, args.split or "5-fold")):
        output.note(warning)
    with bars() as report:
        trials = compare_recipes(
            recipes,
            dataset,
            how=args.split or "5-fold",
            cache=cache_of(args),
            workers=args.workers,
            ray=args.ray,
            report=report,
        )
    scores = {each.settings: _ranked(each.report) for each in trials}
    table = [
        {
            "settings": name,
            **{key.replace("_", " "): str(value) for key, value in own.items()},
        }
        for name, own in scores.items()
    ]
    values = [
        {
            "settings": name,
            **{key: str(value) for key, value in own.items()},
            "score": own["balanced_accuracy"].value,
        }
        for name, own in scores.items()
    ]
    output.show(values, [table], as_json=args.json)
    output.log().print(
        "ranked by the balanced accuracy of what is felt; the best of many is partly "
        "luck: score it again on surfaces that no trial was scored on"
    )
    return 0


def _ranked(report: "Report") -> "dict[str, Estimate]":
    """Return the scores that `--vary` shows, all of what is felt; it ranks by the
    first."""
    names = ("balanced_accuracy", "smooth_as_rough", "gaps")
    return {name: getattr(report.rendered, name) for name in names}


def _per_minute(rate: float) -> str:
    """Return a rate as it is printed; one that flickers is no rate any more."""
    if math.isnan(rate):
        return "-"
    if rate >= FLICKER:
        return "over one a second"
    return f"{rate:.1f}"
