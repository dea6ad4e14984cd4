"""What the paper did, as values: its three models, each as the paper tells it and as its authors' code has it.

Where the two differ, and what we made of it, is in docs/training.md.
"""

from dataclasses import dataclass, replace
from typing import Literal

from tactophone.perception.features.loudness import LoudnessRule

Variant = Literal["general", "fine-tuned", "one-channel"]
Following = Literal["paper", "authors"]
Precision = Literal["float32", "bfloat16"]

VARIANTS: tuple[Variant, ...] = ("general", "fine-tuned", "one-channel")
FOLLOWING: tuple[Following, ...] = ("paper", "authors")
PRECISIONS: tuple[Precision, ...] = ("float32", "bfloat16")

LABEL_LEVEL_DBFS = -26.0
"""RMS over which the paper's general model takes a window for contact: slightly over its piezo's noise floor."""


@dataclass(frozen=True, slots=True)
class Labelling:
    """Which windows are taken for contact, and so have their recording's label; the others are *none*.

    Parameters
    ----------
    loudness
        ``"rms"``, or ``"mean_absolute"``; of the window's first channel.
    threshold
        Least loudness: of full scale, or of the mean loudness of all windows with that label if ``relative``.
    relative
        See ``threshold``.
    quiet_rough
        Whether quiet windows of rough recordings are trained as *none* too; if not, they are left out.
    """

    loudness: LoudnessRule
    threshold: float
    relative: bool = False
    quiet_rough: bool = True


@dataclass(frozen=True, slots=True)
class Recipe:
    """Everything that decides a training run but the sound and the seed.

    ``hop`` is in samples at 2 kHz: the authors take every window (1), which neither trains better nor finishes
    (docs/training.md); ``noise`` is the standard deviation of the Gaussian noise added to each window. Epochs go on
    until there were ``least_steps`` batches: five epochs of a few minutes of sound teach nothing.
    """

    variant: Variant
    following: Following
    channels: int
    labelling: Labelling
    class_weights: tuple[float, float, float]
    noise: float = 0.005
    epochs: int = 5
    batch_size: int = 1000
    learning_rate: float = 1e-4
    hop: int = 21
    least_steps: int = 500
    precision: Precision = "float32"

    @property
    def name(self) -> str:
        """For model cards and tables.

        >>> paper("one-channel").name
        'paper/one-channel'
        """
        return f"{self.following}/{self.variant}"


_EQUAL = (1.0, 1.0, 1.0)
"""The paper names no class weights."""

_PAPER_LABELLING: dict[Variant, Labelling] = {
    "general": Labelling("rms", 10 ** (LABEL_LEVEL_DBFS / 20)),
    "fine-tuned": Labelling("rms", 0.5, relative=True),
    "one-channel": Labelling("rms", 10 ** (LABEL_LEVEL_DBFS / 20)),
}


def paper(variant: Variant, *, following: Following = "paper") -> Recipe:
    """Give a recipe of the paper, as the paper tells it or as its authors' code has it; ``replace`` changes parts.

    >>> paper("general").epochs, paper("general", following="authors").class_weights
    (5, (1.0, 0.05, 0.05))
    """
    told = Recipe(variant, "paper", 1 if variant == "one-channel" else 2, _PAPER_LABELLING[variant], _EQUAL)
    if following == "paper":
        return told
    return replace(
        told,
        following="authors",
        labelling=Labelling("mean_absolute", 1.0, relative=True, quiet_rough=False),
        class_weights=(1.0, 0.05, 0.05),
    )
