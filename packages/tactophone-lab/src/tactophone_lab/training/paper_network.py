"""The paper's network in torch, layer names as in its authors' published models, and
the windows that it is trained on.

Fifteen hidden layers: 1024, 512 and 256 wide, then ten of 256 with residual connections
``x + relu(W x + b)``, then 128 and 64; three outputs, log-softmax. On two channels it
has 1,882,755 parameters (Pätzold et al. 2023, section III-C; names from
github.com/AIS-Bonn/Roughness_Sensing).

Training windows are indices into one shared signal. The authors' code copies every
window of 512 samples at a hop of one, 34 GB for their 70 minutes of sound. Here a
window is the index of its first sample; the loudness of all windows comes from one
running sum.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from torch import nn

from tactophone.core.errors import DatasetError
from tactophone.core.types import FloatArray, Touch
from tactophone.signal.perception.levels import LoudnessRule
from tactophone_lab.training.onnx_export import (
    RESIDUALS,
    SPECTRUM_BINS,
    Weights,
    channels_of,
)
from tactophone_lab.training.recipe_options import NETWORK_WINDOW_SIZE as SIZE
from tactophone_lab.training.recipe_options import Labelling


class PaperNetwork(nn.Module):
    """The paper's residual MLP, from spectral magnitudes to log-probabilities.

    ``channels`` are 2 as in the paper, or 1 for its piezo-only variant; each has as
    many magnitudes as ``bins``.

    >>> sum(parameter.numel() for parameter in PaperNetwork().parameters())
    1882755
    >>> PaperNetwork(channels=1)(torch.zeros(4, 257)).shape
    torch.Size([4, 3])
    """

    def __init__(self, channels: int = 2, *, bins: int = SPECTRUM_BINS) -> None:
        super().__init__()
        self.layer1 = nn.Linear(bins * channels, 1024)
        self.layer2 = nn.Linear(1024, 512)
        self.layer3 = nn.Linear(512, 256)
        self.layer_resnet = nn.ModuleList(nn.Linear(256, 256) for _ in range(RESIDUALS))
        self.layer4 = nn.Linear(256, 128)
        self.layer5 = nn.Linear(128, 64)
        self.linear = nn.Linear(64, len(Touch))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Return log-probabilities, shape ``(windows, 3)``, of magnitudes, shape
        ``(windows, 257 * channels)``."""
        hidden = torch.relu(self.layer1(features))
        hidden = torch.relu(self.layer2(hidden))
        hidden = torch.relu(self.layer3(hidden))
        for residual in self.layer_resnet:
            hidden = hidden + torch.relu(residual(hidden))
        hidden = torch.relu(self.layer4(hidden))
        hidden = torch.relu(self.layer5(hidden))
        return torch.log_softmax(self.linear(hidden), dim=-1)


def weights_of(network: nn.Module) -> dict[str, FloatArray]:
    return {
        name: value.detach().float().numpy().copy()
        for name, value in network.state_dict().items()
    }


def with_weights(weights: Weights) -> PaperNetwork:
    """Build the network with these parameters, for as many channels as they were
    trained on.

    Raises `RuntimeError` if a layer is missing, unknown or of another shape; torch
    names it.
    """
    network = PaperNetwork(channels=channels_of(weights))
    network.load_state_dict(
        {
            name: torch.from_numpy(np.array(value, np.float32))
            for name, value in weights.items()
        }
    )
    return network


def magnitudes(windows: torch.Tensor) -> torch.Tensor:
    """Return the magnitude of each channel's real FFT, ``(windows, 257 * channels)``;
    unnormalised.

    Windows have the shape ``(windows, samples, channels)``.
    """
    magnitudes: torch.Tensor = torch.fft.rfft(windows.mT).abs().flatten(1)
    return magnitudes


