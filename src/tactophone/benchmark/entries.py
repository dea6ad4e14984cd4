"""Who takes part in a benchmark, by name, for sound of one or two channels; and what each costs to run."""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import onnx
import soundfile

from tactophone.benchmark.crossvalidation import Method
from tactophone.benchmark.height_regression import HeightMethod
from tactophone.benchmark.paper_methods import PaperMethod
from tactophone.benchmark.plan import Plan
from tactophone.benchmark.recipe_methods import DroppedChannelMethod, recipe_method
from tactophone.benchmark.result import BenchmarkEntry
from tactophone.benchmark.sanity_checks import HighBandControl
from tactophone.benchmark.vibration_method import VibrationMethod
from tactophone.dataset import Dataset, Recording
from tactophone.errors import ConfigError
from tactophone.haptics import PASSTHROUGH, Passthrough
from tactophone.perception import default_model, detector_for, model_path, read_model
from tactophone.training.features.feature_tracks import FeatureSpec
from tactophone.training.network.recipe import paper
from tactophone.training.network.training_job import OPEN_GATE, TrainingJob
from tactophone.training.recipes import RECIPES, train_way
from tactophone.types import AIR, AudioBlock

AIR_DEAD = "ours/air-dead"
"""The same model as ours, its air microphone silent from the first sample on."""

CONTROL_RATE = 40_000
"""Hz; under it there is nothing over 8 kHz to be distrusted."""

HOP, STEPS, BATCH_SIZE = 21, 600, 500
"""Of the paper's training: least batches, where its score is flat, and the settings of docs/scores.md."""

RATE, BUFFER_SIZE = 48_000, 512
"""At which costs are measured: the paper's sound buffers."""

PAPER_LATENCY, WAY_LATENCY = 3.04e-3, 0.38e-3
"""Seconds of the resamplers' delay, from 48 kHz to 2 and to 16 kHz."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What a method costs to run: weights, bytes of its file, processor time of an update in microseconds."""

    parameters: int
    byte_count: int
    update_us: float


def entry_names(channels: int) -> tuple[str, ...]:
    """List who can take part, the reference first."""
    variants = ("paper/general", "paper/fine-tuned", "paper/one-channel") if channels == 2 else ("paper/one-channel",)
    ours = (AIR_DEAD, "ours") if channels == 2 else ("ours",)
    return (*variants, *(name for name in RECIPES if name != "ours"), *PASSTHROUGH, *ours)


def entries_for(dataset: Dataset, names: Sequence[str] = ()) -> tuple[BenchmarkEntry, ...]:
    """Make the contenders for a data set, and its control where its sound has a band over 8 kHz.

    Raises
    ------
    ConfigError
        If a name is unknown.
    """
    channels = channels_of(dataset)
    allowed = entry_names(channels)
    wanted = names or allowed
    if unknown := [name for name in wanted if name not in (*allowed, *entry_names(2))]:
        raise ConfigError(f"no method {', '.join(unknown)}; there are {', '.join(allowed)}")
    kept = [name for name in allowed if name in wanted and not _is_impossible(name, dataset)]
    control = (BenchmarkEntry(HighBandControl(), control=True),) if _has_high_band(dataset) else ()
    return (*(_contender(name, dataset, channels) for name in kept), *control)


def plan_for(dataset: Dataset, names: Sequence[str], splits: Sequence[str]) -> Plan:
    """Plan a benchmark of contenders, all if none are named, with its controls."""
    contenders = entries_for(dataset, names)
    return Plan(
        dataset, contenders, tuple(splits), recipe_method("ours", channels=channels_of(dataset)), _heights(dataset)
    )


def channels_of(dataset: Dataset) -> int:
    """Two, where every recording holds contact and air; one otherwise."""
    return 2 if all(set(one.channels) == {"contact", "air"} for one in dataset.recordings) else 1


def measure_costs(dataset: Dataset, names: Sequence[str], folder: Path) -> dict[str, Cost]:
    """Measure what each method costs to run, from sound at 48 kHz to its answer, a paper's sound buffer at a time.

    Parameters
    ----------
    dataset
        A few of its recordings make the model files of those that have none; a cost hangs on shapes alone.
    names
        Of contenders.
    folder
        Where these files are kept.
    """
    channels = channels_of(dataset)
    few = replace(dataset, recordings=_few(dataset))
    return {name: _cost(name, few, channels, folder) for name in names if name != AIR_DEAD}


