"""The classifiers of the recipes on features by name, and the baselines: hand-made
rules.

The only place where level and median frequency are turned into detectors; their values
come from :mod:`tactophone_lab.training.features`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import cast

import numpy as np
import onnx
from onnx import helper

from tactophone.core.recordings.values import Dataset, Recording, tip_of
from tactophone.core.types import ignore
from tactophone.net.link.codec import Codec
from tactophone.signal.perception.model_file import Gate, ModelCard
from tactophone_lab.training.linear import build_texture
from tactophone_lab.training.onnx_export import (
    build_known,
    build_linear,
    caveats_of,
    fill_missing,
    is_simulation,
    licence_of,
    write_graph,
)
from tactophone_lab.training.recipe_options import (
    CUES,
    FEATURE_RATE,
    WINDOWS,
    FeatureKind,
    FeatureSpec,
    Recipe,
    Report,
    TrainingOptions,
)
from tactophone_lab.training.sets import HARD_TIPS, TrainingSet, build_training_set

RULE_FEATURES = (
    "level_db",
    "crest_db",
    "transients_db",
    "centroid_octaves",
    "air_to_contact_db",
)
"""Cues that vote; the median frequency is a recipe of its own."""

VOTE_STEEPNESS = 8.0
"""A cue's vote is a step, softened over an eighth of the distance between its class
medians."""


def build_rules(training_set: TrainingSet) -> onnx.ModelProto:
    """Let each cue vote for the class whose median is nearer; the majority wins."""
    examples = training_set.examples
    columns = [
        CUES.index(name)
        for name in RULE_FEATURES
        if np.isfinite(examples.features[:, CUES.index(name)]).all()
    ]
    smooth, rough = (
        np.median(examples.features[examples.rough == label], axis=0)
        for label in (False, True)
    )
    gap = np.where(np.abs(rough - smooth) < 1e-3, 1e-3, rough - smooth)
    slopes = np.zeros(len(CUES))
    slopes[columns] = VOTE_STEEPNESS / gap[columns]
    nodes = [
        *fill_missing("centre"),
        helper.make_node("Sub", ["whole", "centre"], ["off"]),
        helper.make_node("Mul", ["off", "slopes"], ["steep"]),
        helper.make_node("Tanh", ["steep"], ["votes"]),
        helper.make_node("ReduceSum", ["votes", "one"], ["logit"], keepdims=1),
    ]
    tensors = {"centre": np.nan_to_num((rough + smooth) / 2), "slopes": slopes}
    return build_known(nodes, tensors, features=len(CUES))


def _single_cue(training_set: TrainingSet, *, cue: str) -> onnx.ModelProto:
    """Fit a threshold of one cue between smooth and rough."""
    from sklearn.linear_model import LogisticRegression

    column = CUES.index(cue)
    examples = training_set.examples.thinned()
    model = LogisticRegression().fit(
        examples.features[:, [column]], examples.rough, sample_weight=examples.weights()
    )
    weights = np.zeros(len(CUES))
    weights[column] = model.coef_[0, 0]
    return build_linear(np.zeros(len(CUES)), weights, float(model.intercept_[0]))


BUILDERS: Mapping[str, Callable[[TrainingSet], onnx.ModelProto]] = MappingProxyType(
    {
        "texture": build_texture,
        "level": partial(_single_cue, cue="level_db"),
        "rules": build_rules,
        # It drives the stimulus in Svensson et al. 2021.
        "median-frequency": partial(_single_cue, cue="median_octaves"),
    }
)
"""What fits the classifier of each recipe on features and returns the graph of a model
file, by the recipe's name."""


