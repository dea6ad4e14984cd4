"""Recipes: every named way to train a detector, and what may be chosen for a training.

`train`, `evaluate`, `benchmark` and the Makefile read :data:`RECIPES`; nothing else lists them. Reading it
imports neither torch nor scikit-learn. A recipe with its options, :class:`ConfiguredRecipe`, can train; a recipe file
(:class:`RecipeFile`) names both.

A new detector on existing features takes two changes:

1. A function from a training set (:class:`~tactophone.lab.training.sets.TrainingSet`) to an ONNX graph, listed in
   ``training/baselines.BUILDERS``. The graph takes ``features``, float32 of shape ``(windows, features)``, NaN where a
   channel is missing, and returns ``log_probabilities`` of none, smooth and rough, shape ``(windows, 3)``;
   ``export.build_linear`` makes that of a linear classifier.
2. One :class:`Recipe` of the same name in :data:`RECIPES` below.

``tests/lab/training/test_recipes.py`` then trains it, runs it live and on one channel. New *features* are
a torch module in ``features.py`` there, with their window in ``tracks.py``; live code needs no change.

The paper's three models are values here, each as the paper describes it and as its authors' reference code has it;
docs/guide/training.md lists where the two differ and what this package does otherwise.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.types import DEFAULT_TIP, LIVE_SAMPLE_RATE
from tactophone.lab.training.augmentation import Augmentation
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.levels import LoudnessRule
from tactophone.signal.perception.model_file import Gate

if TYPE_CHECKING:
    from tactophone.lab.training.sets import FeatureRecipe
    from tactophone.lab.training.trainer import NetworkRecipe
    from tactophone.net.link.codec import Codec

ConfiguredRecipe: TypeAlias = "FeatureRecipe | NetworkRecipe"
"""A recipe with its options: everything that decides a training but the recordings, and ``train``, which does it."""

FeatureKind = Literal["texture", "cues"]
"""Features that recipes other than the paper's network learn from; also the kind in their model cards."""

BAND_COUNT, SHAPES = 16, 4
BAND_VALUES = BAND_COUNT + SHAPES
CREST_INDEX = BAND_COUNT + 1
"""Bands and shapes of the waveform among the values that describe one channel of a window in texture features, their
sum, and the index of the crest among them; clicks follow it. `tactophone.lab.training.features` computes them."""

CUES = ("level_db", "crest_db", "transients_db", "centroid_octaves", "median_octaves", "air_to_contact_db")
"""The values of kind ``cues``, in order; octaves are over 1 Hz."""

MEMORY = 0.1
"""Seconds after which the weight of a window in the running statistics has fallen to 1/e, where a recipe says nothing
else."""

Microphone = Literal["contact", "air"]
Variant = Literal["general", "fine-tuned", "one-channel"]
Precision = Literal["float32", "bfloat16"]

VARIANTS: tuple[Variant, ...] = ("general", "fine-tuned", "one-channel")

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


Report = Callable[[int, int | None, str], None]
"""Progress of a training: steps done, steps in all if known, a note."""


def silent(*progress: object) -> None:
    """Report nothing."""


class TrainingOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a user may choose for a training, by the names of `train`'s options; each recipe reads those that it has."""

    channels: Annotated[int, Meta(ge=1, le=2)] = 2
    """Microphones that the model uses; the paper's network takes them from its variant."""
    seed: Annotated[int, Meta(ge=0)] = 0
    """Of everything random."""
    opus_bitrate: Annotated[int, Meta(ge=16, le=512)] | None = None
    """Bitrate in kbit/s of the link's Opus that the sound passes through first; ``None`` for no codec."""
    microphone: Microphone = "contact"
    """The microphone that a model of one channel uses, where its recipe does not say."""
    tip: str = ""
    """The tip that the model is for; empty: that of the recordings, if they all name the same."""
    contact_threshold: Annotated[float, Meta(ge=-200, le=0)] | Literal["off"] | None = None
    """Of the model's contact gate, in dBFS RMS; ``off``: every window is trained on and classified."""
    variant: Variant = "general"
    reference_code: bool = False
    precision: Precision = "float32"
    epochs: Annotated[int, Meta(ge=1)] | None = None
    least_steps: Annotated[int, Meta(ge=0)] | None = None
    batch_size: Annotated[int, Meta(ge=1)] | None = None
    hop: Annotated[int, Meta(ge=1)] | None = None
    learning_rate: Annotated[float, Meta(gt=0)] | None = None
    noise: Annotated[float, Meta(ge=0)] | None = None
    rate: Annotated[int, Meta(ge=2000, le=16_000)] | None = None
    window: Annotated[float, Meta(ge=0.02, le=2)] | None = None
    residual: bool | None = None
    normalised: bool | None = None
    """From `variant` on, of the paper's network: see :class:`NetworkSettings`; by default as the recipe has them."""

    def codec(self, channels: int, *, bandwidth: float = 0.0) -> "Codec | None":
        """Return the codec of the options: packets of 10 ms, a bandwidth in Hz (by default the codec's narrowest)."""
        from tactophone.net.link.codec import Codec

        if self.opus_bitrate is None:
            return None
        codec = Codec("opus", channels=channels, packet_size=480, bitrate_bps=1000 * self.opus_bitrate)
        return replace(codec, bandwidth=bandwidth) if bandwidth else codec


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
    rate: int = NETWORK_RATE
    window: float = NETWORK_WINDOW_SIZE / NETWORK_RATE
    """In s."""
    residual: bool = True
    normalised: bool = False
    """From `rate` on, ablations: whether layers have residual connections, and whether each channel's magnitudes are
    divided by their norm."""

    @property
    def name(self) -> str:
        """For model cards and tables.

        >>> network_settings("one-channel").name
        'paper/one-channel'
        """
        return ", ".join((f"{'authors' if self.reference_code else 'paper'}/{self.variant}", *self.ablations))

    @property
    def ablations(self) -> tuple[str, ...]:
        """What differs from the paper's network in a way that no model file holds."""
        found = (
            (f"{self.rate / 1000:g} kHz", self.rate != NETWORK_RATE),
            (f"windows of {1000 * self.window:g} ms", self.window != NETWORK_WINDOW_SIZE / NETWORK_RATE),
            ("no residual connections", not self.residual),
            ("normalised input", self.normalised),
        )
        return tuple(name for name, differs in found if differs)

    @property
    def window_size(self) -> int:
        return round(self.window * self.rate)

    def with_threshold(self, level_dbfs: float) -> "NetworkSettings":
        """Return the settings with contact from an RMS level in dBFS; unchanged where the threshold is relative."""
        if self.labelling.relative:
            return self
        labelling = replace(self.labelling, loudness="rms", threshold=10 ** (level_dbfs / 20))
        return replace(self, labelling=labelling)


FAST_CHANGES: Mapping[str, int] = MappingProxyType({"batch_size": 1000, "least_steps": 500})
"""What the recipe ``paper-fast`` changes: smaller batches reach an equal score for a fifth of the processor time
(`git show 7e771cb:benchmarks/training.py`), and five epochs of a few minutes of sound are too few to converge."""


def network_settings(variant: Variant, *, reference_code: bool = False) -> NetworkSettings:
    """Return the settings of one of the paper's models; change parts with ``dataclasses.replace``.

    With ``reference_code`` they follow the authors' code where it differs from the paper's text.

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
    """What it learns from: a :data:`FeatureKind`, or ``"magnitudes"`` for the paper's network."""
    response: Response = field(default_factory=Response)
    """Decision rule and memory of its models."""
    pad_response: Response | None = None
    """The same for models of the pad; by default as of others."""
    version: int = 2
    """Version of its results: raise it when they change in a way that neither name nor options show, so that cached
    folds are computed anew."""
    microphone: Microphone | None = None
    """Where not ``None``, the recipe always uses one channel, this one."""
    augmentation: Augmentation | None = None
    """How takes are varied in training; not at all by default."""
    shipped: bool = False
    """Whether `make model` puts its model into the package."""
    requires: str = ""
    """Property that every training recording must have, such as ``ra_um``."""

    def response_for(self, tip: str) -> Response:
        return self.pad_response if self.pad_response and tip == DEFAULT_TIP else self.response

    def with_options(
        self,
        options: TrainingOptions | None = None,
        *,
        start: Path | None = None,
        calibration: Calibration | None = None,
    ) -> ConfiguredRecipe:
        """Return the recipe with its options, ready to train; imports what it needs.

        ``start`` is a model file to continue from, and ``calibration`` replaces the contact threshold; both for the
        paper's network alone.
        """
        options = options or TrainingOptions()
        if self.features == "magnitudes":
            from tactophone.lab.training.trainer import network_recipe

            return network_recipe(self, options, start=start, calibration=calibration)
        from tactophone.lab.training.sets import feature_recipe

        return feature_recipe(self, options)


