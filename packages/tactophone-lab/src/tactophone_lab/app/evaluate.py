"""Scores of a model on a data set, of recipes by cross-validation, and of many recipes
beside each other."""

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from tactophone.core.recordings.values import Dataset, Problem, tip_of
from tactophone.core.types import SURFACE_LABELS, ignore
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path, tip_mismatch
from tactophone_lab.datasets.splits import KIN_SPLIT, Fold, split
from tactophone_lab.evaluation.predict import (
    TakePredictions,
    recording_predictor,
)
from tactophone_lab.evaluation.scores import RENDERED, Report, make_report

if TYPE_CHECKING:
    from tactophone_lab.benchmark.folds import Cache, Method
    from tactophone_lab.training.recipes import RecipeFile

HEADLINE = ("balanced_accuracy", "auc", "recall_at_1", "false_positive_rate")
"""Scores of single windows that a model's card keeps."""

Progress = Callable[[str, int, int, str], None]
"""Called with what is being done, how many parts of it are done, of how many, and the
name of the newest."""


def evaluate_model(
    model: str, dataset: Dataset, *, report: Progress = ignore
) -> tuple[Report, list[str]]:
    """Score a model, a shipped one's name or a file, as `tactophone feel` renders the
    recordings of a data set.

    Returns the scores, and warnings: trained on these recordings, or for another tip.
    """
    card, predict, takes = (
        read_model(model_path(model)).card,
        recording_predictor(model),
        list[TakePredictions](),
    )
    for recording in dataset.recordings:
        takes.append(predict(recording))
        report("predicting", len(takes), len(dataset.recordings), recording.path.name)
    warnings = []
    if card.training.get("sha256") == dataset.fingerprint:
        warnings.append("warning: the model was trained on these very recordings")
    if (tip := tip_of(dataset.recordings)) and tip_mismatch(card, tip):
        warnings.append(
            f"warning: the model is for the tip {card.tip}, but the recordings are of "
            f"{tip}"
        )
    return make_report(takes, decision=card.decision), warnings


FEWEST_CHECKED = 3
"""Surfaces of each class, beside the one that is checked, from which its label is
doubted."""

OPPOSITE = 0.8
"""Share of a surface's contact that a model of all others must call the opposite before
its label is doubted."""


def can_check_labels(dataset: Dataset) -> bool:
    """Return whether there are surfaces enough of each class, and the extra ``train``
    is installed."""
    kept = dataset.labelled()
    labels = [
        next(take.rough for take in kept.recordings if take.surface == surface)
        for surface in kept.surfaces
    ]
    enough = min(sum(labels), len(labels) - sum(labels)) > FEWEST_CHECKED
    return enough and all(
        importlib.util.find_spec(module) for module in ("torch", "onnx", "sklearn")
    )


def suspicious_labels(dataset: Dataset, *, report: Progress = ignore) -> list[Problem]:
    """Name each surface that a model of all other kinds calls the opposite of its
    label.

    Each surface is predicted by the recipe ``texture``, trained without it and its kin.
    Raises `DatasetError` if no sound is loud enough to be contact.
    """
    from tactophone_lab.benchmark.folds import cross_validate
    from tactophone_lab.benchmark.methods import method_of
    from tactophone_lab.datasets.checks import channels_of_all
    from tactophone_lab.training.recipes import RecipeFile

    kept = dataset.labelled()
    recipe = RecipeFile().changed(
        {"channels": channels_of_all(kept)}, where="dataset check"
    )
    found = _opposite(
        evaluate_recipe(recipe, kept, how=KIN_SPLIT, report=report)["texture"]
    )
    rest = kept.where(lambda take: take.surface not in found)
    if len(found) > 1 and len({take.rough for take in rest.recordings}) == len(
        SURFACE_LABELS
    ):
        # A wrong label misleads the models of others: a model that heard none of the
        # doubted tells who was misled.
        doubted = tuple(take for take in kept.recordings if take.surface in found)
        folds = [Fold("doubted", rest.recordings, doubted)]
        found = (
            _opposite(
                make_report(cross_validate(method_of(recipe.configured()), folds))
            )
            or found
        )
    return [
        Problem(kept.root / name, "surface", _doubt(*doubt), fatal=False)
        for name, doubt in found.items()
    ]