@dataclass(frozen=True, slots=True)
class Windows:
    """The training windows, as starts in the signal."""

    signal: FloatArray
    """All recordings concatenated at 2 kHz, float32, shape ``(samples, channels)``."""
    starts: NDArray[np.int32]
    """First sample of each window at a hop of one; no window crosses a recording's
    end."""
    labels: NDArray[np.int8]
    """A ``Touch`` for each start."""
    size: int = SIZE
    """Samples of a window."""

    def __len__(self) -> int:
        return len(self.starts)

    def __str__(self) -> str:
        shares = (
            f"{np.mean(self.labels == touch):.0%} {touch.name.lower()}"
            for touch in Touch
        )
        return f"{len(self)} windows, {', '.join(shares)}"

    def take(self, which: NDArray[np.intp]) -> FloatArray:
        """Copy the windows with these numbers: float32, shape ``(windows, size,
        channels)``."""
        views = sliding_window_view(self.signal, self.size, axis=0)
        return np.ascontiguousarray(views[self.starts[which]].transpose(0, 2, 1))


def find_windows(
    signals: Sequence[FloatArray],
    labels: Sequence[Touch],
    *,
    rule: Labelling,
    size: int = SIZE,
) -> Windows:
    """Return the windows of recordings, float32 ``(samples, channels)`` at 2 kHz, that
    a labelling keeps.

    Raises `DatasetError` if no window of a label is loud enough to count as contact.
    """
    loudness = [
        window_loudness(signal[:, 0], rule.loudness, size) for signal in signals
    ]
    thresholds = {
        touch: _threshold(touch, loudness, labels, rule) for touch in set(labels)
    }
    starts = []
    window_labels = []
    offset = 0
    for signal, touch, loud in zip(signals, labels, loudness, strict=True):
        contact = loud > thresholds[touch]
        # Starts are counted within the recording, then moved to its place in the
        # concatenated signal.
        kept = np.flatnonzero(contact | (rule.quiet_rough or touch is not Touch.ROUGH))
        starts.append((kept + offset).astype(np.int32))
        window_labels.append(np.where(contact[kept], touch, Touch.NONE).astype(np.int8))
        offset += len(signal)
    windows = Windows(
        np.concatenate(signals),
        np.concatenate(starts),
        np.concatenate(window_labels),
        size,
    )
    _require_contact(windows, labels, thresholds)
    return windows


def window_loudness(contact: FloatArray, kind: LoudnessRule, size: int) -> FloatArray:
    """Loudness of the window at each start, from one running sum in double
    precision."""
    power = (
        np.square(contact, dtype=np.float64)
        if kind == "rms"
        else np.abs(contact, dtype=np.float64)
    )
    total = np.concatenate([[0.0], np.cumsum(power)])
    mean: NDArray[np.float64] = np.maximum(total[size:] - total[:-size], 0) / size
    return np.asarray(np.sqrt(mean) if kind == "rms" else mean, np.float32)


def _threshold(
    touch: Touch,
    loudness: Sequence[FloatArray],
    labels: Sequence[Touch],
    rule: Labelling,
) -> float:
    if not rule.relative:
        return rule.threshold
    of_label = np.concatenate(
        [loud for loud, label in zip(loudness, labels, strict=True) if label is touch]
    )
    mean = (
        np.sqrt(np.mean(np.square(of_label)))
        if rule.loudness == "rms"
        else np.mean(of_label)
    )
    return float(rule.threshold * mean)


def _require_contact(
    windows: Windows, labels: Sequence[Touch], thresholds: dict[Touch, float]
) -> None:
    for touch in sorted(set(labels)):
        if not np.any(windows.labels == touch):
            level = 20 * np.log10(thresholds[touch])
            raise DatasetError(
                f"no window of the {touch.name.lower()} recordings is louder than "
                f"{level:.1f} dBFS, the "
                "threshold of contact; record louder, or use a threshold relative to "
                "the recordings "
                "(reference_code = true in a recipe file)"
            )


def grid(
    windows: Windows, *, hop: int, seed: int, epoch: int
) -> tuple[NDArray[np.intp], np.random.Generator]:
    """Return the windows of an epoch, a grid of starts at a random phase, and the
    generator that shuffles them."""
    rng = np.random.default_rng((seed, epoch))
    return np.flatnonzero(windows.starts % hop == rng.integers(hop)), rng


def batches(
    windows: Windows, *, hop: int, size: int, seed: int, epoch: int
) -> Iterator[NDArray[np.intp]]:
    """Yield an epoch's windows in shuffled batches; the same seed gives the same
    batches."""
    which, rng = grid(windows, hop=hop, seed=seed, epoch=epoch)
    rng.shuffle(which)
    for first in range(0, len(which), size):
        yield which[first : first + size]
