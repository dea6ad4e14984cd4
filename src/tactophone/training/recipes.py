"""Recipes: every named way to train a detector, and what may be chosen for a training.

`train`, `evaluate`, `benchmark` and the Makefile read :data:`RECIPES`; nothing else lists them. Reading it
imports neither torch nor scikit-learn. A recipe with its options, :class:`ConfiguredRecipe`, can train; a recipe file
(:class:`RecipeFile`) names both.

A new detector on existing features takes two changes:

1. A function from a training set (:class:`~tactophone.training.sets.TrainingSet`) to an ONNX graph, listed in
   ``training/baselines.BUILDERS``. The graph takes ``features``, float32 of shape ``(windows, features)``, NaN where a
   channel is missing, and returns ``log_probabilities`` of none, smooth and rough, shape ``(windows, 3)``;
   ``export.build_linear`` makes that of a linear classifier.
2. One :class:`Recipe` of the same name in :data:`RECIPES` below.

``tests/training/test_recipes.py`` then trains it, runs it live and on one channel. New *features* are an extractor in
``perception/features.py``, registered in ``EXTRACTORS``, with their window in ``training/tracks.py``.

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
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from tactophone.errors import ConfigError, did_you_mean
from tactophone.perception.calibration import Calibration
from tactophone.perception.decision import DecisionRule
from tactophone.perception.features import BAND_COUNT, BAND_VALUES
from tactophone.perception.levels import LoudnessRule
from tactophone.perception.model_file import Gate
from tactophone.perception.texture import MEMORY
from tactophone.types import DEFAULT_TIP, LIVE_SAMPLE_RATE

if TYPE_CHECKING:
    from tactophone.link.codec import Codec
    from tactophone.training.sets import FeatureRecipe
    from tactophone.training.trainer import NetworkRecipe

ConfiguredRecipe: TypeAlias = "FeatureRecipe | NetworkRecipe"
"""A recipe with its options: everything that decides a training but the recordings, and ``train``, which does it."""

FeatureKind = Literal["texture", "cues", "scalogram"]
"""Features that recipes other than the paper's network learn from; also the kind in their model cards."""

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


Offset: TypeAlias = NDArray[np.float64]
"""Added to a description: shape ``(channels, values)``, in log10 of power."""


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
        from tactophone.link.codec import Codec

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
        """Samples of a window."""
        return round(self.window * self.rate)

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
class Augmentation:
    """Random gain and equaliser: training as if each take had been recorded with another microphone, elsewhere.

    What a microphone, its mount and a room do to sound is a gain and a smooth change over frequency; no training set
    holds more than a few of them. So every take is used several times, each time with a gain and an equaliser of its
    own. On real surfaces of a kind that was left out this adds 0.05 of AUC and 0.1 of balanced accuracy
    (docs/research/detector.md); the values are the first that were tried.

    Descriptions are logarithms, so both are an offset, and a constant offset moves the running mean alone: it can be
    applied after the running statistics, exactly, and costs no second pass.
    """

    copies: int = 4
    """Of each take."""
    gain_db: float = 6.0
    """Standard deviation of the gain; microphones and mounts differ by as much."""
    equaliser_db: float = 3.5
    """The same of the equaliser, at each of its knots."""
    knots: int = 5
    """Of the equaliser, evenly spaced over the bands; between them it is linear."""

    def draw(self, rng: np.random.Generator, *, channels: int, values: int = BAND_VALUES) -> Offset:
        """Draw the offset of one copy of a take, each microphone by itself.

        Level moves with the gain and the equaliser's mean, steepness by itself; crest, clicks and unevenness,
        ratios within one waveform, stay.
        """
        gain = rng.normal(0, self.gain_db / 10, (channels, 1))
        heights = rng.normal(0, self.equaliser_db / 10, (channels, self.knots))
        places = np.linspace(0, self.knots - 1, BAND_COUNT)
        curve = np.array([np.interp(places, np.arange(self.knots), row) for row in heights])
        offset = np.zeros((channels, values))
        offset[:, :BAND_COUNT] = gain + curve
        # The four shapes: level, crest, clicks, steepness.
        offset[:, BAND_COUNT] = gain[:, 0] + curve.mean(axis=1)
        offset[:, BAND_VALUES - 1] = rng.normal(0, self.equaliser_db / 10, channels)
        return offset


