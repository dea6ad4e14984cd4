"""From a general model to one that knows new objects too, without forgetting: a few minutes of training.

New sound alone makes a network forget the old (McCloskey & Cohen, Psychol. Learn. Motiv. 24, 109, 1989). So it is
trained on both, and then its parameters are mixed with those it had before: on the line between the two lie networks
nearly as good on the new as the trained one and nearly as good on the old as the first (Wortsman et al., "Robust
fine-tuning of zero-shot models", CVPR 2022). How far along that line to go is chosen on surfaces that are neither
trained on nor reported on. The paper's own fine-tuning, which mixes nothing, is the other way.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from tactophone.dataset import Dataset, Recording
from tactophone.errors import DatasetError, ModelError
from tactophone.perception import Gate, ModelCard, read_model
from tactophone.perception.sensor_health.calibration_file import Calibration
from tactophone.training.model_export import read_weights, write_model
from tactophone.training.network.recipe import Recipe, paper
from tactophone.training.network.trainer import Progress
from tactophone.training.network.training_job import TrainingJob, find_windows, learn
from tactophone.types import FloatArray, Touch

FeatureRecipe = Literal["blend", "fine-tuned"]
WAYS: tuple[FeatureRecipe, ...] = ("blend", "fine-tuned")

SHARES = (0.5, 0.25)
"""How much of the trained network is mixed in, tried in this order. Three quarters gained 2 points more on new objects,
and lost 3 on others."""

STEPS = 300
"""Batches of 500: half a minute on two cores, after which new objects gained no more."""

BATCH = 500
LEARNING_RATE = 3e-5
"""A third of the recipe's, which gained as much on new objects (10 points) and lost half as much on the others."""

HOLD_OUT = 3
"""One take in so many of each new object is kept for testing."""


@dataclass(frozen=True, slots=True)
class Material:
    """What an adaptation is made of: recordings that share none.

    Parameters
    ----------
    new, held_out
        Takes of the new objects, to train on and to test with.
    replay, validation, test
        Of the general set, by surface: trained on again, chosen by, and reported on.
    """

    new: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    replay: tuple[Recording, ...]
    validation: tuple[Recording, ...]
    test: tuple[Recording, ...]


def hold_out(dataset: Dataset) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Part the takes of each object: two thirds to train on, one third, evenly drawn, to test with.

    Raises
    ------
    DatasetError
        If there are fewer than two objects, or an object has one take only.
    """
    groups: dict[str, list[Recording]] = {}
    for one in dataset.recordings:
        groups.setdefault(one.surface, []).append(one)
    if len(groups) < 2:
        raise DatasetError(f"{dataset.root}: {len(groups)} new object, but two or more are wanted; record another")
    lonely = sorted(name for name, takes in groups.items() if len(takes) < 2)
    if lonely:
        raise DatasetError(f"{dataset.root}: {', '.join(lonely)}: one take only, but one is wanted for testing, too")
    every = [(n % HOLD_OUT == 1, one) for takes in groups.values() for n, one in enumerate(takes)]
    return tuple(one for out, one in every if not out), tuple(one for out, one in every if out)


def thinned(recordings: Sequence[Recording], most: int) -> tuple[Recording, ...]:
    """Keep at most so many recordings, evenly drawn over surfaces and takes."""
    ordered = sorted(recordings, key=lambda one: (one.surface, one.scenario, one.take))
    places = np.linspace(0, len(ordered) - 1, min(most, len(ordered))).round().astype(int)
    return tuple(ordered[place] for place in np.unique(places))


def training_job_for(
    start: Path, way: FeatureRecipe, *, seed: int = 0, calibration: Calibration | None = None
) -> TrainingJob:
    """Describe the training that an adaptation does.

    Parameters
    ----------
    start
        A model file of kind ``paper``.
    way
        ``blend``, or the paper's own ``fine-tuned``.
    calibration
        Of the set-up that the new objects were recorded with: where contact begins, for the labels and for the model's
        gate; without one, the recipe and the first model say so.

    Raises
    ------
    ModelError
        If the model is of another kind: those of few weights are trained anew in a minute instead.
    """
    card = read_model(start).card
    if card.kind != "paper":
        raise ModelError(
            f"{start}: of kind {card.kind}, but kind paper alone is adapted; train the other kinds anew on both data "
            "sets, which takes a minute"
        )
    gate = Gate(calibration.threshold_dbfs) if calibration else card.gate
    return TrainingJob(_recipe(card, way, calibration), seed, start=start, gate=gate)


def _recipe(card: ModelCard, way: FeatureRecipe, calibration: Calibration | None) -> Recipe:
    plain = paper("one-channel" if card.channels == 1 else "fine-tuned" if way == "fine-tuned" else "general")
    recipe = replace(plain, batch_size=BATCH, epochs=1, least_steps=STEPS, learning_rate=LEARNING_RATE)
    if calibration is None or recipe.labelling.relative:
        return recipe
    return replace(recipe, labelling=replace(recipe.labelling, threshold=10 ** (calibration.window_dbfs / 20)))


def train_on_both(
    course: TrainingJob, material: Material, *, report: Callable[[Progress], None] = lambda progress: None
) -> dict[str, FloatArray]:
    """Train on new and replayed recordings, every surface of a label weighing the same; give the parameters."""
    recordings = [*material.new, *material.replay]
    if {one.label for one in recordings} != {Touch.SMOOTH, Touch.ROUGH}:
        raise DatasetError("new and general recordings together hold one label only; both smooth and rough are wanted")
    return learn(course, find_windows(course, recordings), report=report)


def mixtures(
    start: Path, trained: dict[str, FloatArray], way: FeatureRecipe
) -> Iterator[tuple[float, dict[str, FloatArray]]]:
    """Give the networks to choose from, with the share of the trained one in each."""
    before = read_weights(start)
    for share in SHARES if way == "blend" else (1.0,):
        yield share, {name: (share * trained[name] + (1 - share) * before[name]).astype(np.float32) for name in trained}


def write_adapted(path: Path, course: TrainingJob, weights: dict[str, FloatArray], *, facts: dict[str, object]) -> None:
    """Write the adapted model: the first one's card, with what it went through since."""
    if course.start is None:
        raise ValueError("an adaptation begins from a model")
    card = read_model(course.start).card
    told = {**card.training, "adapted": {"from": card.name, **facts}}
    licence = "; ".join(filter(None, (card.licence, "adapted on recordings of the user's own")))
    changed = replace(card, name=path.stem, gate=course.effective_gate, training=told, scores={}, licence=licence)
    write_model(path, changed, weights)
