"""``tactophone train``: a model file from labelled recordings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.core.recordings.values import Dataset
from tactophone.core.types import ignore
from tactophone_lab.app.evaluate import evaluate_recipe
from tactophone_lab.training.recipes import RECIPES, ConfiguredRecipe, RecipeFile

if TYPE_CHECKING:
    from tactophone_lab.evaluation.scores import Report

FEWEST_SURFACES = 3
"""Surfaces of each class below which a trained model says little of others."""

FOLDS = "3-fold"
"""How a training is scored: each third of the surfaces by a model of the others."""


@dataclass(frozen=True, slots=True)
class TrainedModel:
    """A model file, and how many recordings and surfaces of each class it was trained
    on."""

    path: Path
    recordings: int
    smooth: int
    rough: int

    @property
    def enough(self) -> bool:
        """Whether the surfaces of each class are enough to speak of others."""
        return min(self.smooth, self.rough) >= FEWEST_SURFACES


def train_model(
    recipe: ConfiguredRecipe,
    datasets: Sequence[Dataset],
    out: Path,
    *,
    restart: bool = False,
    warn: Callable[[str], None] = ignore,
    log: Callable[[str], None] = ignore,
    report: Callable[[int, int | None, str], None] = ignore,
) -> TrainedModel:
    """Train a recipe on all data sets together and write the model file.

    - ``restart``: start over where an interrupted run of this training could resume.
    - ``warn``: called before the training, with a reason to expect little of it.
    - ``log``: called with what the training decides, such as where it resumes.
    - ``report``: called with how much is done, of how much if that is
      known, and what is being done.
    """
    dataset = joined(datasets)
    labelled = [recording for recording in dataset.recordings if recording.labelled]
    surfaces = {(recording.surface, recording.rough) for recording in labelled}
    rough = sum(is_rough for _, is_rough in surfaces)
    smooth = len(surfaces) - rough
    trained = TrainedModel(out, len(labelled), smooth, rough)
    if not trained.enough:
        warn(
            f"warning: {smooth} smooth and {rough} rough surface(s) say little of "
            "others; record three of each or more"
        )
    checkpoint = out.with_name(out.name + ".unfinished")
    if restart:
        checkpoint.unlink(missing_ok=True)
    recipe.train(out, dataset, checkpoint=checkpoint, log=log, report=report)
    checkpoint.unlink(missing_ok=True)
    return trained


def score_by_folds(
    recipe: RecipeFile,
    dataset: Dataset,
    *,
    report: Callable[[str, int, int, str], None] = ignore,
) -> "Report | None":
    """Cross-validate a recipe on what it was trained on, or return ``None`` for the
    paper's network, which would take three times as long again.

    The score is of models that never met the surfaces on which they are scored; the
    model file has met all of them. ``report`` is called with the recipe's name, the
    number of folds done and of all, and the fold's name.
    """
    if RECIPES[recipe.recipe].features == "magnitudes":
        return None
    (found,) = evaluate_recipe(recipe, dataset, how=FOLDS, report=report).values()
    return found


def joined(datasets: Sequence[Dataset]) -> Dataset:
    """Join data sets for a training; the first one's folder stands for all."""
    first = datasets[0]
    return Dataset(
        " + ".join(dataset.name for dataset in datasets),
        first.root,
        tuple(recording for dataset in datasets for recording in dataset.recordings),
        tuple(problem for dataset in datasets for problem in dataset.problems),
    )