@dataclass(frozen=True, slots=True)
class Response:
    """How surely and how quickly a detector decides."""

    decision: DecisionRule = field(default_factory=DecisionRule)
    """The decision rule in the model's card."""
    memory: float = MEMORY
    """Of texture features' running statistics, in s."""


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
    change_detection: bool = True
    """Whether the running statistics of texture features restart where the surface changes."""
    augmentation: Augmentation | None = None
    """How takes are varied in training; not at all by default."""
    shipped: bool = False
    """Whether `make model` puts its model into the package."""
    requires: str = ""
    """Property that every training recording must have, such as ``ra_um``."""

    def response_for(self, tip: str) -> Response:
        """Return decision rule and memory of a model of this tip."""
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
            from tactophone.training.trainer import network_recipe

            return network_recipe(self, options, start=start, calibration=calibration)
        from tactophone.training.sets import feature_recipe

        return feature_recipe(self, options)


_CONFIRMED = Response(DecisionRule(rough_on=0.6, rough_off=0.4, confirm=4, abstain_from=0.5), memory=0.25)
"""*None* where sound is unknown, and rough must hold for 40 ms: that halves the false bumps of a prediction that moves
quickly. The hysteresis lies evenly around a half: it ends the false bumps of sound at the boundary, for 0.003 of what
is rendered right on real kinds left out (docs/research/detector.md)."""

_OF_PAD = Response(DecisionRule(rough_on=0.9, rough_off=0.7, confirm=1, abstain_from=0.5), memory=0.12)
"""Under the pad a stroke that turns every 0.2 s takes a smooth surface to 0.7 for moments, as its level swings by
20 dB: so rough begins at 0.9, and then at once, as few smooth windows reach that. A longer memory scores no better
there and reports edges later. Under a stylus, of real kinds left out, such a memory and 0.8 already cost 0.09 of what
is rendered right (docs/research/detector.md)."""

_LISTED = (
    Recipe(
        "paper", "the paper's network and figures: spectral magnitudes of 256 ms into a residual MLP", "magnitudes",
        version=1, shipped=True,
    ),
    Recipe("paper-fast", "the same network, in smaller batches and at least 500 of them", "magnitudes", version=1),
    Recipe(
        "texture", "short windows, running statistics of the touch, a calibrated linear classifier", "texture",
        response=_CONFIRMED, pad_response=_OF_PAD, version=7, augmentation=Augmentation(), shipped=True,
    ),
    Recipe("level", "loudness against a threshold", "cues"),
    Recipe("rules", "five cues vote: level, crest, transients, centroid, air", "cues"),
    Recipe("median-frequency", "frequency with half the power on either side", "cues"),
    Recipe("scalogram-cnn", "log spectrogram into a small convolutional network", "scalogram"),
    Recipe(
        "surface", "texture features to Ra by ridge regression, then a boundary", "texture", version=3, requires="ra_um"
    ),
    Recipe("logistic", "logistic regression on texture features", "texture", version=3),
    Recipe("boosting", "gradient boosted trees on texture features", "texture", version=3),
)  # fmt: skip

RECIPES: Mapping[str, Recipe] = MappingProxyType({recipe.name: recipe for recipe in _LISTED})
"""Every recipe by name."""

FEATURE_RECIPES = tuple(name for name, recipe in RECIPES.items() if recipe.features != "magnitudes")
"""Names of the recipes that learn from features: all but the paper's network."""

SHIPPED = tuple(name for name, recipe in RECIPES.items() if recipe.shipped)
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
