"""From a data set to a model file: reads, finds windows, learns, describes, writes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tactophone.dataset import Dataset, Recording
from tactophone.errors import ModelError
from tactophone.link import Codec
from tactophone.perception import Gate
from tactophone.training.model_export import AUTHORS_GATE, make_card, read_weights, training_facts, write_model
from tactophone.training.network.model import channels_of
from tactophone.training.network.recipe import LABEL_LEVEL_DBFS, Recipe
from tactophone.training.network.trainer import Progress, train
from tactophone.training.network.windows import Windows, cut
from tactophone.training.provenance import caveats_of, licence_of
from tactophone.training.sound import read_signals
from tactophone.types import FloatArray, Touch

OPEN_GATE = Gate(-200.0)
"""Every window counts as contact: for recordings that hold nothing else, whatever their level."""


@dataclass(frozen=True, slots=True)
class TrainingJob:
    """A training run but for its sound: what is done, and where it begins.

    Parameters
    ----------
    recipe
        The settings.
    seed
        Of everything random.
    codec
        What the sound is passed through first, as the network will hear it behind the link.
    start
        A model file to go on from; random parameters if not given.
    gate
        The contact gate of the model; by default that of the recipe.
    """

    recipe: Recipe
    seed: int = 0
    codec: Codec | None = None
    start: Path | None = None
    gate: Gate | None = None

    @property
    def effective_gate(self) -> Gate:
        """The gate that the model will have: the paper's level, or its authors' test threshold."""
        return self.gate or (Gate(LABEL_LEVEL_DBFS) if self.recipe.following == "paper" else AUTHORS_GATE)


def find_windows(
    course: TrainingJob, recordings: Sequence[Recording], *, report: Callable[[int], None] = lambda done: None
) -> Windows:
    """Read labelled recordings and find the windows that the recipe keeps."""
    signals = read_signals(recordings, channels=course.recipe.channels, codec=course.codec, report=report)
    labels = [recording.label or Touch.NONE for recording in recordings]
    return cut(signals, labels, rule=course.recipe.labelling)


def learn(
    course: TrainingJob,
    windows: Windows,
    *,
    saved: Path | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> dict[str, FloatArray]:
    """Train on windows; see :func:`tactophone.training.network.trainer.train`.

    Raises
    ------
    ModelError
        If the model to begin from has another number of channels.
    """
    initial = read_weights(course.start) if course.start else None
    if initial and channels_of(initial) != course.recipe.channels:
        raise ModelError(
            f"{course.start}: hears {channels_of(initial)} channel(s), but the variant {course.recipe.variant} has "
            f"{course.recipe.channels}; begin from another model or choose another variant"
        )
    return train(windows, course.recipe, seed=course.seed, saved=saved, initial=initial, report=report)


def write_trained(path: Path, course: TrainingJob, weights: dict[str, FloatArray], *, dataset: Dataset) -> None:
    """Write the model file, named after the file, with what it was trained on."""
    card = make_card(weights, name=path.stem, gate=course.effective_gate, licence=licence_of(dataset))
    card = replace(card, scores=caveats_of(dataset))
    facts = training_facts(
        course.recipe,
        seed=course.seed,
        dataset=dataset.name,
        fingerprint=dataset.fingerprint,
        surfaces=len(dataset.surfaces),
    )
    if course.codec:
        facts["codec"] = f"{course.codec.name}, {course.codec.bitrate_bps} bit/s, to {course.codec.bandwidth:g} Hz"
    if course.start:
        facts["start"] = course.start.name
    write_model(path, replace(card, training=facts), weights)
