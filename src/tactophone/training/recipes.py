"""Every way of telling rough from smooth that is not the paper's network, by name: what it hears, and how it learns."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import onnx

from tactophone.dataset import Dataset
from tactophone.link import Codec
from tactophone.perception import DecisionRule, ModelCard
from tactophone.training.features import baselines as learners
from tactophone.training.features.feature_tracks import FeatureSpec, Kind
from tactophone.training.features.linear_classifier import fit_head
from tactophone.training.features.onnx_graph import build_head_graph
from tactophone.training.features.training_set import TrainingSet, prepare
from tactophone.training.model_export import write_graph
from tactophone.training.provenance import caveats_of, licence_of

PATIENT = DecisionRule(confirm=4, abstain_from=0.5)
"""Ours claims *none* where sound is unknown, and rough must hold for 40 ms: that halves the false bumps of a belief
that is quick to move, and edges are still felt in time (docs/detector.md)."""


@dataclass(frozen=True, slots=True)
class FeatureRecipe:
    """A way of telling rough from smooth.

    Parameters
    ----------
    kind
        What it is shown.
    build
        Learns, and gives the graph of a model file.
    told
        What it is, for tables.
    rule
        Of its decision.
    lone_air
        Whether it hears the air microphone alone, and calmly: see :func:`tactophone.training.features.baselines.build_impulses`.
    """

    kind: Kind
    build: Callable[[TrainingSet], onnx.ModelProto]
    told: str
    rule: DecisionRule = field(default_factory=DecisionRule)
    lone_air: bool = False

    def ear(self, channels: int, codec: Codec | None = None) -> FeatureSpec:
        """Tell how it hears sound of so many channels."""
        if self.lone_air:
            return FeatureSpec(self.kind, 1, codec, alone="air", calm=True)
        return FeatureSpec(self.kind, channels, codec)


def build_ours(lesson: TrainingSet) -> onnx.ModelProto:
    """Fit our own head."""
    return build_head_graph(fit_head(lesson.examples, channels=lesson.ear.channels), channels=lesson.ear.channels)


def _scalogram(lesson: TrainingSet) -> onnx.ModelProto:
    from tactophone.training.features.scalogram import build_scalogram  # torch, for this one alone

    return build_scalogram(lesson)


RECIPES: Mapping[str, FeatureRecipe] = MappingProxyType(
    {
        "ours": FeatureRecipe(
            "texture", build_ours, "short windows, a memory of the touch, a calibrated head", PATIENT
        ),
        "level": FeatureRecipe("cues", learners.build_level, "loudness against a threshold"),
        "rules": FeatureRecipe("cues", learners.build_rules, "five cues vote: level, crest, transients, centroid, air"),
        "median-frequency": FeatureRecipe(
            "cues", learners.build_median_frequency, "half the power on either side of it"
        ),
        "scalogram-cnn": FeatureRecipe(
            "scalogram", _scalogram, "time-frequency picture into a small convolutional network"
        ),
        "surface": FeatureRecipe(
            "texture", learners.build_surface, "spectrum to Ra by ridge regression, then a boundary"
        ),
        "impulses": FeatureRecipe(
            "texture",
            learners.build_impulses,
            "how far one air microphone's sound peaks, and how unsteadily",
            PATIENT,
            lone_air=True,
        ),
        "logistic": FeatureRecipe("texture", learners.build_logistic, "logistic regression on our features"),
        "boosting": FeatureRecipe("texture", learners.build_boosting, "gradient boosted trees on our features"),
    }
)


def train_way(
    path: Path, dataset: Dataset, name: str, *, channels: int = 2, through: Sequence[Codec] = ()
) -> ModelCard:
    """Train one way on labelled recordings and write its model file.

    Parameters
    ----------
    path
        The ONNX file to write.
    dataset
        Usable recordings.
    name
        A key of :data:`RECIPES`.
    channels
        That it hears, if it can hear either.
    through
        Codecs through which each recording is heard once more.
    """
    way = RECIPES[name]
    lesson = prepare(way.ear(channels), dataset.recordings, through=through)
    facts = {
        "recipe": name,
        "dataset": dataset.name,
        "surfaces": len(dataset.surfaces),
        "sha256": dataset.fingerprint,
        "through": ["nothing", *(f"{one.name}, {one.bitrate_bps} bit/s, {one.bandwidth:g} Hz" for one in through)],
    }
    card = lesson.card(name, rule=way.rule, training=facts)
    card = replace(card, scores=caveats_of(dataset), licence=licence_of(dataset))
    write_graph(path, way.build(lesson), card)
    return card
