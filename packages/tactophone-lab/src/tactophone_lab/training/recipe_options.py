"""What may be chosen for a training, and what a recipe is: values alone, which import
neither torch nor scikit-learn.

The paper's three models are values here, each as the paper describes it and as its
authors' reference code has it; docs/guide/training.md lists where the two differ and
what this package does otherwise.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
from msgspec import Meta

from tactophone.core.texture_bands import BAND_COUNT
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.levels import LoudnessRule
from tactophone.signal.perception.model_file import Gate
from tactophone_lab.training.augmentation import Augmentation

if TYPE_CHECKING:
    from tactophone.net.link.codec import Codec

FeatureKind = Literal["texture", "cues"]
"""Features that recipes other than the paper's network learn from; also the kind in
their model cards."""

SHAPES = 4
"""Shapes of the waveform, which follow the bands."""

BAND_VALUES = BAND_COUNT + SHAPES
"""All values that describe one channel of a window."""

CREST_INDEX = BAND_COUNT + 1
"""Index of the crest among these values; clicks follow it."""

CUES = (
    "level_db",
    "crest_db",
    "transients_db",
    "centroid_octaves",
    "median_octaves",
    "air_to_contact_db",
)
"""The values of kind ``cues``, in order; octaves are over 1 Hz."""

MEMORY = 0.1
"""Seconds after which the weight of a window in the running statistics has fallen to
1/e, where a recipe says nothing else."""

Microphone = Literal["contact", "air"]
Variant = Literal["general", "fine-tuned", "one-channel"]
Precision = Literal["float32", "bfloat16"]

VARIANTS: tuple[Variant, ...] = ("general", "fine-tuned", "one-channel")

NETWORK_RATE = 2000
"""Sample rate of the paper's network in Hz."""

NETWORK_WINDOW_SIZE = 512
"""Samples in a window of the paper's network: 256 ms at 2 kHz."""

NETWORK_HOP = Fraction(512 * NETWORK_RATE, LIVE_SAMPLE_RATE)
"""Samples from one prediction to the next: the paper predicts at every sound buffer,
512 samples at 48 kHz."""

LABEL_LEVEL_DBFS = -26.0
"""RMS over which the paper's general model takes a window for contact: slightly over
its piezo's noise floor."""

REFERENCE_GATE = Gate(-46.02, "mean_absolute")
"""0.005, over which the authors' code takes a window for contact when it scores."""

OPEN_GATE = Gate(-200.0)
"""Every window counts as contact: for recordings that hold nothing else, whatever their
level."""


Report = Callable[[int, int | None, str], None]
"""Progress of a training: steps done, steps in all if known, a note."""


class TrainingOptions(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True
):
    """What a user may choose for a training, by the names of `train`'s options; each
    recipe reads those that it has."""

    channels: Annotated[int, Meta(ge=1, le=2)] = 2
    """Microphones that the model uses; the paper's network takes them from its
    variant."""
    seed: Annotated[int, Meta(ge=0)] = 0
    """Of everything random."""
    opus_bitrate: Annotated[int, Meta(ge=16, le=512)] | None = None
    """Bitrate in kbit/s of the link's Opus that the sound passes through first;
    ``None`` for no codec."""
    microphone: Microphone = "contact"
    """The microphone that a model of one channel uses, where its recipe does not
    say."""
    tip: str = ""
    """Tip the model is trained for; empty means the tip named by the recordings, if
    they all name the same one."""
    contact_threshold: Annotated[float, Meta(ge=-200, le=0)] | Literal["off"] | None = (
        None
    )
    """Of the model's contact gate, in dBFS RMS; ``off``: every window is trained on and
    classified."""
    variant: Variant = "general"
    reference_code: bool = False
    precision: Precision = "float32"
    epochs: Annotated[int, Meta(ge=1)] | None = None
    least_steps: Annotated[int, Meta(ge=0)] | None = None
    batch_size: Annotated[int, Meta(ge=1)] | None = None
    hop: Annotated[int, Meta(ge=1)] | None = None
    learning_rate: Annotated[float, Meta(gt=0)] | None = None
    noise: Annotated[float, Meta(ge=0)] | None = None
    """The options from `variant` on apply only to the paper's network; unset ones keep
    the recipe's value."""

    def codec(self, channels: int, *, bandwidth: float = 0.0) -> "Codec | None":
        """Return the codec of the options: packets of 10 ms, a bandwidth in Hz (by
        default the codec's narrowest)."""
        from tactophone.net.link.codec import Codec

        if self.opus_bitrate is None:
            return None
        codec = Codec(
            "opus",
            channels=channels,
            packet_size=480,
            bitrate_bps=1000 * self.opus_bitrate,
        )
        return replace(codec, bandwidth=bandwidth) if bandwidth else codec


@dataclass(frozen=True, slots=True)
class Labelling:
    """Which windows count as contact, and so take their recording's label; the others
    are *none*."""

    loudness: LoudnessRule
    """``"rms"``, or ``"mean_absolute"``; of the window's first channel."""
    threshold: float
    """Least loudness: of full scale, or of the mean loudness of all windows with that
    label if ``relative``."""
    relative: bool = False
    """See ``threshold``."""
    quiet_rough: bool = True
    """Whether quiet windows of rough recordings are trained as *none* too; if not, they
    are left out."""


