"""Trains the paper's network from a data set to a model file."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tactophone.dataset import Dataset, Recording
from tactophone.errors import DatasetError, ModelError
from tactophone.link import Codec
from tactophone.perception import Gate
from tactophone.training.network.export import make_card, read_weights, training_facts, write_model
from tactophone.training.network.model import channels_of
from tactophone.training.network.settings import (
    FAST_CHANGES,
    LABEL_LEVEL_DBFS,
    NETWORK_RATE,
    OPEN_GATE,
    REFERENCE_GATE,
    NetworkSettings,
    network_settings,
)
from tactophone.training.network.trainer import Progress, train
from tactophone.training.network.windows import Windows, find_windows
from tactophone.training.network.worker_group import init_distributed
from tactophone.training.provenance import caveats_of, licence_of
from tactophone.training.recipes import Recipe, Report, TrainingOptions, silent
from tactophone.training.sound import read_signals
from tactophone.types import FloatArray, Touch

FEW_BATCHES = 150
"""Fewer end far from convergence: the loss still falls steeply (docs/guide/training.md)."""


@dataclass(frozen=True, slots=True)
class NetworkJob:
    """A training run of the paper's network, without its recordings."""

    settings: NetworkSettings
    seed: int = 0
    """Of everything random."""
    codec: Codec | None = None
    """Codec that the sound passes through first, as it does on the link."""
    start: Path | None = None
    """Model file to continue from; random parameters by default."""
    gate: Gate | None = None
    """The contact gate of the model; by default that of the paper or of its reference code."""

    @property
    def name(self) -> str:
        """Name of the settings, for tables."""
        return self.settings.name

    @property
    def channels(self) -> int:
        """How many microphones the model uses."""
        return self.settings.channels

    @property
    def identity(self) -> str:
        """Text that changes whenever the result may: key of cached results."""
        start = self.start.read_bytes() if self.start else b""
        return f"{self!r} {hashlib.sha256(start).hexdigest()}"

    @property
    def effective_gate(self) -> Gate:
        """The gate that the model will have: the paper's level, or its authors' test threshold."""
        return self.gate or (REFERENCE_GATE if self.settings.reference_code else Gate(LABEL_LEVEL_DBFS))

    def read_windows(self, recordings: Sequence[Recording], *, report: Callable[[int], None] = silent) -> Windows:
        """Read labelled recordings and return the windows that the labelling keeps."""
        signals = read_signals(recordings, channels=self.channels, rate=NETWORK_RATE, codec=self.codec, report=report)
        labels = [recording.label or Touch.NONE for recording in recordings]
        return find_windows(signals, labels, rule=self.settings.labelling)

    def fit(
        self, windows: Windows, *, checkpoint: Path | None = None, report: Callable[[Progress], None] = silent
    ) -> dict[str, FloatArray]:
        """Train on windows; see :func:`tactophone.training.network.trainer.train`.

        Raises `ModelError` if the model to continue from has another number of channels, and `DatasetError` if the
        windows of a new model are of one class alone.
        """
        initial = read_weights(self.start) if self.start else None
        if initial is None and len(found := set(windows.labels.tolist()) - {Touch.NONE}) < 2:
            names = " and ".join(Touch(label).name.lower() for label in found)
            raise DatasetError(
                f"contact was found on {names} surfaces alone; training needs rough and smooth ones: label and record "
                "more, or continue from a model (--from)"
            )
        if initial and channels_of(initial) != self.channels:
            raise ModelError(
                f"{self.start}: has {channels_of(initial)} channel(s), but the variant {self.settings.variant} has "
                f"{self.channels}; start from another model or choose another variant"
            )
        return train(windows, self.settings, seed=self.seed, checkpoint_path=checkpoint, initial=initial, report=report)

    def write(self, path: Path, weights: dict[str, FloatArray], dataset: Dataset) -> None:
        """Write the model file, named after the file, with the facts of its training."""
        facts = training_facts(self.settings, seed=self.seed, dataset=dataset)
        if self.codec:
            facts["codec"] = f"{self.codec.name}, {self.codec.bitrate_bps} bit/s, to {self.codec.bandwidth:g} Hz"
        if self.start:
            facts["start"] = self.start.name
        card = make_card(weights, name=path.stem, gate=self.effective_gate, licence=licence_of(dataset))
        write_model(path, replace(card, scores=caveats_of(dataset), training=facts), weights)

    def train(
        self,
        path: Path,
        dataset: Dataset,
        *,
        checkpoint: Path | None = None,
        report: Report = silent,
        log: Callable[[str], None] = silent,
    ) -> bool:
        """Train on a data set and write the model file; see :class:`tactophone.training.recipes.Job`."""
        count = len(dataset.recordings)
        windows = self.read_windows(dataset.recordings, report=lambda done: report(done, count, "reading"))
        log(f"{count} recordings, {len(dataset.surfaces)} surfaces: {windows}")

        if (batches := _batches(self.settings, len(windows))) < FEW_BATCHES:
            log(f"beware: {batches} batches are too few to converge; raise --least-steps, or lower --batch-size")

        def show(progress: Progress) -> None:
            report(progress.steps, progress.total, f"loss {progress.loss:.4f}")

        weights = self.fit(windows, checkpoint=checkpoint, report=show)
        # Under torchrun all processes end with the same weights; one of them writes.
        if leads := init_distributed().leads:
            self.write(path, weights, dataset)
        return leads


def _batches(settings: NetworkSettings, windows: int) -> int:
    """Count the batches of a training: as many as the epochs have, and at least what the settings ask for."""
    return max(settings.least_steps, settings.epochs * -(-windows // (settings.hop * settings.batch_size)))


def network_job(recipe: Recipe, options: TrainingOptions) -> NetworkJob:
    """Return the job of the recipe ``paper`` or ``paper-fast``: the options name a variant and change settings."""
    changes = {**(FAST_CHANGES if recipe.name == "paper-fast" else {}), **options.changes}
    settings = replace(
        network_settings(options.variant, reference_code=options.reference_code), precision=options.precision, **changes
    )
    gate = options.gate
    if gate == OPEN_GATE:
        settings = settings.without_gate()
    if options.calibration:
        settings = settings.with_threshold(options.calibration.window_dbfs)
        gate = Gate(options.calibration.threshold_dbfs)
    return NetworkJob(settings, options.seed, options.codec(settings.channels), options.start, gate)
