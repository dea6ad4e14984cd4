"""What each method costs to run, from sound at 48 kHz to its prediction, in the paper's sound buffers."""

import hashlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import onnx

from tactophone.benchmark.entries import NO_AIR, channels_of
from tactophone.benchmark.methods import recipe_method
from tactophone.benchmark.regression_features import RENDERERS
from tactophone.dataset import Dataset, Recording
from tactophone.haptics import PASSTHROUGH, Passthrough
from tactophone.perception import WindowDetector, model_path, read_model
from tactophone.training import FEATURE_RECIPES, read_weights
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock

BUFFER_SIZE = 512
"""The paper's sound buffers."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Number of weights, size of the model file in bytes, and processor time of an update in microseconds."""

    parameters: int
    byte_count: int
    update_us: float


def measure_costs(dataset: Dataset, names: Sequence[str], folder: Path) -> dict[str, Cost]:
    """Measure the cost of entries; ablations have none of their own.

    A few of the recordings train the model files: the cost depends on shapes alone.
    """
    channels = channels_of(dataset)
    few = replace(dataset, recordings=_few(dataset))
    return {name: _cost(name, few, channels, folder) for name in names if name != NO_AIR}


def _cost(name: str, few: Dataset, channels: int, folder: Path) -> Cost:
    if name in RENDERERS:
        return cost_of_renderer(PASSTHROUGH[RENDERERS[name]](None))
    if name not in FEATURE_RECIPES:
        return cost_of_model(model_path("paper-mono" if name == "paper/one-channel" or channels == 1 else "paper"))
    job = recipe_method(name, channels=channels).job
    key = hashlib.sha256(f"{job.identity} {few.fingerprint}".encode()).hexdigest()[:16]
    path = folder / f"{name}-{key}.onnx"
    if not path.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        job.train(path, few)
    return cost_of_model(path)


def cost_of_model(path: Path, *, duration: float = 5.0) -> Cost:
    """Measure a model file on this many seconds of noise; processor time, so that other processes do not count."""
    model = read_model(path)
    detector = WindowDetector(model, sample_rate=LIVE_SAMPLE_RATE)
    updates, spent = _time(lambda block: len(detector.push(block)), model.card.channels, duration)
    return Cost(_count_parameters(path, model.card.kind), path.stat().st_size, 1e6 * spent / max(updates, 1))


def _count_parameters(path: Path, kind: str) -> int:
    """Count what was trained; scales, padding and shapes of weights in 8 bits are none."""
    if kind == "paper":
        return sum(weight.size for weight in read_weights(path).values())
    graph = onnx.load(str(path)).graph
    trees = [len(entry.floats) for node in graph.node for entry in node.attribute if entry.name == "nodes_values"]
    return sum(int(np.prod(tensor.dims)) for tensor in graph.initializer) + sum(trees)


def cost_of_renderer(renderer: Passthrough, *, duration: float = 5.0) -> Cost:
    """Measure a renderer, which has neither weights nor a file; its update is a sound buffer of 10.7 ms."""
    buffers, spent = _time(lambda block: int(len(renderer.push(block.samples)) > 0), 1, duration)
    return Cost(0, 0, 1e6 * spent / max(buffers, 1))


def _time(step: Callable[[AudioBlock], int], channels: int, duration: float) -> tuple[int, float]:
    """Count updates, and the processor time that they took, in s."""
    rng = np.random.default_rng(0)
    noise = (0.1 * rng.standard_normal((round(duration * LIVE_SAMPLE_RATE), channels))).astype(np.float32)
    updates, spent = 0, 0.0
    for start in range(0, len(noise), BUFFER_SIZE):
        block = AudioBlock(noise[start : start + BUFFER_SIZE], LIVE_SAMPLE_RATE, start)
        before = time.thread_time()
        updates += step(block)
        spent += time.thread_time() - before
    return updates, spent


def _few(dataset: Dataset) -> tuple[Recording, ...]:
    """One recording of each of six surfaces of either label."""
    firsts = {recording.surface: recording for recording in dataset.recordings}
    ordered = sorted(firsts.values(), key=lambda recording: (recording.known("label"), recording.surface))
    return (*ordered[:6], *ordered[-6:])
