"""The registry of recipes: every named way to train a detector.

`train`, `sweep`, `evaluate`, `benchmark` and the Makefile read :data:`RECIPES`; nothing else lists them. Reading it
imports neither torch nor scikit-learn: the function that fits a classifier is named by its dotted path.

A new detector on existing features takes two files:

1. ``training/features/<name>.py``, with a function from a training set
   (:class:`~tactophone.training.features.training_set.TrainingSet`) to an ONNX graph. The graph takes ``features``,
   float32 of shape ``(windows, features)``, NaN where a channel is missing, and returns ``log_probabilities`` of none,
   smooth and rough, shape ``(windows, 3)``; ``features/onnx_graph.build_linear`` makes that of a linear classifier.
2. One :class:`Recipe` in :data:`RECIPES` below that names the function.

``tests/training/test_recipes.py`` then trains it, runs it live and on one channel. New *features* are an extractor in
``perception/features.py``, registered in ``EXTRACTORS``, with their window in ``training/features/feature_tracks.py``.
"""

import importlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

from tactophone.perception import MEMORY, Calibration, DecisionRule, Gate
from tactophone.training.features.augmentation import Augmentation
from tactophone.training.network.settings import Precision, Variant
from tactophone.types import DEFAULT_TIP

if TYPE_CHECKING:
    from tactophone.dataset import Dataset
    from tactophone.link import Codec

FeatureKind = Literal["texture", "cues", "scalogram"]
"""Features that recipes other than the paper's network learn from; also the kind in their model cards."""

Microphone = Literal["contact", "air"]

Report = Callable[[int, int | None, str], None]
"""Progress of a training: steps done, steps in all if known, a note."""


def silent(*progress: object) -> None:
    """Report nothing."""


@dataclass(frozen=True, slots=True)
class TrainingOptions:
    """What a user may choose for a training; each recipe reads the options that it has."""

    channels: int = 2
    """Microphones that the model uses, 1 or 2; the paper's network takes them from its variant."""
    seed: int = 0
    """Of everything random."""
    opus_bitrate_bps: int | None = None
    """Bitrate of the link's Opus that the sound passes through first; ``None`` for no codec."""
    microphone: Microphone = "contact"
    """The microphone that a model of one channel uses, where its recipe does not say."""
    tip: str = ""
    """The tip that the model is for; empty: that of the recordings, if they all name the same."""
    start: Path | None = None
    gate: Gate | None = None
    calibration: Calibration | None = None
    """`start`, `gate` and `calibration`: model file to continue from, contact gate of the model, and calibration that
    replaces the gate."""
    variant: Variant = "general"
    reference_code: bool = False
    precision: Precision = "float32"
    """`variant`, `reference_code` and `precision`: see
    :class:`tactophone.training.network.settings.NetworkSettings`."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Other fields of those settings, by name."""

    def codec(self, channels: int, *, bandwidth: float = 0.0) -> "Codec | None":
        """Return the codec of the options: packets of 10 ms, a bandwidth in Hz (by default the codec's narrowest)."""
        from tactophone.link import Codec

        if self.opus_bitrate_bps is None:
            return None
        codec = Codec("opus", channels=channels, packet_size=480, bitrate_bps=self.opus_bitrate_bps)
        return replace(codec, bandwidth=bandwidth) if bandwidth else codec


class Job(Protocol):
    """A recipe with its options: everything that decides a training but the recordings."""

    @property
    def name(self) -> str:
        """For tables."""

    @property
    def channels(self) -> int:
        """Microphones that the model uses."""

    @property
    def identity(self) -> str:
        """Text that changes whenever the result may: key of cached results."""

    def train(
        self,
        path: Path,
        dataset: "Dataset",
        *,
        checkpoint: Path | None = None,
        report: Report = silent,
        log: Callable[[str], None] = silent,
    ) -> bool:
        """Train on labelled recordings and write the model file.

        ``checkpoint`` keeps unfinished state, so that a killed training can continue; recipes of seconds keep none.

        Returns whether this process wrote the file: under ``torchrun`` only one does.
        """


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
    fit: str = ""
    """Dotted path ``module:function`` from a training set to the graph of a model file; empty where ``job`` trains."""
    job: str = "tactophone.training.features.job:feature_job"
    """Dotted path of the function that makes its :class:`Job` from the recipe and :class:`TrainingOptions`."""
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

    def open_job(self, options: TrainingOptions | None = None) -> Job:
        """Return the training job of this recipe; imports what it needs."""
        return cast(Job, load(self.job)(self, options or TrainingOptions()))


