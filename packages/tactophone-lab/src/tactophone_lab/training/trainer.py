"""Trains the paper's network from a data set to a model file, with checkpoints.

The network's arithmetic takes 97 % of a batch's time. So the levers are fewer windows,
and matrix products in oneDNN's kernels (docs/guide/training.md).
"""

import hashlib
import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from tactophone.core.errors import DatasetError, ModelError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import FloatArray, Touch, ignore
from tactophone.net.link.codec import Codec
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import Gate
from tactophone_lab.training.onnx_export import (
    Weights,
    caveats_of,
    channels_of,
    licence_of,
    make_card,
    read_weights,
    write_model,
)
from tactophone_lab.training.paper_network import (
    PaperNetwork,
    Windows,
    batches,
    find_windows,
    grid,
    magnitudes,
    weights_of,
    with_weights,
)
from tactophone_lab.training.recipe_options import (
    FAST_CHANGES,
    LABEL_LEVEL_DBFS,
    OPEN_GATE,
    REFERENCE_GATE,
    NetworkSettings,
    Precision,
    Recipe,
    Report,
    TrainingOptions,
    network_settings,
)
from tactophone_lab.training.tracks import read_signals

CHECKPOINT_EVERY = 10.0
"""Seconds between checkpoints, so the most that a kill costs; writing one of 22 MB
takes about 0.05 s."""

_SMOOTHING = 0.98
"""Weight of the past in the loss shown: about the last 50 batches."""


FEW_BATCHES = 150
"""Fewer end far from convergence: the loss still falls steeply
(docs/guide/training.md)."""

CPU_FLAGS = Path("/proc/cpuinfo")
"""Where Linux names the processor's instructions."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Batches done and in total; ``loss`` is averaged over about the last 50
    batches."""

    steps: int
    total: int
    loss: float


class TrainingRun:
    """A training run: each iteration trains on one batch.

    The same windows, recipe, seed and number of threads give the same bits on the same
    machine, whether the run was interrupted or not. The seed draws the first
    parameters, unless there are ``initial`` ones, the order of the windows and the
    noise. Where ``checkpoint_path`` holds a checkpoint of this very run, the run
    continues from it. ``make_network`` makes another network than the paper's.

    ``network`` is that after the last batch.
    """

    def __init__(
        self,
        windows: Windows,
        settings: NetworkSettings,
        *,
        seed: int = 0,
        checkpoint_path: Path | None = None,
        initial: Weights | None = None,
        make_network: Callable[[], PaperNetwork] | None = None,
    ) -> None:
        torch.set_float32_matmul_precision(float32_products())
        torch.use_deterministic_algorithms(True)
        torch.set_flush_denormal(True)
        self._windows = windows
        self._settings = settings
        self._seed = seed
        self._path = checkpoint_path
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            new = make_network or partial(PaperNetwork, settings.channels)
            self.network = with_weights(initial) if initial else new()
        self._optimiser = torch.optim.Adam(
            self.network.parameters(), lr=settings.learning_rate, fused=True
        )
        self._identity = _identity(windows, settings, seed=seed, initial=initial)
        self._skip = self._restore()

    def __iter__(self) -> Iterator[Progress]:
        windows = self._windows
        settings = self._settings
        seed = self._seed
        epochs = _epoch_sizes(windows, settings, seed)
        loss = float("nan")
        written = time.monotonic()
        step = 0
        for epoch in range(len(epochs)):
            for which in batches(
                windows,
                hop=settings.hop,
                size=settings.batch_size,
                seed=seed,
                epoch=epoch,
            ):
                step += 1
                # A resumed run skips the steps of its checkpoint.
                if step <= self._skip:
                    continue
                new = self._train_batch(which, step - 1)
                loss = (
                    new
                    if np.isnan(loss)
                    else _SMOOTHING * loss + (1 - _SMOOTHING) * new
                )
                yield Progress(step, sum(epochs), loss)
                if self._path and time.monotonic() - written > CHECKPOINT_EVERY:
                    self._save(self._path, step)
                    written = time.monotonic()

    def complete(
        self, report: Callable[[Progress], None] = ignore
    ) -> dict[str, FloatArray]:
        """Train to the end, calling ``report`` after each batch; return the network's
        parameters."""
        for progress in self:
            report(progress)
        return weights_of(self.network)

    def _train_batch(self, which: NDArray[np.intp], step: int) -> float:
        samples = self._windows.take(which)
        # Random numbers need no state in a checkpoint: each step's follow from the seed
        # and the step's number.
        rng = np.random.Generator(np.random.SFC64((self._seed, step)))
        samples += self._settings.noise * rng.standard_normal(samples.shape, np.float32)
        labels = torch.from_numpy(self._windows.labels[which].astype(np.int64))
        self._optimiser.zero_grad(set_to_none=True)
        with torch.autocast(
            "cpu", torch.bfloat16, enabled=self._settings.precision == "bfloat16"
        ):
            log_probabilities = self.network(magnitudes(torch.from_numpy(samples)))
        weight = torch.tensor(self._settings.class_weights)
        loss = nn.functional.nll_loss(
            log_probabilities.float(), labels, weight=weight, reduction="sum"
        )
        loss = loss / weight[labels].sum()
        loss.backward()  # type: ignore[no-untyped-call]  # torch has no types for it
        self._optimiser.step()
        return float(loss.detach())

    def _save(self, path: Path, steps: int) -> None:
        """Write a checkpoint: what training changes, and after how many batches."""
        state = {
            "network": self.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
        }
        with atomic_write(path) as unfinished:
            torch.save(
                {"identity": self._identity, "steps": steps, **state}, unfinished
            )

    def _restore(self) -> int:
        """Continue from the checkpoint, if there is one; return the batches done before
        it.

        Raises `ModelError` if the file cannot be read, or belongs to another run.
        """
        if not self._path or not self._path.exists():
            return 0
        try:
            # Numbers, text and tensors alone: no code of the file runs.
            held = torch.load(self._path, weights_only=True)
            identity = held["identity"]
            steps = int(held["steps"])
        except (
            OSError,
            EOFError,
            RuntimeError,
            ValueError,
            TypeError,
            KeyError,
            pickle.UnpicklingError,
        ) as error:
            raise ModelError(
                f"{self._path}: not a checkpoint of Tactophone ({error}); delete it "
                "to start over"
            ) from error
        if identity != self._identity:
            raise ModelError(
                f"{self._path}: left by a run with another recipe, seed or data; "
                "delete it to start over, "
                "or repeat the former options to continue"
            )
        self.network.load_state_dict(held["network"])
        self._optimiser.load_state_dict(held["optimiser"])
        return steps


