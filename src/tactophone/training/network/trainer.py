"""The training loop: batches of views, features computed a batch at a time, checkpoints.

The network's arithmetic takes 97 % of a batch's time. So the levers are fewer windows, and matrix products in oneDNN's
kernels (docs/guide/training.md).
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

from tactophone.perception import magnitudes
from tactophone.training.network import checkpoint
from tactophone.training.network.checkpoint import Checkpoint
from tactophone.training.network.model import PaperNetwork, Weights, weights_of, with_weights
from tactophone.training.network.processor import float32_products
from tactophone.training.network.settings import NetworkSettings
from tactophone.training.network.windows import Windows, batches, grid
from tactophone.training.network.worker_group import WorkerGroup, init_distributed
from tactophone.types import FloatArray

CHECKPOINT_EVERY = 10.0
"""Seconds between checkpoints, so the most that a kill costs; writing one of 22 MB takes about 0.05 s."""

_SMOOTHING = 0.98
"""Weight of the past in the loss shown: about the last 50 batches."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Batches done and in total; ``loss`` is averaged over about the last 50 batches."""

    steps: int
    total: int
    loss: float


class Run:
    """A training run: each iteration trains on one batch.

    The same windows, recipe, seed and number of threads give the same bits on the same machine, whether the run was
    interrupted or not.

    Parameters
    ----------
    windows, settings
        Training data, and how to train.
    seed
        Of the first parameters, the order of windows and the noise.
    checkpoint_path
        Where to keep a checkpoint; if there is one of this very run, the run continues from it.
    initial
        Parameters to start from, instead of random ones.

    Attributes
    ----------
    network
        After the last batch.
    """

    def __init__(
        self,
        windows: Windows,
        settings: NetworkSettings,
        *,
        seed: int = 0,
        checkpoint_path: Path | None = None,
        initial: Weights | None = None,
    ) -> None:
        _prepare_torch()
        self._workers = init_distributed()
        self._windows, self._settings, self._seed, self._path = windows, settings, seed, checkpoint_path
        self.network = _network(settings, seed, initial)
        self._optimiser = torch.optim.Adam(self.network.parameters(), lr=settings.learning_rate, fused=True)
        self._identity = _identity(windows, settings, seed=seed, initial=initial)
        self._skip = self._restore()

    def __iter__(self) -> Iterator[Progress]:
        epochs = _epoch_sizes(self._windows, self._settings, self._seed)
        loss, written = float("nan"), time.monotonic()
        for step, which in self._schedule(len(epochs)):
            features, labels = _batch(
                self._windows, which, noise=self._settings.noise, seed=(self._seed, step), workers=self._workers
            )
            new = _train_batch(
                self.network, self._optimiser, features, labels, settings=self._settings, workers=self._workers
            )
            loss = new if np.isnan(loss) else _SMOOTHING * loss + (1 - _SMOOTHING) * new
            yield Progress(step + 1, sum(epochs), loss)
            if self._path and self._workers.leads and time.monotonic() - written > CHECKPOINT_EVERY:
                arrays = checkpoint.state_of(self.network, self._optimiser)
                checkpoint.save(self._path, Checkpoint(self._identity, step + 1, arrays))
                written = time.monotonic()

    def _restore(self) -> int:
        done = checkpoint.load(self._path, identity=self._identity) if self._path else None
        if done:
            checkpoint.restore(done, self.network, self._optimiser)
        return done.steps if done else 0

    def _schedule(self, epochs: int) -> Iterator[tuple[int, NDArray[np.intp]]]:
        settings, step = self._settings, 0
        for epoch in range(epochs):
            for which in batches(
                self._windows, hop=settings.hop, size=settings.batch_size, seed=self._seed, epoch=epoch
            ):
                # A resumed run skips the steps of its checkpoint.
                if step >= self._skip:
                    yield step, which
                step += 1


def train(
    windows: Windows,
    settings: NetworkSettings,
    *,
    seed: int = 0,
    checkpoint_path: Path | None = None,
    initial: Weights | None = None,
    report: Callable[[Progress], None] = lambda progress: None,
) -> dict[str, FloatArray]:
    """Complete a :class:`Run`, calling ``report`` after each batch; return the network's parameters."""
    run = Run(windows, settings, seed=seed, checkpoint_path=checkpoint_path, initial=initial)
    for progress in run:
        report(progress)
    return weights_of(run.network)


def _prepare_torch() -> None:
    torch.set_float32_matmul_precision(float32_products())
    torch.use_deterministic_algorithms(True)
    torch.set_flush_denormal(True)


def _network(settings: NetworkSettings, seed: int, initial: Weights | None) -> PaperNetwork:
    if initial is not None:
        return with_weights(initial)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return PaperNetwork(channels=settings.channels)


def _epoch_sizes(windows: Windows, settings: NetworkSettings, seed: int) -> list[int]:
    """Return the number of batches of each epoch that the settings ask for."""
    steps: list[int] = []
    while len(steps) < settings.epochs or sum(steps) < settings.least_steps:
        which, _ = grid(windows, hop=settings.hop, seed=seed, epoch=len(steps))
        steps.append(-(-len(which) // settings.batch_size))
    return steps


def _batch(
    windows: Windows, which: NDArray[np.intp], *, noise: float, seed: tuple[int, int], workers: WorkerGroup
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the features of this process's part of a batch, and the labels of the whole batch."""
    samples = windows.take(which)
    rng = np.random.Generator(np.random.SFC64(seed))
    samples += noise * rng.standard_normal(samples.shape, np.float32)
    labels = windows.labels[which].astype(np.int64)
    return torch.from_numpy(magnitudes(samples[workers.part(len(which))])), torch.from_numpy(labels)


def _train_batch(
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    features: torch.Tensor,
    labels: torch.Tensor,
    *,
    settings: NetworkSettings,
    workers: WorkerGroup,
) -> float:
    optimiser.zero_grad(set_to_none=True)
    with torch.autocast("cpu", torch.bfloat16, enabled=settings.precision == "bfloat16"):
        log_probabilities = network(features)
    weight = torch.tensor(settings.class_weights)
    mine = labels[workers.part(len(labels))]
    loss = nn.functional.nll_loss(log_probabilities.float(), mine, weight=weight, reduction="sum")
    loss = loss / weight[labels].sum()
    loss.backward()  # type: ignore[no-untyped-call]  # torch has no types for it
    total = workers.all_reduce(network, loss)
    optimiser.step()
    return total


def _identity(windows: Windows, settings: NetworkSettings, *, seed: int, initial: Weights | None) -> str:
    total = hashlib.sha256(repr((asdict(settings), seed)).encode())
    for array in (windows.signal, windows.starts, windows.labels, *(initial or {}).values()):
        total.update(np.ascontiguousarray(array).data)
    return total.hexdigest()
