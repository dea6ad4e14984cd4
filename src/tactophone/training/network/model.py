"""The paper's network in torch, layer names as in its authors' published models.

Fifteen hidden layers: 1024, 512 and 256 wide, then ten of 256 with residual connections ``x + relu(W x + b)``, then
128 and 64; three outputs, log-softmax. On two channels it has 1,882,755 parameters (Pätzold et al. 2023, section
III-B; names from github.com/AIS-Bonn/Roughness_Sensing).
"""

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import torch
from torch import nn

from tactophone.types import FloatArray, Touch

Weights: TypeAlias = Mapping[str, FloatArray]
"""Each parameter by its torch name, such as ``layer_resnet.3.weight`` of shape ``(outputs, inputs)``."""

BINS = 257
"""Magnitudes a channel: the real FFT of 512 samples."""

RESIDUALS = 10


class PaperNetwork(nn.Module):
    """The paper's residual MLP, from spectral magnitudes to log-probabilities.

    Parameters
    ----------
    channels
        2 as in the paper, or 1 for its piezo-only variant.

    Examples
    --------
    >>> sum(parameter.numel() for parameter in PaperNetwork().parameters())
    1882755
    >>> PaperNetwork(channels=1)(torch.zeros(4, 257)).shape
    torch.Size([4, 3])
    """

    def __init__(self, channels: int = 2) -> None:
        super().__init__()
        self.layer1 = nn.Linear(BINS * channels, 1024)
        self.layer2 = nn.Linear(1024, 512)
        self.layer3 = nn.Linear(512, 256)
        self.layer_resnet = nn.ModuleList(nn.Linear(256, 256) for _ in range(RESIDUALS))
        self.layer4 = nn.Linear(256, 128)
        self.layer5 = nn.Linear(128, 64)
        self.linear = nn.Linear(64, len(Touch))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Return log-probabilities, shape ``(windows, 3)``, of magnitudes, shape ``(windows, 257 * channels)``."""
        hidden = torch.relu(self.layer1(features))
        hidden = torch.relu(self.layer2(hidden))
        hidden = torch.relu(self.layer3(hidden))
        for residual in self.layer_resnet:
            hidden = hidden + torch.relu(residual(hidden))
        hidden = torch.relu(self.layer4(hidden))
        hidden = torch.relu(self.layer5(hidden))
        return torch.log_softmax(self.linear(hidden), dim=-1)


def weights_of(network: nn.Module) -> dict[str, FloatArray]:
    """Return a copy of a network's parameters."""
    return {name: value.detach().float().numpy().copy() for name, value in network.state_dict().items()}


def with_weights(weights: Weights) -> PaperNetwork:
    """Build the network with these parameters, for as many channels as they were trained on.

    Raises `RuntimeError` if a layer is missing, unknown or of another shape; torch names it.
    """
    network = PaperNetwork(channels=channels_of(weights))
    network.load_state_dict({name: torch.from_numpy(np.array(value, np.float32)) for name, value in weights.items()})
    return network


def channels_of(weights: Weights) -> int:
    """Return the number of microphones that parameters were trained on."""
    return int(weights["layer1.weight"].shape[1]) // BINS