@dataclass(frozen=True, slots=True)
class NetworkSettings:
    """Everything that decides a training run of the paper's network but the recordings
    and the seed.

    The defaults are the paper's. ``hop`` is in samples at 2 kHz: a window for every
    sound buffer, 10.7 ms; the authors' code takes every window (1). ``noise`` is the
    standard deviation of the Gaussian noise added to each window. Epochs repeat until
    there were ``least_steps`` batches, see :data:`FAST_CHANGES`.
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
        """Return the settings with contact from an RMS level in dBFS; unchanged where
        the threshold is relative."""
        if self.labelling.relative:
            return self
        labelling = replace(
            self.labelling, loudness="rms", threshold=10 ** (level_dbfs / 20)
        )
        return replace(self, labelling=labelling)


FAST_CHANGES: Mapping[str, int] = MappingProxyType(
    {"batch_size": 1000, "least_steps": 500}
)
"""What the recipe ``paper-fast`` changes: smaller batches reach an equal score for a
fifth of the processor time (`git show 7e771cb:benchmarks/training.py`), and five epochs
of a few minutes of sound are too few to converge."""


def network_settings(
    variant: Variant, *, reference_code: bool = False
) -> NetworkSettings:
    """Return the settings of one of the paper's models; change parts with
    ``dataclasses.replace``.

    With ``reference_code`` they follow the authors' code where it differs from the
    paper's text.

    >>> network_settings("general").epochs
    5
    >>> network_settings("general", reference_code=True).class_weights
    (1.0, 0.05, 0.05)
    """
    channels = 1 if variant == "one-channel" else 2
    if reference_code:
        labelling = Labelling("mean_absolute", 1.0, relative=True, quiet_rough=False)
        return NetworkSettings(variant, True, channels, labelling, (1.0, 0.05, 0.05))
    if variant == "fine-tuned":
        labelling = Labelling("rms", 0.5, relative=True)
    else:
        labelling = Labelling("rms", 10 ** (LABEL_LEVEL_DBFS / 20))
    # The paper names no class weights.
    return NetworkSettings(variant, False, channels, labelling, (1.0, 1.0, 1.0))


@dataclass(frozen=True, slots=True)
class Response:
    """How surely and how quickly a detector decides."""

    decision: DecisionRule = field(default_factory=DecisionRule)
    """The decision rule in the model's card."""
    memory: float = MEMORY
    """Of texture features' running statistics, in s."""
    change_detection: bool = True
    """Whether these restart where the surface changes."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """A named way to train a detector."""

    name: str
    """As `train --recipe` takes it."""
    description: str
    """For tables."""
    features: FeatureKind | Literal["magnitudes"]
    """What it learns from: a :data:`FeatureKind`, or ``"magnitudes"`` for the paper's
    network."""
    response: Response = field(default_factory=Response)
    """Decision rule and memory of its models."""
    pad_response: Response | None = None
    """The same for models of the pad; by default as of others."""
    version: int = 2
    """Version of its results: raise it when they change in a way that neither name nor
    options show, so that cached folds are computed anew."""
    microphone: Microphone | None = None
    """Where not ``None``, the recipe always uses one channel, this one."""
    augmentation: Augmentation | None = None
    """How takes are varied in training; not at all by default."""
    shipped: bool = False
    """Whether `make model` puts its model into the package."""

    def response_for(self, tip: str) -> Response:
        return (
            self.pad_response
            if self.pad_response and tip == DEFAULT_TIP
            else self.response
        )


FEATURE_RATE = 16_000
"""Sample rate in Hz that all of these features are computed at."""

WINDOWS: dict[FeatureKind, tuple[int, Fraction]] = {
    "texture": (512, Fraction(160)),
    "cues": (4096, Fraction(512, 3)),
}
"""Window and hop in samples: 32 ms a hundred times a second, or the paper's 256 ms at
every sound buffer."""

_TEXTURE_HOP = float(WINDOWS["texture"][1] / FEATURE_RATE)

MIN_VARIANCE = 1e-4
"""Keeps the root of a variance from being NaN after rounding; negligible beside any
real variance."""

SILENT_POWER = 1e-14
"""Mean square, -140 dBFS, under which a channel carries no signal: even a good
microphone's noise is far over it."""


@dataclass(frozen=True, slots=True)
class FeatureSpec:
    """Which features are extracted, from what sound."""

    kind: FeatureKind = "texture"
    channels: int = 2
    codec: "Codec | None" = None
    """Codec that the sound passes through first."""
    microphone: Microphone = "contact"
    """The microphone used where ``channels`` is 1; the file's first, if it has none of
    that name."""
    change_detection: bool = True
    """Whether the running statistics restart where the surface changes."""
    memory: float = MEMORY
    """Of the running statistics, in s."""
    unevenness: bool = False
    """Whether texture features hold the unevenness of the treble: for hard tips."""
    augmentation: Augmentation | None = None
    copy: tuple[int, int] = (0, 0)
    """`augmentation` and `copy`: how takes are varied; seed and number of the copy.
    Number 0 is the take itself."""

    @property
    def fading(self) -> float:
        """The memory in windows.

        >>> FeatureSpec(memory=0.25).fading
        25.0
        """
        return self.memory / _TEXTURE_HOP

    @property
    def values(self) -> int:
        """Values that describe one channel of a window in texture features."""
        return BAND_VALUES + self.unevenness
