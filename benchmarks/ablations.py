"""The paper's network with one choice undone, for `paper_tables.py ablations`: what its
authors tried.

At another rate or in other windows, without residual connections, or with each
channel's magnitudes divided by their norm. No model file holds such a network, so torch
runs it here.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch

from tactophone.core.errors import ConfigError
from tactophone.core.recordings.values import Recording
from tactophone.core.types import Touch
from tactophone_lab.evaluation.predict import Predictor, TakePredictions
from tactophone_lab.training.paper_network import (
    PaperNetwork,
    Windows,
    find_windows,
    magnitudes,
    window_loudness,
)
from tactophone_lab.training.recipe_options import (
    NETWORK_HOP,
    NETWORK_RATE,
    NETWORK_WINDOW_SIZE,
)
from tactophone_lab.training.recipes import RecipeFile
from tactophone_lab.training.tracks import read_signals
from tactophone_lab.training.trainer import NetworkRecipe, TrainingRun

CHANGES = ("rate", "window", "residual", "normalised")
"""What an ablation's file may hold beyond the entries of a recipe file."""


class AblatedNetwork(PaperNetwork):
    """The paper's network for windows of another size, without residual connections, or
    on normalised input."""

    def __init__(
        self, channels: int, *, bins: int, residual: bool, normalised: bool
    ) -> None:
        super().__init__(channels, bins=bins)
        self._channels, self._residual, self._normalised = (
            channels,
            residual,
            normalised,
        )

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        if self._normalised:
            each = features.reshape(len(features), self._channels, -1)
            features = (
                each / each.pow(2).sum(dim=2, keepdim=True).sqrt().clamp_min(1e-9)
            ).flatten(1)
        if self._residual:
            return super().forward(features)
        hidden = features
        for layer in (
            self.layer1,
            self.layer2,
            self.layer3,
            *self.layer_resnet,
            self.layer4,
            self.layer5,
        ):
            hidden = torch.relu(layer(hidden))
        return torch.log_softmax(self.linear(hidden), dim=-1)


@dataclass(frozen=True, slots=True)
class Ablation:
    """A method of `tactophone_lab.benchmark.folds`: a recipe of the paper's network,
    and what is undone."""

    recipe: NetworkRecipe
    rate: int = NETWORK_RATE
    """In Hz."""
    window: float = NETWORK_WINDOW_SIZE / NETWORK_RATE
    """In s."""
    residual: bool = True
    normalised: bool = False

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a recipe file with any of `CHANGES`; raises `ConfigError` unless it is
        of the paper's network."""
        entries = tomllib.loads(path.read_text())
        changes: dict[str, Any] = {
            name: entries.pop(name) for name in CHANGES if name in entries
        }
        recipe = RecipeFile().changed(entries, where=str(path)).configured()
        if not isinstance(recipe, NetworkRecipe):
            raise ConfigError(
                f"{path}: recipe {recipe.name}, but ablations change the paper's "
                "network: use paper-fast"
            )
        return cls(recipe, **changes)

    @property
    def name(self) -> str:
        found = (
            (f"{self.rate / 1000:g} kHz", self.rate != NETWORK_RATE),
            (
                f"windows of {1000 * self.window:g} ms",
                self.window != NETWORK_WINDOW_SIZE / NETWORK_RATE,
            ),
            ("no residual connections", not self.residual),
            ("normalised input", self.normalised),
        )
        return ", ".join(
            (self.recipe.name, *(name for name, differs in found if differs))
        )

    @property
    def identity(self) -> str:
        return (
            f"ablation {self.recipe.identity} "
            f"{[getattr(self, name) for name in CHANGES]}"
        )

    @property
    def size(self) -> int:
        """Samples of a window."""
        return round(self.window * self.rate)

    def network(self) -> AblatedNetwork:
        bins = self.size // 2 + 1
        return AblatedNetwork(
            self.recipe.channels,
            bins=bins,
            residual=self.residual,
            normalised=self.normalised,
        )

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        """Train; return a predictor at every 512 samples of 48 kHz, as live."""
        recipe = self.recipe
        signals = read_signals(
            recordings, channels=recipe.channels, rate=self.rate, codec=recipe.codec
        )
        labels = [recording.label or Touch.NONE for recording in recordings]
        windows = find_windows(
            signals, labels, rule=recipe.settings.labelling, size=self.size
        )
        run = TrainingRun(
            windows, recipe.settings, seed=recipe.seed, make_network=self.network
        )
        run.complete()
        threshold, hop = (
            recipe.effective_gate.threshold_dbfs,
            float(NETWORK_HOP) * self.rate / NETWORK_RATE,
        )

        def predict(recording: Recording) -> TakePredictions:
            (signal,) = read_signals(
                [recording], channels=recipe.channels, rate=self.rate
            )
            count = int((len(signal) - self.size) / hop) + 1
            starts = np.round(hop * np.arange(count)).astype(np.int32)
            taken = Windows(signal, starts, np.zeros(count, np.int8), self.size).take(
                np.arange(count)
            )
            with torch.no_grad():
                probabilities = (
                    run.network(magnitudes(torch.from_numpy(taken))).exp().numpy()
                )
            loud = window_loudness(signal[:, 0], "rms", self.size)[starts] >= 10 ** (
                threshold / 20
            )
            return TakePredictions(
                recording, (starts + self.size) / self.rate, probabilities, loud
            )

        return predict