def _opposite(scores: Report) -> dict[str, tuple[str, float]]:
    """Return label and share right of each surface that is mostly called the opposite,
    by name."""
    return {
        row.name: (row.label, row.windows_right)
        for row in scores.by_surface
        if row.windows_right <= 1 - OPPOSITE
    }


def _doubt(label: str, right: float) -> str:
    other = "smooth" if label == "rough" else "rough"
    return (
        f"its label {label} looks wrong: {1 - right:.0%} {other} to a model of all "
        "other kinds; "
        "listen to it, and set it right"
    )


def evaluate_recipe(
    recipe: "RecipeFile",
    dataset: Dataset,
    *,
    how: str,
    baselines: int | None = None,
    cache: "Cache | None" = None,
    report: Progress = ignore,
) -> dict[str, Report]:
    """Cross-validate a recipe; returns its scores and then the baselines' scores, by
    name.

    - ``how``: one of `tactophone_lab.datasets.splits.SPLITS`.
    - ``baselines``: how often labels are permuted over the surfaces to train the recipe
      on. Any number also adds the recipe ``level``; ``None`` leaves both out.
    """
    from tactophone_lab.benchmark.folds import cross_validate, permute_labels
    from tactophone_lab.benchmark.methods import method_of, recipe_method

    configured = recipe.configured()
    method = method_of(configured)
    rule = _decision_of(recipe, dataset)

    def predict(method: "Method", dataset: Dataset) -> list[TakePredictions]:
        folds = split(dataset, how)
        return cross_validate(
            method,
            folds,
            cache=cache,
            report=lambda done, name: report(method.name, done, len(folds), name),
        )

    reports = {method.name: make_report(predict(method, dataset), decision=rule)}
    if baselines is not None:
        level = recipe_method("level", channels=configured.channels)
        reports[level.name] = make_report(predict(level, dataset))
    for seed in range(baselines or 0):
        permuted = permute_labels(dataset, seed=seed)
        reports[f"permuted {seed + 1}"] = make_report(
            predict(method, permuted), decision=rule
        )
    return reports


def _decision_of(recipe: "RecipeFile", dataset: Dataset) -> DecisionRule:
    """Return the rule by which a model of a recipe decides what is felt."""
    from tactophone_lab.training.recipes import RECIPES

    tip = recipe.tip or tip_of(dataset.recordings)
    return RECIPES[recipe.recipe].response_for(tip).decision


@dataclass(frozen=True, slots=True)
class Trial:
    """A recipe that was tried among others: its name and its scores."""

    settings: str
    report: Report


def compare_recipes(
    recipes: Mapping[str, "RecipeFile"],
    dataset: Dataset,
    *,
    how: str = "5-fold",
    cache: "Cache | None" = None,
    workers: int = 2,
    ray: bool = False,
    report: Progress = ignore,
) -> list[Trial]:
    """Cross-validate recipes on the same folds; returns them best first, by the
    balanced accuracy of what is felt."""
    from tactophone_lab.benchmark.folds import cross_validate, default_cache, run_folds
    from tactophone_lab.benchmark.methods import method_of

    cache = cache or default_cache()
    methods = {name: method_of(recipe.configured()) for name, recipe in recipes.items()}
    folds = split(dataset, how)
    todo = [(method, fold) for method in methods.values() for fold in folds]
    run_folds(
        todo,
        cache,
        workers=workers,
        ray=ray,
        report=lambda done, name: report("varying", done, len(todo), name),
    )
    trials = [
        Trial(
            name,
            make_report(
                cross_validate(method, folds, cache=cache),
                decision=_decision_of(recipes[name], dataset),
            ),
        )
        for name, method in methods.items()
    ]
    return sorted(
        trials, key=lambda trial: -trial.report.rendered.balanced_accuracy.value
    )


def note_scores(model: str, name: str, report: Report, dataset: Dataset) -> None:
    """Write scores into a model's card, under a name."""
    from tactophone_lab.training.onnx_export import add_scores

    scores: dict[str, Any] = {
        "dataset": dataset.name,
        "surfaces": report.surfaces,
        "recordings": report.recordings,
        "contact": round(report.contact, 3),
    }
    scores |= {
        f"{each}, as rendered": getattr(report.rendered, each).rounded(3)
        for each in RENDERED
    }
    scores |= {
        f"{each}, two-class rule": report.windows[each].rounded(3) for each in HEADLINE
    }
    add_scores(model_path(model), name, scores)
