"""Trains a recipe that learns from features, from a data set to a model file."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import onnx

from tactophone.dataset import Dataset, Recording
from tactophone.link import Codec
from tactophone.training.features.feature_tracks import FEATURE_RATE, FeatureSpec
from tactophone.training.features.linear_classifier import HARD_TIPS
from tactophone.training.features.training_set import TrainingSet, build_training_set
from tactophone.training.model_export import write_graph
from tactophone.training.provenance import caveats_of, licence_of, tip_of
from tactophone.training.recipes import RECIPES, FeatureKind, Recipe, Report, TrainingOptions, load, silent


@dataclass(frozen=True, slots=True)
class FeatureJob:
    """A training of a recipe on features, without its recordings."""

    name: str
    """A key of :data:`tactophone.training.recipes.RECIPES`."""
    spec: FeatureSpec
    """Which features, of which channels; the memory is that of the recipe for the tip."""
    codecs: tuple[Codec, ...] = ()
    """A model file is trained on each recording as it is and once more through each of these codecs."""
    seed: int = 0
    """Of the augmentation."""
    tip: str = ""
    """That the model is for; empty: that of the recordings."""

    @property
    def recipe(self) -> Recipe:
        """The registry's entry."""
        return RECIPES[self.name]

    @property
    def channels(self) -> int:
        """Microphones that the model uses."""
        return self.spec.channels

    @property
    def evaluated_spec(self) -> FeatureSpec:
        """Features for a cross-validation: through the widest of the codecs, if there are any."""
        return replace(self.spec, codec=self.codecs[-1]) if self.codecs else self.spec

    @property
    def identity(self) -> str:
        """Text that changes whenever the result may: key of cached results."""
        return f"{self.name} {self.recipe.version} {self.seed} {self.tip} {self.evaluated_spec!r}"

    def training_set(self, recordings: Sequence[Recording], *, codecs: Sequence[Codec] | None = None) -> TrainingSet:
        """Return what the recipe is trained with: for a cross-validation by default, for a model file with codecs."""
        spec = self.evaluated_spec if codecs is None else self.spec
        tip = self.tip or tip_of(recordings)
        return build_training_set(
            replace(
                spec,
                memory=self.recipe.response_for(tip).memory,
                unevenness=spec.kind == "texture" and tip in HARD_TIPS,
            ),
            recordings,
            codecs=codecs or (),
            augmentation=self.recipe.augmentation,
            seed=self.seed,
            tip=tip,
        )

    def build(self, training_set: TrainingSet) -> onnx.ModelProto:
        """Fit the classifier and return the graph of a model file."""
        return cast(onnx.ModelProto, load(self.recipe.fit)(training_set))

    def train(
        self,
        path: Path,
        dataset: Dataset,
        *,
        checkpoint: Path | None = None,
        report: Report = silent,
        log: Callable[[str], None] = silent,
    ) -> bool:
        """Train on a data set and write the model file, named after the file; see :class:`~tactophone.training.Job`."""
        del checkpoint, log
        report(0, None, self.name)
        training_set = self.training_set(dataset.recordings, codecs=self.codecs)
        through = [f"{codec.name}, {codec.bitrate_bps} bit/s, {codec.bandwidth:g} Hz" for codec in self.codecs]
        facts = {
            "recipe": self.name,
            "dataset": dataset.name,
            "surfaces": len(dataset.surfaces),
            "sha256": dataset.fingerprint,
            "through": ["nothing", *through],
        }
        card = training_set.card(path.stem, rule=self.recipe.response_for(training_set.tip).decision, training=facts)
        settings = {**card.settings, "tip": training_set.tip}
        card = replace(card, settings=settings, scores=caveats_of(dataset), licence=licence_of(dataset))
        write_graph(path, self.build(training_set), card)
        return True


def feature_job(recipe: Recipe, options: TrainingOptions) -> FeatureJob:
    """Return the job of a recipe on features; it has channels, microphone, tip, Opus bitrate and seed."""
    kind = cast(FeatureKind, recipe.features)
    spec = FeatureSpec(kind, options.channels, change_detection=recipe.change_detection)
    if recipe.microphone or options.channels == 1:
        spec = replace(spec, channels=1, microphone=recipe.microphone or options.microphone)
    # As the link sends it to the paper's network (4 kHz of bandwidth), and to these features (8 kHz).
    codecs = (options.codec(spec.channels, bandwidth=bandwidth) for bandwidth in (0.0, FEATURE_RATE / 2))
    return FeatureJob(recipe.name, spec, tuple(codec for codec in codecs if codec), options.seed, options.tip)
