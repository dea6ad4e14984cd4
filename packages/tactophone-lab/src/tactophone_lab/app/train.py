"""``tactophone train``: a model file from labelled recordings."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from tactophone.core.recordings.values import Dataset
from tactophone.core.types import ignore
from tactophone_lab.training.recipes import ConfiguredRecipe

FEWEST_SURFACES = 3
"""Surfaces of each class below which a trained model says little of others."""


@dataclass(frozen=True, slots=True)
class TrainedModel:
    """A model file, and how many recordings and surfaces of each class it was trained
    on."""

    path: Path
    recordings: int
    smooth: int
    rough: int


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
    dataset = _joined(datasets)
    labelled = [recording for recording in dataset.recordings if recording.labelled]
    surfaces = {(recording.surface, recording.rough) for recording in labelled}
    rough = sum(is_rough for _, is_rough in surfaces)
    smooth = len(surfaces) - rough
    if min(smooth, rough) < FEWEST_SURFACES:
        warn(
            f"warning: {smooth} smooth and {rough} rough surface(s) say little of "
            "others; record three of each or more"
        )
    checkpoint = out.with_name(out.name + ".unfinished")
    if restart:
        checkpoint.unlink(missing_ok=True)
    recipe.train(out, dataset, checkpoint=checkpoint, log=log, report=report)
    checkpoint.unlink(missing_ok=True)
    return TrainedModel(out, len(labelled), smooth, rough)


def _joined(datasets: Sequence[Dataset]) -> Dataset:
    """Join data sets for a training; the first one's folder stands for all."""
    first = datasets[0]
    return Dataset(
        " + ".join(dataset.name for dataset in datasets),
        first.root,
        tuple(recording for dataset in datasets for recording in dataset.recordings),
        tuple(problem for dataset in datasets for problem in dataset.problems),
    )
