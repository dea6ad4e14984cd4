"""The paper's three models as values: each as the paper describes it and as its authors' reference code has it.

docs/guide/training.md lists where the two differ and what this package does otherwise. Needs no torch.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from types import MappingProxyType
from typing import Literal

from tactophone.perception import Gate, LoudnessRule
from tactophone.types import LIVE_SAMPLE_RATE

Variant = Literal["general", "fine-tuned", "one-channel"]
Precision = Literal["float32", "bfloat16"]

VARIANTS: tuple[Variant, ...] = ("general", "fine-tuned", "one-channel")
PRECISIONS: tuple[Precision, ...] = ("float32", "bfloat16")

NETWORK_RATE = 2000
"""Sample rate of the paper's network in Hz."""

NETWORK_WINDOW_SIZE = 512
"""Samples in a window of the paper's network: 256 ms at 2 kHz."""

NETWORK_HOP = Fraction(512 * NETWORK_RATE, LIVE_SAMPLE_RATE)
"""Samples from one prediction to the next: the paper predicts at every sound buffer, 512 samples at 48 kHz."""

LABEL_LEVEL_DBFS = -26.0
"""RMS over which the paper's general model takes a window for contact: slightly over its piezo's noise floor."""

REFERENCE_GATE = Gate(-46.02, "mean_absolute")
"""0.005, over which the authors' code takes a window for contact when it scores."""

OPEN_GATE = Gate(-200.0)
"""Every window counts as contact: for recordings that hold nothing else, whatever their level."""


@dataclass(frozen=True, slots=True)
class Labelling:
    """Which windows count as contact, and so take their recording's label; the others are *none*."""

    loudness: LoudnessRule
    """``"rms"``, or ``"mean_absolute"``; of the window's first channel."""
    threshold: float
    """Least loudness: of full scale, or of the mean loudness of all windows with that label if ``relative``."""
    relative: bool = False
    """See ``threshold``."""
    quiet_rough: bool = True
    """Whether quiet windows of rough recordings are trained as *none* too; if not, they are left out."""


@dataclass(frozen=True, slots=True)
class NetworkSettings:
    """Everything that decides a training run of the paper's network but the recordings and the seed.

    The defaults are the paper's. ``hop`` is in samples at 2 kHz: a window for every sound buffer, 10.7 ms; the authors'
    code takes every window (1), which neither trains better nor finishes (docs/guide/training.md). ``noise`` is the
    standard deviation of the Gaussian noise added to each window. Epochs repeat until there were ``least_steps``
    batches, see :data:`FAST_CHANGES`.
    """

    variant: Variant
    reference_code: bool
    channels: int
    labelling: Labelling
    class_weights: tuple[float, float, float]
    noise: float = 0.005
    epochs: int = 5
    batch_size: int = 6000
    learning_rate: float = 1e-4
    hop: int = 21
    least_steps: int = 0
    precision: Precision = "float32"

    @property
    def name(self) -> str:
        """For model cards and tables.

        >>> network_settings("one-channel").name
        'paper/one-channel'
        """
        return f"{'authors' if self.reference_code else 'paper'}/{self.variant}"

    def with_threshold(self, level_dbfs: float) -> "NetworkSettings":
        """Return the settings with contact from an RMS level in dBFS; unchanged where the threshold is relative."""
        if self.labelling.relative:
            return self
        labelling = replace(self.labelling, loudness="rms", threshold=10 ** (level_dbfs / 20))
        return replace(self, labelling=labelling)

    def without_gate(self) -> "NetworkSettings":
        """Return the settings with every window labelled as contact."""
        return replace(self, labelling=replace(self.labelling, threshold=0.0, relative=False))


FAST_CHANGES: Mapping[str, int] = MappingProxyType({"batch_size": 1000, "least_steps": 500})
"""What the recipe ``paper-fast`` changes: smaller batches reach an equal score for a fifth of the processor time
(`python benchmarks/training.py`), and five epochs of a few minutes of sound are too few to converge."""


def network_settings(variant: Variant, *, reference_code: bool = False) -> NetworkSettings:
    """Return the settings of one of the paper's models; change parts with ``dataclasses.replace``.

    With ``reference_code`` they follow the authors' code where it differs from the paper's text.

    Examples
    --------
    >>> network_settings("general").epochs, network_settings("general", reference_code=True).class_weights
    (5, (1.0, 0.05, 0.05))
    """
    channels = 1 if variant == "one-channel" else 2
    if reference_code:
        labelling = Labelling("mean_absolute", 1.0, relative=True, quiet_rough=False)
        return NetworkSettings(variant, True, channels, labelling, (1.0, 0.05, 0.05))
    fixed, relative = Labelling("rms", 10 ** (LABEL_LEVEL_DBFS / 20)), Labelling("rms", 0.5, relative=True)
    # The paper names no class weights.
    return NetworkSettings(variant, False, channels, relative if variant == "fine-tuned" else fixed, (1.0, 1.0, 1.0))
