"""Fine-tuning: a few minutes of training that teach a general model new objects without
forgetting the old.

New sound alone makes a network forget the old (McCloskey & Cohen, Psychol. Learn.
Motiv. 24, 109, 1989). So the strategy ``blend`` trains on both, and then mixes the
parameters with those before: on the line between the two lie networks nearly as good on
the new objects as the trained one and nearly as good on the old as the first (Wortsman
et al., "Robust fine-tuning of zero-shot models", CVPR 2022). The share is chosen on
surfaces that are neither trained on nor reported on. The other strategy is the paper's
own fine-tuning, which mixes nothing.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from tactophone.core.errors import DatasetError, ModelError
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import SURFACE_LABELS, FloatArray, ignore
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import Gate, read_model
from tactophone_lab.training.onnx_export import read_weights, write_model
from tactophone_lab.training.recipe_options import Variant, network_settings
from tactophone_lab.training.trainer import NetworkRecipe, Progress

Strategy = Literal["blend", "fine-tuned"]

FINETUNE_SHARES = (0.5, 0.25)
"""Shares of the trained network in the mixture, tried in this order. Three quarters
gained 2 points more on new objects, and lost 3 on others."""

STEPS = 300
"""Batches of 500: half a minute on two cores, after which new objects gained no
more."""

BATCH_SIZE = 500
"""Windows in a batch."""

LEARNING_RATE = 3e-5
"""A third of the recipe's, which gained as much on new objects (10 points) and lost
half as much on the others."""

HOLD_OUT = 3
"""Of this many takes of a new object, one is held out for testing."""


@dataclass(frozen=True, slots=True)
class FinetuningData:
    """Disjoint sets of recordings for a fine-tuning."""

    new: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    """`new` and `held_out`: takes of the new objects, to train on and to test with."""
    replay: tuple[Recording, ...]
    validation: tuple[Recording, ...]
    test: tuple[Recording, ...]
    """`replay`, `validation` and `test`: of the general set, by surface: trained on
    again, used to choose the mixture, and reported on."""


def hold_out(dataset: Dataset) -> tuple[tuple[Recording, ...], tuple[Recording, ...]]:
    """Split the takes of each object: two thirds to train on, one third, evenly drawn,
    to test with.

    Raises `DatasetError` if there are fewer than two objects, or an object has one take
    only.
    """
    takes_of: dict[str, list[Recording]] = {}
    for recording in dataset.recordings:
        takes_of.setdefault(recording.surface, []).append(recording)
    if len(takes_of) < 2:
        raise DatasetError(
            f"{dataset.root}: {len(takes_of)} new object, but two or more are needed; "
            "record another"
        )
    if single := sorted(name for name, takes in takes_of.items() if len(takes) < 2):
        raise DatasetError(
            f"{dataset.root}: {', '.join(single)}: one take only, but another is "
            "needed for testing"
        )
    drawn = [
        (n % HOLD_OUT == 1, take)
        for takes in takes_of.values()
        for n, take in enumerate(takes)
    ]
    return tuple(take for held, take in drawn if not held), tuple(
        take for held, take in drawn if held
    )


def thinned(recordings: Sequence[Recording], most: int) -> tuple[Recording, ...]:
    """Return at most ``most`` recordings, evenly drawn over surfaces and takes."""
    ordered = sorted(
        recordings,
        key=lambda recording: (recording.surface, recording.scenario, recording.take),
    )
    places = (
        np.linspace(0, len(ordered) - 1, min(most, len(ordered))).round().astype(int)
    )
    return tuple(ordered[place] for place in np.unique(places))


def finetuning_recipe(
    start: Path,
    strategy: Strategy,
    *,
    seed: int = 0,
    calibration: Calibration | None = None,
) -> NetworkRecipe:
    """Return the recipe of a fine-tuning that begins with a model file of kind
    ``paper``.

    A calibration of the set-up that the new objects were recorded with says where
    contact begins, for the labels and for the model's gate; by default the recipe and
    the first model say so. Raises `ModelError` if the model is not of kind ``paper``:
    other kinds are trained from scratch in a minute.
    """
    card = read_model(start).card
    if card.kind != "paper":
        raise ModelError(
            f"{start}: of kind {card.kind}, but only kind paper can be fine-tuned; "
            "train the other kinds anew on both "
            "data sets, which takes a minute"
        )
    variant: Variant = "general"
    if card.channels == 1:
        variant = "one-channel"
    elif strategy == "fine-tuned":
        variant = "fine-tuned"
    settings = replace(
        network_settings(variant),
        batch_size=BATCH_SIZE,
        epochs=1,
        least_steps=STEPS,
        learning_rate=LEARNING_RATE,
    )
    if calibration:
        settings = settings.with_threshold(calibration.window_dbfs)
    gate = Gate(calibration.threshold_dbfs) if calibration else card.gate
    return NetworkRecipe(settings, seed, start=start, gate=gate)


def train_on_both(
    recipe: NetworkRecipe,
    data: FinetuningData,
    *,
    reading: Callable[[int, int], None] = ignore,
    report: Callable[[Progress], None] = ignore,
) -> dict[str, FloatArray]:
    """Train on new and replayed recordings; return the parameters.

    Raises `DatasetError` if the recordings do not hold both smooth and rough.
    """
    recordings = [*data.new, *data.replay]
    if {recording.label for recording in recordings} != set(SURFACE_LABELS):
        raise DatasetError(
            "new and general recordings together hold one label only; smooth and "
            "rough are needed"
        )
    count = len(recordings)
    return recipe.fit(
        recipe.read_windows(recordings, report=lambda done: reading(done, count)),
        report=report,
    )


def mixtures(
    start: Path, trained: dict[str, FloatArray], strategy: Strategy
) -> Iterator[tuple[float, dict[str, FloatArray]]]:
    """Yield the networks to choose from, with the share of the trained one in each."""
    before = read_weights(start)
    for share in FINETUNE_SHARES if strategy == "blend" else (1.0,):
        yield (
            share,
            {
                name: (share * trained[name] + (1 - share) * before[name]).astype(
                    np.float32
                )
                for name in trained
            },
        )


def write_finetuned(
    path: Path,
    recipe: NetworkRecipe,
    weights: dict[str, FloatArray],
    *,
    facts: dict[str, object],
) -> None:
    """Write the fine-tuned model: the first one's card, with the facts of the
    fine-tuning added."""
    if recipe.start is None:
        raise ValueError("a fine-tuning starts from a model")
    card = read_model(recipe.start).card
    training = {**card.training, "finetuned": {"from": card.name, **facts}}
    licence = "; ".join(
        filter(None, (card.licence, "fine-tuned on recordings of the user's own"))
    )
    card = replace(
        card,
        name=path.stem,
        gate=recipe.effective_gate,
        training=training,
        scores={},
        licence=licence,
    )
    write_model(path, card, weights)
