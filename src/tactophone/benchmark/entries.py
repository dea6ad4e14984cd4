"""The entries of a benchmark by name, for sound of one or two channels."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import soundfile

from tactophone.benchmark.crossvalidation import Method
from tactophone.benchmark.methods import FeatureMethod, RegressionMethod, method_of, recipe_method
from tactophone.benchmark.regression_features import HIGH_BAND_CONTROL, HIGH_BAND_EDGES, RENDERERS
from tactophone.dataset import Dataset
from tactophone.errors import ConfigError, did_you_mean
from tactophone.haptics import PASSTHROUGH
from tactophone.perception import DecisionRule
from tactophone.training import FEATURE_RECIPES, OPEN_GATE, RECIPES, VARIANTS, TrainingOptions, tip_of
from tactophone.training.network.processor import fastest_precision
from tactophone.types import AIR

NO_AIR = "texture/no-air"
"""An ablation: the model of ``texture`` with a silent air microphone."""

NETWORK_CHANGES = {"hop": 21, "batch_size": 500, "least_steps": 600}
"""Of the training of the paper's network, as in docs/research/scores.md: its score is flat in the number of steps."""

FAST_STEPS = 200
"""Least steps of the network in a fast benchmark, of which its nine folds would otherwise take most of the time."""

REFERENCE_SEEDS = (0, 1, 2)
"""Of the reference: one seed of a network says little about the next."""

NETWORK_LATENCY, FEATURE_LATENCY = 3.04e-3, 0.38e-3
"""Seconds of the resamplers' delay, from 48 kHz to 2 and to 16 kHz."""


@dataclass(frozen=True, slots=True)
class BenchmarkEntry:
    """A method with what the live system adds to it."""

    method: Method
    rule: DecisionRule = field(default_factory=DecisionRule)
    latency: float = 0.0
    """Seconds from a window's end to its prediction."""
    control: bool = False
    """Whether it is a control, which should be at chance, and not a competitor."""

    @property
    def name(self) -> str:
        """Of the method."""
        return self.method.name


def entry_names(channels: int) -> tuple[str, ...]:
    """List the names of all entries, the reference first."""
    networks = [f"paper/{name}" for name in VARIANTS if channels == 2 or name == "one-channel"]
    baselines = [name for name in FEATURE_RECIPES if name != "texture"]
    return (*networks, *baselines, *RENDERERS, *((NO_AIR, "texture") if channels == 2 else ("texture",)))


def entries_for(dataset: Dataset, names: Sequence[str] = (), *, fast: bool = False) -> tuple[BenchmarkEntry, ...]:
    """Make the entries for a data set, all by default, and the control where its sound has a band over 8 kHz.

    With ``fast`` the paper's network is trained for :data:`FAST_STEPS`. Raises `ConfigError` if a name is unknown.
    """
    channels = channels_of(dataset)
    allowed = entry_names(channels)
    if unknown := [name for name in names if name not in (*allowed, *entry_names(2))]:
        raise ConfigError(
            f"no method {', '.join(unknown)}; there are {', '.join(allowed)}{did_you_mean(unknown[0], allowed)}"
        )
    chosen = [name for name in allowed if name in (names or allowed) and _is_possible(name, dataset)]
    sample_rate = soundfile.info(dataset.recordings[0].path).samplerate
    control = BenchmarkEntry(RegressionMethod(HIGH_BAND_CONTROL), control=True)
    has_high_band = sample_rate >= 2 * HIGH_BAND_EDGES[-1]
    return (*(_entry(name, dataset, channels, fast=fast) for name in chosen), *((control,) if has_high_band else ()))


def channels_of(dataset: Dataset) -> int:
    """2 if every recording has contact and air, otherwise 1."""
    return 2 if all(set(recording.channels) == {"contact", "air"} for recording in dataset.recordings) else 1


def reference_with_seed(dataset: Dataset, name: str, seed: int) -> Method | None:
    """Return an entry's method with another seed; ``None`` for methods without one."""
    return _entry(name, dataset, channels_of(dataset), seed=seed).method if name.startswith("paper/") else None


def _entry(name: str, dataset: Dataset, channels: int, *, seed: int = 0, fast: bool = False) -> BenchmarkEntry:
    if name in RENDERERS:
        return BenchmarkEntry(RegressionMethod(name), latency=PASSTHROUGH[RENDERERS[name]](None).latency)
    if name.startswith("paper/"):
        # Without labelled segments every window is contact, both in training and in the model's gate.
        gate = None if any(recording.segments for recording in dataset.recordings) else OPEN_GATE
        changes = NETWORK_CHANGES | ({"least_steps": FAST_STEPS} if fast else {})
        options = TrainingOptions(
            variant=name.partition("/")[2],  # type: ignore[arg-type]  # the names are those of the variants
            precision=fastest_precision(), gate=gate, seed=seed, changes=changes,
        )  # fmt: skip
        return BenchmarkEntry(method_of(RECIPES["paper-fast"].open_job(options)), latency=NETWORK_LATENCY)
    recipe = name.partition("/")[0]
    method = recipe_method(recipe, channels=channels)
    if name == NO_AIR:
        method = FeatureMethod(method.job, dropped=AIR)
    return BenchmarkEntry(method, RECIPES[recipe].response_for(tip_of(dataset.recordings)).decision, FEATURE_LATENCY)


def _is_possible(name: str, dataset: Dataset) -> bool:
    requires = RECIPES[name].requires if name in RECIPES else ""
    return not requires or any(recording.known(requires) for recording in dataset.recordings)