@dataclass(frozen=True, slots=True)
class FeatureRecipe:
    """A recipe on features with its options; see
    :class:`~tactophone_lab.training.recipes.ConfiguredRecipe`."""

    recipe: Recipe
    spec: FeatureSpec
    """Which features of which channels; the recipe sets the memory for the tip."""
    codecs: tuple[Codec, ...] = ()
    """A model file is trained on each recording as it is and once more through each of
    these codecs."""
    seed: int = 0
    """Of the augmentation."""
    tip: str = ""
    """Tip the model is trained for; empty means the tip named by the recordings."""

    @property
    def name(self) -> str:
        return self.recipe.name

    @property
    def channels(self) -> int:
        return self.spec.channels

    @property
    def evaluated_spec(self) -> FeatureSpec:
        """Features for a cross-validation: through the widest of the codecs, if there
        are any."""
        return replace(self.spec, codec=self.codecs[-1]) if self.codecs else self.spec

    @property
    def identity(self) -> str:
        """Text that changes whenever the result may: key of cached results."""
        return (
            f"{self.name} {self.recipe.version} {self.seed} {self.tip} "
            f"{self.evaluated_spec!r}"
        )

    def training_set(
        self, recordings: Sequence[Recording], *, codecs: Sequence[Codec] | None = None
    ) -> TrainingSet:
        """Return what the recipe is trained with: for a cross-validation by default,
        for a model file with codecs."""
        spec = self.evaluated_spec if codecs is None else self.spec
        tip = self.tip or tip_of(recordings)
        response = self.recipe.response_for(tip)
        return build_training_set(
            replace(
                spec,
                memory=response.memory,
                change_detection=response.change_detection,
                unevenness=spec.kind == "texture" and tip in HARD_TIPS,
            ),
            recordings,
            codecs=codecs or (),
            augmentation=self.recipe.augmentation,
            seed=self.seed,
            tip=tip,
        )

    def build(self, training_set: TrainingSet) -> onnx.ModelProto:
        return BUILDERS[self.name](training_set)

    def train(
        self, path: Path, dataset: Dataset, *, report: Report = ignore, **_: object
    ) -> None:
        """Train on a data set and write the model file, named after the file; it has no
        checkpoints and no log."""
        report(0, None, self.name)
        training_set = self.training_set(dataset.recordings, codecs=self.codecs)
        graph = training_set.whole(self.build(training_set))
        write_graph(path, graph, self.card(path.stem, dataset, training_set))

    def card(self, name: str, dataset: Dataset, training_set: TrainingSet) -> ModelCard:
        """Return the card of a model of this name that was trained on a data set."""
        through = [
            f"{codec.name}, {codec.bitrate_bps} bit/s, {codec.bandwidth:g} Hz"
            for codec in self.codecs
        ]
        facts = {
            "recipe": self.name,
            "dataset": dataset.name,
            "surfaces": len(dataset.surfaces),
            "sha256": dataset.fingerprint,
            "through": ["nothing", *through],
        }
        spec = training_set.spec
        tip = training_set.tip
        size, hop = WINDOWS[spec.kind]
        settings = (
            {"microphone": spec.microphone, "memory": spec.memory}
            if spec.kind == "texture"
            else {}
        )
        return ModelCard(
            name,
            spec.kind,
            FEATURE_RATE,
            size,
            hop,
            spec.channels,
            Gate(training_set.threshold_dbfs, "banded"),
            self.recipe.response_for(tip).decision,
            settings=settings | tip_settings(tip, dataset.recordings),
            training=facts,
            scores=caveats_of(dataset),
            licence=licence_of(dataset),
        )


def tip_settings(tip: str, recordings: Iterable[Recording]) -> dict[str, str]:
    """Return what a card says of its tip, and of the sound that it was learnt from.

    A model that learnt from simulated touch expects its tip to sound like that, so that
    another tip is noticed.
    """
    if tip and any(map(is_simulation, recordings)):
        return {"tip": tip, "tip_sound": "simulated"}
    return {"tip": tip}


def feature_recipe(recipe: Recipe, options: TrainingOptions) -> FeatureRecipe:
    """Return a recipe on features with its options: channels, microphone, tip, Opus
    bitrate and seed."""
    kind = cast(FeatureKind, recipe.features)
    spec = FeatureSpec(kind, options.channels)
    if recipe.microphone or options.channels == 1:
        spec = replace(
            spec, channels=1, microphone=recipe.microphone or options.microphone
        )
    # As the link sends it to the paper's network (4 kHz of bandwidth), and to these
    # features (8 kHz).
    codecs = (
        options.codec(spec.channels, bandwidth=bandwidth)
        for bandwidth in (0.0, FEATURE_RATE / 2)
    )
    return FeatureRecipe(
        recipe,
        spec,
        tuple(codec for codec in codecs if codec),
        options.seed,
        options.tip,
    )
