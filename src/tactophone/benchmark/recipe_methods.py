"""Ways of telling rough from smooth as methods that are cross-validated: the live stages, a whole recording at once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import onnxruntime

from tactophone.dataset import Recording
from tactophone.evaluation.predictions import Judge, TakePredictions
from tactophone.perception.model_file import FEATURES, LOG_PROBABILITIES
from tactophone.training.features.feature_tracks import FeatureSpec, listen
from tactophone.training.features.training_set import TrainingSet, prepare
from tactophone.training.recipes import RECIPES
from tactophone.types import AIR

VERSIONS: Mapping[str, int] = MappingProxyType({"ours": 3, "logistic": 3, "boosting": 3, "surface": 3})
"""Of a way that changed in a manner that its settings do not tell: raised, its cached results are made anew."""

FIRST_VERSION = 2
"""Of all that :data:`VERSIONS` does not name; those that are slow to learn keep their results."""


def version_of(name: str) -> int:
    """Give a way's version."""
    return VERSIONS.get(name, FIRST_VERSION)


@dataclass(frozen=True, slots=True)
class RecipeMethod:
    """One way of :data:`tactophone.training.recipes.RECIPES`.

    Recordings are described once and remembered by the process, so that a fold costs the learning alone; tests hold
    this to be what the streaming detector says, window for window.
    """

    name: str
    ear: FeatureSpec

    @property
    def identity(self) -> str:
        """The way, how it hears, and the version of what is done with it."""
        return f"way {version_of(self.name)} {self.name} {self.ear!r}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Learn, and make the graph that a model file would hold."""
        return judge_by(*self.learn(recordings))

    def learn(self, recordings: Sequence[Recording]) -> tuple[bytes, TrainingSet]:
        """Give that graph, and what it was learnt from."""
        lesson = prepare(self.ear, recordings)
        return RECIPES[self.name].build(lesson).SerializeToString(), lesson


@dataclass(frozen=True, slots=True)
class DroppedChannelMethod:
    """A way of two channels of which one falls silent once all is learnt: the same weights, one microphone less."""

    way: RecipeMethod
    dead: int

    @property
    def name(self) -> str:
        """The way's, and what is dead."""
        return f"{self.way.name}/{'air' if self.dead == AIR else 'contact'}-dead"

    @property
    def identity(self) -> str:
        """The way's, and what is dead."""
        return f"{self.way.identity} without channel {self.dead}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Learn as the way does, and judge by the channel that is left."""
        return judge_by(*self.way.learn(recordings), dead=self.dead)


def recipe_method(name: str, *, channels: int) -> RecipeMethod:
    """Make the method of a way, for sound of so many channels."""
    return RecipeMethod(name, RECIPES[name].ear(channels))


def judge_by(graph: bytes, lesson: TrainingSet, *, ear: FeatureSpec | None = None, dead: int | None = None) -> Judge:
    """Make a judge of a graph, which answers for every window of a recording at once.

    Parameters
    ----------
    graph
        As a model file holds it.
    lesson
        What it was learnt from.
    ear
        How it hears; as it did while learning, if not given.
    dead
        A channel that carries nothing.
    """
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])

    def judge(recording: Recording) -> TakePredictions:
        (track,) = listen([recording], ear or lesson.ear)
        if dead is not None:
            alive = np.arange(lesson.ear.channels) != dead
            # What a dead channel says never changes, so that it surprises no memory.
            track = replace(track, present=track.present & alive, description=track.description * alive[:, None])
        (answer,) = session.run([LOG_PROBABILITIES], {FEATURES: lesson.features(track)})
        contact = track.level_dbfs >= lesson.threshold_dbfs
        return TakePredictions(recording, track.end, np.exp(answer, dtype=np.float32), contact)

    return judge
