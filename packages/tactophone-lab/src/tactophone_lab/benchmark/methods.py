"""What a benchmark compares, by name: methods behind one protocol,
:class:`tactophone_lab.benchmark.folds.Method`.

Every recipe of :data:`tactophone_lab.training.recipes.RECIPES` is a method through
:func:`method_of`.

A passthrough (`tactophone.signal.haptics.passthrough`), built in or from a plug-in, has
no detector: the finger itself must separate rough from smooth. In
:class:`RendererMethod` a regression takes its place, on what a finger can perceive of
the vibration: its level, its peaks, and its strength in bands from 35 Hz to 1 kHz.

Besides what the protocol wants, each has ``rule``, the decision rule of the live
system, and ``latency``, the seconds from a window's end to its prediction.
"""

import functools
import itertools
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, cast

import numpy as np
import onnxruntime
from numpy.lib.stride_tricks import sliding_window_view

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.microphones import AIR
from tactophone.core.recordings.values import Dataset, Recording, tip_of
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import (
    STEP_SIZE,
    open_passthrough,
    passthrough_names,
)
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.model_file import (
    FEATURES,
    LOG_PROBABILITIES,
    Model,
    load_model,
    read_model,
)
from tactophone.signal.perception.resample import Resampler
from tactophone_lab.evaluation.bumps_and_delays import felt_predictor
from tactophone_lab.evaluation.metrics import Floats
from tactophone_lab.evaluation.predict import (
    Predictor,
    TakePredictions,
    felt_at_windows,
    model_predictor,
)
from tactophone_lab.training.baselines import FeatureRecipe
from tactophone_lab.training.onnx_export import describe
from tactophone_lab.training.recipe_options import VARIANTS, TrainingOptions
from tactophone_lab.training.recipes import (
    FEATURE_RECIPES,
    RECIPES,
    ConfiguredRecipe,
    configure,
)
from tactophone_lab.training.sets import TrainingSet, even_weights
from tactophone_lab.training.tracks import extract_features

if TYPE_CHECKING:
    from tactophone_lab.training.trainer import NetworkRecipe

METHODS_VERSION = 2
"""Raise it when a class here changes in a way that its settings do not show, so that
cached folds are trained anew."""

NO_AIR = "texture/no-air"
"""An ablation: the model of ``texture`` with a silent air microphone."""

NETWORK_CHANGES: dict[str, Any] = {"hop": 21, "batch_size": 500, "least_steps": 600}
"""How the benchmark trains the paper's network, as in docs/research/scores.md: its
score is flat in the number of steps."""

FAST_STEPS = 200
"""Least steps of the network in a fast benchmark; with more, its nine folds would take
most of the time."""

NETWORK_LATENCY = 3.04e-3
"""Delay of the resampler from 48 kHz to the paper's network's 2 kHz, in s."""

FEATURE_LATENCY = 0.38e-3
"""Delay of the resampler from 48 kHz to the features' 16 kHz, in s."""


FULL_DRIVE = Limits(ceiling=1.0)
"""No ceiling: what is scored is the vibration that a method asks for."""

WINDOW_SIZE = 1024
"""Samples of a window of vibration at 4 kHz: the paper's 256 ms."""

HOP = 128 / 3
"""Samples of vibration at 4 kHz between two windows: the paper's 10.67 ms."""

BAND_EDGES = np.geomspace(35, 1000, 9)
"""Hz, of the bands of a vibration."""

FAINTEST_VIBRATION = 1e-8
"""Added to each power, as silence has no logarithm."""

RENDERERS: Mapping[str, str] = {
    f"{name}/felt" if name in FEATURE_RECIPES else name: name
    for name in passthrough_names()
}
"""The passthrough of each method: a name that a recipe has too gets ``/felt``."""


@dataclass(frozen=True, slots=True)
class NetworkMethod:
    """The paper's network in a model file, which runs as the live system runs it."""

    recipe: "NetworkRecipe"
    title: str = ""
    """In tables, in place of the recipe's name."""
    rule: ClassVar[DecisionRule] = DecisionRule()
    latency: ClassVar[float] = NETWORK_LATENCY

    @property
    def name(self) -> str:
        return self.title or self.recipe.name

    @property
    def identity(self) -> str:
        return f"model file {METHODS_VERSION} {self.recipe.identity}"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "fold.onnx"
            self.recipe.train(path, Dataset("fold", Path(folder), tuple(recordings)))
            model = read_model(path)
        return with_touches(model_predictor(model), model)


