"""The training loop: batches of views, features a batch at a time, and a way back after a kill.

A batch costs the network's arithmetic and little else (97 % of its time): so what counts is how few windows are
needed, and matrix products in oneDNN's kernels (docs/training.md).
"""

import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from tactophone.perception.features.spectrum import magnitudes
from tactophone.training.network import checkpoint
from tactophone.training.network.checkpoint import Checkpoint
from tactophone.training.network.model import PaperNetwork, Weights, weights_of, with_weights
from tactophone.training.network.recipe import Recipe
from tactophone.training.network.windows import Windows, batches, grid
from tactophone.training.network.worker_group import WorkerGroup, init_distributed
from tactophone.types import FloatArray

SAVE_EVERY = 10.0
"""Seconds between checkpoints: what a kill costs at most; one takes about 0.05 s for 22 MB."""

_SMOOTHING = 0.98
"""Weight of the past in the loss shown: about the last 50 batches."""


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a run is; ``loss`` is averaged over about the last 50 batches."""

    steps: int
    of: int
    loss: float


class Run:
    """A training run: iterate it to go through it, a batch at a time.

    The same windows, recipe, seed and number of threads give the same bits on the same machine, whether the run was
    interrupted or not.

    Parameters
    ----------
    windows, recipe
        What is learnt, and how.
    seed
        Of the first parameters, the order of windows and the noise.
    saved
        Where to keep a checkpoint; if there is one of this very run, the run goes on from it.
    initial
        Parameters to begin from, instead of random ones.

    Attributes
    ----------
    network
        As it stands after the last batch.
    """

    def __init__(
        self,
        windows: Windows,
        recipe: Recipe,
        *,
        seed: int = 0,
        saved: Path | None = None,
        initial: Weights | None = None,
    ) -> None:
        _prepare_torch()
        self._crew = init_distributed()
        self._windows, self._recipe, self._seed, self._saved = windows, recipe, seed, saved
        self.network = _network(recipe, seed, initial)
        self._optimiser = torch.optim.Adam(self.network.parameters(), lr=recipe.learning_rate, fused=True)
        self._identity = _identity(windows, recipe, seed=seed, initial=initial)
        self._skip = self._restore()

    def __iter__(self) -> Iterator[Progress]:
        epochs = _epochs(self._windows, self._recipe, self._seed)
        loss, written = float("nan"), time.monotonic()
        for step, which in self._schedule(len(epochs)):
            features, labels = _batch(
                self._windows, which, noise=self._recipe.noise, seed=(self._seed, step), crew=self._crew
            )
            new = _learn(self.network, self._optimiser, features, labels, recipe=self._recipe, crew=self._crew)
            loss = new if np.isnan(loss) else _SMOOTHING * loss + (1 - _SMOOTHING) * new
            yield Progress(step + 1, sum(epochs), loss)
            if self._saved and self._crew.leads and time.monotonic() - written > SAVE_EVERY:
                arrays = checkpoint.state_of(self.network, self._optimiser)
                checkpoint.save(self._saved, Checkpoint(self._identity, step + 1, arrays))
                written = time.monotonic()

    def _restore(self) -> int:
        done = checkpoint.load(self._saved, identity=self._identity) if self._saved else None
        if done:
            checkpoint.restore(done, self.network, self._optimiser)
        return done.steps if done else 0

    def _schedule(self, epochs: int) -> Iterator[tuple[int, NDArray[np.intp]]]:
        recipe, step = self._recipe, 0
        for epoch in range(epochs):
            for which in batches(self._windows, hop=recipe.hop, size=recipe.batch_size, seed=self._seed, epoch=epoch):
                if step >= self._skip:
                    yield step, which
                step += 1


def train(
    windows: Windows,
    recipe: Recipe,
    *,
    seed: int = 0,
    saved: Path | None = None,
    initial: Weights | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> dict[str, FloatArray]:
    """Go through a whole :class:`Run`, telling ``report`` of each batch; give the network's parameters."""
    run = Run(windows, recipe, seed=seed, saved=saved, initial=initial)
    for progress in run:
        report(progress)
    return weights_of(run.network)


def _prepare_torch() -> None:
    # "medium" sends float32 products to oneDNN, twice as fast here as torch's default on AMD, and still float32;
    # on processors with AMX it rounds their inputs to bfloat16.
    torch.set_float32_matmul_precision("medium")
    torch.use_deterministic_algorithms(True)
    torch.set_flush_denormal(True)


def _network(recipe: Recipe, seed: int, initial: Weights | None) -> PaperNetwork:
    if initial is not None:
        return with_weights(initial)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return PaperNetwork(channels=recipe.channels)


def _epochs(windows: Windows, recipe: Recipe, seed: int) -> list[int]:
    """Count the batches of each epoch that the recipe asks for."""
    steps: list[int] = []
    while len(steps) < recipe.epochs or sum(steps) < recipe.least_steps:
        which, _ = grid(windows, hop=recipe.hop, seed=seed, epoch=len(steps))
        steps.append(-(-len(which) // recipe.batch_size))
    return steps


def _batch(
    windows: Windows, which: NDArray[np.intp], *, noise: float, seed: tuple[int, int], crew: WorkerGroup
) -> tuple[torch.Tensor, torch.Tensor]:
    """Give the features of this process's part of a batch, and the labels of all of it."""
    samples = windows.take(which)
    rng = np.random.Generator(np.random.SFC64(seed))
    samples += noise * rng.standard_normal(samples.shape, np.float32)
    labels = windows.labels[which].astype(np.int64)
    return torch.from_numpy(magnitudes(samples[crew.part(len(which))])), torch.from_numpy(labels)


def _learn(
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    features: torch.Tensor,
    labels: torch.Tensor,
    *,
    recipe: Recipe,
    crew: WorkerGroup,
) -> float:
    optimiser.zero_grad(set_to_none=True)
    with torch.autocast("cpu", torch.bfloat16, enabled=recipe.precision == "bfloat16"):
        log_probabilities = network(features)
    weight = torch.tensor(recipe.class_weights)
    mine = labels[crew.part(len(labels))]
    loss = nn.functional.nll_loss(log_probabilities.float(), mine, weight=weight, reduction="sum")
    loss = loss / weight[labels].sum()
    loss.backward()  # type: ignore[no-untyped-call]  # torch has no types for it
    total = crew.add_up(network, loss)
    optimiser.step()
    return total


def _identity(windows: Windows, recipe: Recipe, *, seed: int, initial: Weights | None) -> str:
    total = hashlib.sha256(repr((asdict(recipe), seed)).encode())
    for array in (windows.signal, windows.starts, windows.labels, *(initial or {}).values()):
        total.update(np.ascontiguousarray(array).data)
    return total.hexdigest()