_CONFIRMED = Response(
    DecisionRule(rough_on=0.6, rough_off=0.4, confirm=4, abstain_from=0.5), memory=0.25, change_detection=False
)
"""*None* where sound is unknown, and rough must hold for 40 ms: that halves the false bumps of a prediction that moves
quickly. Statistics that restart cost 0.02 of accuracy on real kinds left out. The hysteresis lies evenly around a half:
it ends the false bumps of sound at the boundary, for 0.003 of what is rendered right there
(docs/research/detector.md)."""

_OF_PAD = Response(DecisionRule(rough_on=0.8, rough_off=0.5, confirm=3, abstain_from=0.5), memory=0.12)
"""Under the pad a stroke that turns every 0.2 s moves the probability, as its level swings by 20 dB: so rough begins at
0.8, held for 30 ms, as few smooth windows do. A longer memory scores no better there and reports edges
later. Under a stylus, of real kinds left out, such a memory and 0.8 already cost 0.09 of what
is rendered right (docs/research/detector.md)."""

_LISTED = (
    Recipe(
        "paper", "the paper's network and figures: spectral magnitudes of 256 ms into a residual MLP", "magnitudes",
        version=1, shipped=True,
    ),
    Recipe("paper-fast", "the same network, in smaller batches and at least 500 of them", "magnitudes", version=1),
    Recipe(
        "texture", "short windows, running statistics of the touch, a calibrated linear classifier", "texture",
        response=_CONFIRMED, pad_response=_OF_PAD, version=10, augmentation=Augmentation(),
        shipped=True,
    ),
    Recipe("level", "loudness against a threshold", "cues"),
    Recipe("rules", "five cues vote: level, crest, transients, centroid, air", "cues"),
    Recipe("median-frequency", "frequency with half the power on either side", "cues"),
    Recipe(
        "surface", "texture features to Ra by ridge regression, then a boundary", "texture", version=3, requires="ra_um"
    ),
    Recipe("logistic", "logistic regression on texture features", "texture", version=3),
)  # fmt: skip

RECIPES: Mapping[str, Recipe] = MappingProxyType({recipe.name: recipe for recipe in _LISTED})
"""Every recipe by name."""

FEATURE_RECIPES = tuple(name for name, recipe in RECIPES.items() if recipe.features != "magnitudes")
"""Names of the recipes that learn from features: all but the paper's network."""

SHIPPED_RECIPES = tuple(name for name, recipe in RECIPES.items() if recipe.shipped)
"""Names of the recipes whose models ship inside the package; of ``paper``, its one-channel variant ships besides."""


class RecipeFile(TrainingOptions, frozen=True, kw_only=True):
    """What a recipe file may hold: the name of a recipe, and the options that differ from its defaults."""

    recipe: str = "paper-fast"

    @classmethod
    def read(cls, path: Path) -> "RecipeFile":
        """Read a TOML file; raises `ConfigError` as `changed` does, or if it cannot be read."""
        try:
            entries = msgspec.toml.decode(path.read_bytes())
        except (OSError, UnicodeError, msgspec.DecodeError) as error:
            raise ConfigError(f"{path}: {error}; {cls._help()}") from None
        return cls().changed(entries, where=str(path))

    def changed(self, entries: Mapping[str, Any], *, where: str) -> "RecipeFile":
        """Return the recipe with other entries; a number or a switch may be given as text.

        Raises `ConfigError`, which begins with ``where``, for an unknown recipe or key, or a value out of range.
        """
        try:
            changed = msgspec.convert({**msgspec.structs.asdict(self), **entries}, RecipeFile, strict=False)
        except msgspec.ValidationError as error:
            hints = (did_you_mean(name, self.__struct_fields__) for name in entries if not hasattr(self, name))
            raise ConfigError(f"{where}: {error}{next(hints, '')}; {self._help()}") from None
        if changed.recipe not in RECIPES:
            hint = did_you_mean(changed.recipe, RECIPES)
            raise ConfigError(f"{where}: no recipe {changed.recipe}; there are {', '.join(RECIPES)}{hint}")
        return changed

    @classmethod
    def _help(cls) -> str:
        return f"a recipe file is TOML and may hold {', '.join(cls.__struct_fields__)}"

    def configured(self, *, start: Path | None = None, calibration: Calibration | None = None) -> ConfiguredRecipe:
        """Return the recipe, which can train; ``start`` and ``calibration`` as in :meth:`Recipe.with_options`."""
        return RECIPES[self.recipe].with_options(self, start=start, calibration=calibration)