@dataclass(frozen=True, slots=True)
class FeatureMethod:
    """A recipe on features.

    Its windows are predicted over a whole recording at once: features are computed once
    per recording and cached in the process. Tests hold that the streaming detector
    makes the same predictions, window for window. Touches are that detector's.
    """

    recipe: FeatureRecipe
    dropped: int | None = None
    """An ablation: this channel is silent after training. The same weights, one
    microphone less."""
    rule: DecisionRule = field(default_factory=DecisionRule)
    latency: ClassVar[float] = FEATURE_LATENCY

    @property
    def name(self) -> str:
        return (
            self.recipe.name
            if self.dropped is None
            else f"{self.recipe.name}/no-{('contact', 'air')[self.dropped]}"
        )

    @property
    def identity(self) -> str:
        return f"features {METHODS_VERSION} {self.recipe.identity}" + (
            "" if self.dropped is None else f" without {self.dropped}"
        )

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Train, and predict by the graph that a model file would hold.

        A channel that is silenced has no model file, so that its touches follow from
        windows alone.
        """
        training_set = self.recipe.training_set(recordings)
        classifier = self.recipe.build(training_set)
        windows = graph_predictor(
            classifier.SerializeToString(), training_set, dropped=self.dropped
        )
        if self.dropped is not None:
            return windows
        graph = training_set.whole(classifier)
        trained_on = Dataset("fold", Path(), tuple(recordings))
        describe(graph, self.recipe.card("fold", trained_on, training_set))
        model = load_model(Path("fold.onnx"), graph.SerializeToString())
        return with_touches(windows, model)


@dataclass(frozen=True, slots=True)
class RendererMethod:
    """A logistic regression on the vibration that a renderer makes; always in
    contact."""

    name: str
    """One of `RENDERERS`."""
    rule: ClassVar[DecisionRule] = DecisionRule()

    @property
    def latency(self) -> float:
        return open_passthrough(RENDERERS[self.name]).latency

    @property
    def identity(self) -> str:
        return f"regression {METHODS_VERSION} {self.name}"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Fit, with every surface at the same weight."""
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        rows = [
            vibration_features(recording, RENDERERS[self.name])[1]
            for recording in recordings
        ]
        sizes = [len(windows) for windows in rows]
        names = sorted({recording.surface for recording in recordings})
        rough = np.repeat([recording.rough for recording in recordings], sizes)
        surface = np.repeat(
            [names.index(recording.surface) for recording in recordings], sizes
        )
        model = make_pipeline(
            StandardScaler(), LogisticRegression(C=0.03, solver="newton-cholesky")
        )
        model.fit(
            np.concatenate(rows),
            rough,
            logisticregression__sample_weight=even_weights(rough, surface),
        )

        def predict(recording: Recording) -> TakePredictions:
            time, windows = vibration_features(recording, RENDERERS[self.name])
            share = model.predict_proba(windows)[:, 1].astype(np.float32)
            probabilities = np.stack([np.zeros_like(share), 1 - share, share], axis=1)
            return TakePredictions(
                recording, time, probabilities, np.ones(len(time), bool)
            )

        return predict


@functools.lru_cache(maxsize=1 << 13)
def vibration_features(recording: Recording, renderer: str) -> tuple[Floats, Floats]:
    """Log of eight band powers, level and crest of the vibration that a renderer makes
    of a recording.

    Returns the end of each window in s, and features of shape ``(windows, 10)``.
    """
    sound = recording.read(channels=1)
    resampler = Resampler(sound.sample_rate, LIVE_SAMPLE_RATE, channels=1)
    contact = np.concatenate([resampler.push(sound.samples), resampler.flush()])
    whole = open_passthrough(renderer, FULL_DRIVE).render_whole(contact)
    vibration = whole[STEP_SIZE - 1 :: STEP_SIZE]
    rate = LIVE_SAMPLE_RATE // STEP_SIZE
    starts = np.floor(
        np.arange(max(0, int((len(vibration) - WINDOW_SIZE) / HOP) + 1)) * HOP
    ).astype(np.intp)
    windows = sliding_window_view(vibration, WINDOW_SIZE)[starts].astype(np.float64)
    powers = np.square(np.abs(np.fft.rfft(windows * np.hanning(WINDOW_SIZE))))
    bins = np.fft.rfftfreq(WINDOW_SIZE, 1 / rate)
    pairs = itertools.pairwise(BAND_EDGES)
    bands = np.stack(
        [powers[:, (bins >= low) & (bins < high)].mean(axis=1) for low, high in pairs],
        axis=1,
    )
    power = np.square(windows).mean(axis=1)
    peak = np.square(windows).max(axis=1)
    rows = np.log10(
        np.column_stack(
            [
                bands / WINDOW_SIZE,
                power,
                (peak + FAINTEST_VIBRATION) / (power + FAINTEST_VIBRATION),
            ]
        )
        + FAINTEST_VIBRATION
    )
    return (starts + WINDOW_SIZE) / rate, rows