def _epoch_sizes(windows: Windows, settings: NetworkSettings, seed: int) -> list[int]:
    """Return the number of batches of each epoch that the settings ask for."""
    steps: list[int] = []
    while len(steps) < settings.epochs or sum(steps) < settings.least_steps:
        which, _ = grid(windows, hop=settings.hop, seed=seed, epoch=len(steps))
        steps.append(-(-len(which) // settings.batch_size))
    return steps


def _identity(
    windows: Windows, settings: NetworkSettings, *, seed: int, initial: Weights | None
) -> str:
    total = hashlib.sha256(repr((asdict(settings), seed)).encode())
    for array in (
        windows.signal,
        windows.starts,
        windows.labels,
        *(initial or {}).values(),
    ):
        total.update(np.ascontiguousarray(array).data)
    return total.hexdigest()


def fastest_precision() -> Precision:
    """Return bfloat16 where the processor multiplies in it, otherwise float32, which is
    then many times faster."""
    flags = _flags()
    return "bfloat16" if "avx512_bf16" in flags or "amx_bf16" in flags else "float32"


def float32_products() -> str:
    """Return torch's precision of products (``torch.set_float32_matmul_precision``)
    that is fast and still float32.

    ``medium`` sends them to oneDNN, twice as fast as torch's default on AMD; on
    processors with AMX it would round their inputs to bfloat16.
    """
    return "highest" if "amx_bf16" in _flags() else "medium"


def _flags() -> str:
    try:
        return CPU_FLAGS.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


@dataclass(frozen=True, slots=True)
class NetworkRecipe:
    """The paper's network with its options; see
    :class:`~tactophone_lab.training.recipes.ConfiguredRecipe`."""

    settings: NetworkSettings
    seed: int = 0
    """Of everything random."""
    codec: Codec | None = None
    """Codec that the sound passes through first, as it does on the link."""
    start: Path | None = None
    """Model file to continue from; random parameters by default."""
    gate: Gate | None = None
    """The contact gate of the model; by default the gate in the paper or in its
    reference code."""

    @property
    def name(self) -> str:
        return self.settings.name

    @property
    def channels(self) -> int:
        return self.settings.channels

    @property
    def identity(self) -> str:
        """Text that changes whenever the result may: key of cached results."""
        start = self.start.read_bytes() if self.start else b""
        return f"{self!r} {hashlib.sha256(start).hexdigest()}"

    @property
    def effective_gate(self) -> Gate:
        """The gate that the model will have: the paper's level, or its authors' test
        threshold."""
        return self.gate or (
            REFERENCE_GATE if self.settings.reference_code else Gate(LABEL_LEVEL_DBFS)
        )

    def read_windows(
        self, recordings: Sequence[Recording], *, report: Callable[[int], None] = ignore
    ) -> Windows:
        """Read labelled recordings and return the windows that the labelling keeps."""
        signals = read_signals(
            recordings, channels=self.channels, codec=self.codec, report=report
        )
        labels = [recording.label or Touch.NONE for recording in recordings]
        return find_windows(signals, labels, rule=self.settings.labelling)

    def fit(
        self,
        windows: Windows,
        *,
        checkpoint: Path | None = None,
        report: Callable[[Progress], None] = ignore,
    ) -> dict[str, FloatArray]:
        """Train on windows; see :class:`TrainingRun`.

        Raises `ModelError` if the model to continue from has another number of
        channels, and `DatasetError` if a new model would see windows of a single
        class.
        """
        initial = read_weights(self.start) if self.start else None
        if (
            initial is None
            and len(found := set(windows.labels.tolist()) - {Touch.NONE}) < 2
        ):
            names = " and ".join(Touch(label).name.lower() for label in found)
            raise DatasetError(
                f"contact was found on {names} surfaces alone; training needs rough "
                "and smooth ones: label and record "
                "more, or continue from a model (--from)"
            )
        if initial and channels_of(initial) != self.channels:
            raise ModelError(
                f"{self.start}: has {channels_of(initial)} channel(s), but the "
                f"variant {self.settings.variant} has "
                f"{self.channels}; start from another model or choose another variant"
            )
        run = TrainingRun(
            windows,
            self.settings,
            seed=self.seed,
            checkpoint_path=checkpoint,
            initial=initial,
        )
        return run.complete(report)

    def write(
        self, path: Path, weights: dict[str, FloatArray], dataset: Dataset
    ) -> None:
        """Write the model file, named after the file, with the facts of its
        training."""
        facts: dict[str, Any] = {
            "recipe": self.settings.name,
            "settings": asdict(self.settings),
            "seed": self.seed,
            "dataset": dataset.name,
            "surfaces": len(dataset.surfaces),
            "sha256": dataset.fingerprint,
        }
        if self.codec:
            facts["codec"] = (
                f"{self.codec.name}, {self.codec.bitrate_bps} bit/s, to "
                f"{self.codec.bandwidth:g} Hz"
            )
        if self.start:
            facts["start"] = self.start.name
        card = make_card(
            weights,
            name=path.stem,
            gate=self.effective_gate,
            licence=licence_of(dataset),
        )
        write_model(
            path, replace(card, scores=caveats_of(dataset), training=facts), weights
        )

    def train(
        self,
        path: Path,
        dataset: Dataset,
        *,
        checkpoint: Path | None = None,
        report: Report = ignore,
        log: Callable[[str], None] = ignore,
    ) -> None:
        """Train on a data set and write the model file."""
        count = len(dataset.recordings)
        windows = self.read_windows(
            dataset.recordings, report=lambda done: report(done, count, "reading")
        )
        log(f"{count} recordings, {len(dataset.surfaces)} surfaces: {windows}")

        settings = self.settings
        count = max(
            settings.least_steps,
            settings.epochs * -(-len(windows) // (settings.hop * settings.batch_size)),
        )
        if count < FEW_BATCHES:
            log(
                f"warning: {count} batches are too few to converge; raise "
                "least_steps, or lower batch_size"
            )

        def show(progress: Progress) -> None:
            report(progress.steps, progress.total, f"loss {progress.loss:.4f}")

        self.write(path, self.fit(windows, checkpoint=checkpoint, report=show), dataset)


def network_recipe(
    recipe: Recipe,
    options: TrainingOptions,
    *,
    start: Path | None = None,
    calibration: Calibration | None = None,
) -> NetworkRecipe:
    """Return ``paper`` or ``paper-fast`` with its options, which name a variant and
    change settings."""
    names = ("epochs", "least_steps", "batch_size", "hop", "learning_rate", "noise")
    changes = {
        name: value for name in names if (value := getattr(options, name)) is not None
    }
    settings = replace(
        network_settings(options.variant, reference_code=options.reference_code),
        precision=options.precision,
        **{**(FAST_CHANGES if recipe.name == "paper-fast" else {}), **changes},
    )
    threshold = options.contact_threshold
    gate: Gate | None = None
    if threshold == "off":
        gate = OPEN_GATE
    elif threshold is not None:
        gate = Gate(threshold)
    if gate == OPEN_GATE:
        settings = replace(
            settings,
            labelling=replace(settings.labelling, threshold=0.0, relative=False),
        )
    if calibration:
        settings = settings.with_threshold(calibration.window_dbfs)
        gate = Gate(calibration.threshold_dbfs)
    return NetworkRecipe(
        settings, options.seed, options.codec(settings.channels), start, gate
    )