def load(path: str) -> Callable[..., Any]:
    """Import a function by its dotted path.

    >>> load("math:hypot")(3, 4)
    5.0
    """
    module, _, name = path.partition(":")
    return cast(Callable[..., Any], getattr(importlib.import_module(module), name))


_CONFIRMED = Response(DecisionRule(rough_on=0.6, rough_off=0.4, confirm=4, abstain_from=0.5), memory=0.25)
"""*None* where sound is unknown, and rough must hold for 40 ms: that halves the false bumps of a prediction that moves
quickly. The hysteresis lies evenly around a half: it ends the false bumps of sound at the boundary, for 0.003 of what
is rendered right on real kinds left out (docs/research/detector.md)."""

_OF_PAD = Response(DecisionRule(rough_on=0.9, rough_off=0.7, confirm=1, abstain_from=0.5), memory=0.12)
"""Under the pad a stroke that turns every 0.2 s takes a smooth surface to 0.7 for moments, as its level swings by
20 dB: so rough begins at 0.9, and then at once, as few smooth windows reach that. A longer memory scores no better
there and reports edges later. Under a stylus, of real kinds left out, such a memory and 0.8 already cost 0.09 of what
is rendered right (docs/research/detector.md)."""

_BASELINES = "tactophone.training.features.baselines"

_LISTED = (
    Recipe(
        "paper", "the paper's network and figures: spectral magnitudes of 256 ms into a residual MLP", "magnitudes",
        job="tactophone.training.network.job:network_job", version=1, shipped=True,
    ),
    Recipe(
        "paper-fast", "the same network, in smaller batches and at least 500 of them", "magnitudes",
        job="tactophone.training.network.job:network_job", version=1,
    ),
    Recipe(
        "texture", "short windows, running statistics of the touch, a calibrated linear classifier", "texture",
        "tactophone.training.features.linear_classifier:build_texture", response=_CONFIRMED,
        pad_response=_OF_PAD, version=7, augmentation=Augmentation(), shipped=True,
    ),
    Recipe("level", "loudness against a threshold", "cues", f"{_BASELINES}:build_level"),
    Recipe("rules", "five cues vote: level, crest, transients, centroid, air", "cues", f"{_BASELINES}:build_rules"),
    Recipe(
        "median-frequency", "frequency with half the power on either side", "cues",
        f"{_BASELINES}:build_median_frequency",
    ),
    Recipe(
        "scalogram-cnn", "log spectrogram into a small convolutional network", "scalogram",
        "tactophone.training.features.scalogram:build_scalogram",
    ),
    Recipe(
        "surface", "texture features to Ra by ridge regression, then a boundary", "texture",
        f"{_BASELINES}:build_surface", version=3, requires="ra_um",
    ),
    Recipe(
        "logistic", "logistic regression on texture features", "texture", f"{_BASELINES}:build_logistic", version=3
    ),
    Recipe(
        "boosting", "gradient boosted trees on texture features", "texture", f"{_BASELINES}:build_boosting", version=3
    ),
)  # fmt: skip

RECIPES: Mapping[str, Recipe] = MappingProxyType({recipe.name: recipe for recipe in _LISTED})
"""Every recipe by name."""

FEATURE_RECIPES = tuple(name for name, recipe in RECIPES.items() if recipe.features != "magnitudes")
"""Names of the recipes that learn from features: all but the paper's network."""

SHIPPED = tuple(name for name, recipe in RECIPES.items() if recipe.shipped)
"""Names of the recipes whose models ship inside the package; of ``paper``, its one-channel variant ships besides."""