BenchmarkMethod: TypeAlias = NetworkMethod | FeatureMethod | RendererMethod


def with_touches(windows: Predictor, model: Model) -> Predictor:
    """Return a predictor of single windows with what a finger would feel of a model."""
    felt = felt_predictor(model)
    return lambda recording: felt_at_windows(windows(recording), felt(recording))


def method_of(recipe: ConfiguredRecipe) -> NetworkMethod | FeatureMethod:
    return (
        FeatureMethod(recipe)
        if isinstance(recipe, FeatureRecipe)
        else NetworkMethod(recipe)
    )


def recipe_method(name: str, *, channels: int) -> FeatureMethod:
    """Return the method of a recipe on features, for sound of 1 or 2 channels."""
    return FeatureMethod(
        cast(FeatureRecipe, configure(name, TrainingOptions(channels=channels)))
    )


def method_names(channels: int) -> tuple[str, ...]:
    """List the names of all methods, the reference first."""
    networks = [
        f"paper/{name}" for name in VARIANTS if channels == 2 or name == "one-channel"
    ]
    baselines = [name for name in FEATURE_RECIPES if name != "texture"]
    return (
        *networks,
        *baselines,
        *RENDERERS,
        *((NO_AIR, "texture") if channels == 2 else ("texture",)),
    )


def methods_for(
    dataset: Dataset, names: Sequence[str] = (), *, fast: bool = False
) -> tuple[BenchmarkMethod, ...]:
    """Make the methods for a data set, all by default.

    With ``fast`` the paper's network is trained for :data:`FAST_STEPS`. Raises
    `ConfigError` if a name is unknown.
    """
    allowed = method_names(channels_of(dataset))
    if unknown := [name for name in names if name not in (*allowed, *method_names(2))]:
        raise ConfigError(
            f"no method {', '.join(unknown)}; there are "
            f"{', '.join(allowed)}{did_you_mean(unknown[0], allowed)}"
        )
    chosen = [name for name in allowed if name in (names or allowed)]
    return tuple(_make_method(name, dataset, fast=fast) for name in chosen)


def channels_of(dataset: Dataset) -> int:
    """2 if every recording has contact and air, otherwise 1."""
    return (
        2
        if all(
            set(recording.channels) == {"contact", "air"}
            for recording in dataset.recordings
        )
        else 1
    )


def _make_method(name: str, dataset: Dataset, *, fast: bool) -> BenchmarkMethod:
    if name in RENDERERS:
        return RendererMethod(name)
    if name.startswith("paper/"):
        from tactophone_lab.training.trainer import fastest_precision

        # Without labelled segments every window is contact, both in training and in the
        # model's gate.
        segmented = any(recording.segments for recording in dataset.recordings)
        changes = NETWORK_CHANGES | ({"least_steps": FAST_STEPS} if fast else {})
        options = TrainingOptions(
            # The names of these methods end in the names of the variants.
            variant=name.partition("/")[2],  # type: ignore[arg-type]
            precision=fastest_precision(),
            contact_threshold=None if segmented else "off",
            **changes,
        )
        return method_of(configure("paper-fast", options))
    recipe = name.partition("/")[0]
    rule = RECIPES[recipe].response_for(tip_of(dataset.recordings)).decision
    dropped = AIR if name == NO_AIR else None
    return replace(
        recipe_method(recipe, channels=channels_of(dataset)), dropped=dropped, rule=rule
    )


def graph_predictor(
    graph: bytes, training_set: TrainingSet, *, dropped: int | None = None
) -> Predictor:
    """Return a predictor that runs a graph on all windows of a recording at once.

    The features are as in training; the channel ``dropped`` carries nothing.
    """
    session = onnxruntime.InferenceSession(graph, providers=["CPUExecutionProvider"])

    def predict(recording: Recording) -> TakePredictions:
        (track,) = extract_features([recording], training_set.spec)
        if dropped is not None:
            alive = np.arange(training_set.spec.channels) != dropped
            # Constant features of a silent channel never trigger the detection of a
            # change of surface.
            track = replace(
                track,
                present=track.present & alive,
                description=track.description * alive[:, None],
            )
        (log_probabilities,) = session.run(
            [LOG_PROBABILITIES], {FEATURES: training_set.features([track])[0]}
        )
        contact = track.level_dbfs >= training_set.threshold_dbfs
        return TakePredictions(
            recording, track.end, np.exp(log_probabilities, dtype=np.float32), contact
        )

    return predict