def _cost(name: str, few: Dataset, channels: int, folder: Path) -> Cost:
    if name in PASSTHROUGH:
        return cost_of_sounding(PASSTHROUGH[name](None))
    if name not in RECIPES:
        return cost_of(model_path(default_model(1 if name == "paper/one-channel" else channels)))
    told = f"{recipe_method(name, channels=channels).identity} {few.fingerprint}"
    path = folder / f"{name}-{hashlib.sha256(told.encode()).hexdigest()[:16]}.onnx"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        train_way(path, few, name, channels=channels)
    return cost_of(path)


def cost_of(path: Path, *, duration: float = 5.0) -> Cost:
    """Measure what a model file costs; processor time, so that others' work does not count."""
    model = read_model(path)
    detector = detector_for(model, sample_rate=RATE)
    updates, spent = _time(lambda block: len(detector.push(block)), model.card.channels, duration)
    return Cost(_parameters(path), path.stat().st_size, 1e6 * spent / max(updates, 1))


def cost_of_sounding(sounding: Passthrough, *, duration: float = 5.0) -> Cost:
    """Measure a renderer, which has no weights and no file; its update is a sound buffer of 10.7 ms."""
    buffers, spent = _time(lambda block: int(len(sounding.push(block.samples)) > 0), 1, duration)
    return Cost(0, 0, 1e6 * spent / max(buffers, 1))


def _time(step: Callable[[AudioBlock], int], channels: int, duration: float) -> tuple[int, float]:
    """Count updates, and the processor time that they took, in s."""
    rng = np.random.default_rng(0)
    noise = (0.1 * rng.standard_normal((round(duration * RATE), channels))).astype(np.float32)
    updates, spent = 0, 0.0
    for start in range(0, len(noise), BUFFER_SIZE):
        block = AudioBlock(noise[start : start + BUFFER_SIZE], RATE, start)
        before = time.thread_time()
        updates += step(block)
        spent += time.thread_time() - before
    return updates, spent


def _contender(name: str, dataset: Dataset, channels: int) -> BenchmarkEntry:
    if name in RECIPES or name == AIR_DEAD:
        ours = recipe_method("ours", channels=channels)
        method: Method = DroppedChannelMethod(ours, AIR) if name == AIR_DEAD else recipe_method(name, channels=channels)
        return BenchmarkEntry(method, RECIPES["ours" if name == AIR_DEAD else name].rule, WAY_LATENCY)
    if name in PASSTHROUGH:
        return BenchmarkEntry(VibrationMethod(name), latency=PASSTHROUGH[name](None).latency)
    recipe = replace(
        paper(name.partition("/")[2]),  # type: ignore[arg-type]  # the names are those of the variants
        hop=HOP, batch_size=BATCH_SIZE, least_steps=STEPS, precision="bfloat16",
    )  # fmt: skip
    told = any(one.segments for one in dataset.recordings)
    if not told:
        recipe = replace(recipe, labelling=replace(recipe.labelling, threshold=0.0, relative=False))
    return BenchmarkEntry(PaperMethod(TrainingJob(recipe, gate=None if told else OPEN_GATE)), latency=PAPER_LATENCY)


def _heights(dataset: Dataset) -> HeightMethod | None:
    told = any(one.known("ra_um") for one in dataset.recordings)
    return HeightMethod(FeatureSpec("texture", channels_of(dataset))) if told else None


def _is_impossible(name: str, dataset: Dataset) -> bool:
    """A surface's height is regressed only where it is told."""
    return name == "surface" and not any(one.known("ra_um") for one in dataset.recordings)


def _has_high_band(dataset: Dataset) -> bool:
    return bool(soundfile.info(dataset.recordings[0].path).samplerate >= CONTROL_RATE)


def _few(dataset: Dataset) -> tuple[Recording, ...]:
    """One recording of each of six surfaces of either label: a cost hangs on shapes, not on what was learnt."""
    firsts = {one.surface: one for one in dataset.recordings}
    some = sorted(firsts.values(), key=lambda one: (one.known("label"), one.surface))
    return (*some[:6], *some[-6:])


def _parameters(path: Path) -> int:
    graph = onnx.load(str(path)).graph
    trees = [len(one.floats) for node in graph.node for one in node.attribute if one.name == "nodes_values"]
    return sum(int(np.prod(tensor.dims)) for tensor in graph.initializer) + sum(trees)
