"""A small convolutional network on log spectrograms, as used for the noise of tyres on road surfaces."""

import numpy as np
import onnx
import torch
from onnx import NodeProto, helper
from torch import nn

from tactophone.perception.model_file import FEATURES
from tactophone.training.export import build_known
from tactophone.training.recipes import BAND_COUNT
from tactophone.training.sets import TrainingSet

MAPS = (16, 32)
KERNEL = 3
STEPS, BATCH_SIZE, LEARNING_RATE = 400, 128, 2e-3


class SpectrogramNetwork(nn.Module):
    """Two convolutions, each followed by 2x2 max pooling; then the mean over time and bands, and one logit."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, MAPS[0], KERNEL, padding=1)
        self.second = nn.Conv2d(MAPS[0], MAPS[1], KERNEL, padding=1)
        self.last = nn.Linear(MAPS[1], 1)

    def forward(self, spectrograms: torch.Tensor) -> torch.Tensor:
        """Return logits, shape ``(windows,)``, of spectrograms, shape ``(windows, channels, bands, columns)``."""
        for layer in (self.first, self.second):
            spectrograms = torch.max_pool2d(torch.relu(layer(spectrograms)), 2)
        logits: torch.Tensor = self.last(spectrograms.mean(dim=(2, 3)))[:, 0]
        return logits


def build_scalogram(training_set: TrainingSet, *, seed: int = 0) -> onnx.ModelProto:
    examples = training_set.examples.thinned()
    centre, scale = float(examples.features.mean()), float(examples.features.std())
    shape = (
        -1,
        training_set.spec.channels,
        BAND_COUNT,
        examples.features.shape[1] // training_set.spec.channels // BAND_COUNT,
    )
    spectrograms = torch.from_numpy((examples.features - centre) / scale).float().reshape(shape)
    weights = torch.from_numpy(examples.weights()).float()
    network = _train(spectrograms, torch.from_numpy(examples.rough).float(), weights, seed=seed)
    return _graph(network, shape, centre=centre, scale=scale)


def _train(spectrograms: torch.Tensor, rough: torch.Tensor, weights: torch.Tensor, *, seed: int) -> SpectrogramNetwork:
    rng = np.random.default_rng(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = SpectrogramNetwork(spectrograms.shape[1])
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=1e-2)
    loss_of = nn.functional.binary_cross_entropy_with_logits
    for _ in range(STEPS):
        which = torch.from_numpy(rng.integers(len(spectrograms), size=BATCH_SIZE))
        loss = loss_of(network(spectrograms[which]), rough[which], weight=weights[which])
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]  # torch has no types for it
        optimiser.step()
    return network.eval()


def _graph(network: SpectrogramNetwork, shape: tuple[int, ...], *, centre: float, scale: float) -> onnx.ModelProto:
    tensors = {name: value.detach().numpy() for name, value in network.named_parameters()}
    tensors |= {"shape": np.array(shape), "centre": np.array(centre), "scale": np.array(scale)}
    nodes = [
        helper.make_node("Sub", [FEATURES, "centre"], ["centred"]),
        helper.make_node("Div", ["centred", "scale"], ["standard"]),
        helper.make_node("Reshape", ["standard", "shape"], ["spectrogram"]),
        *_layer("first", "spectrogram"),
        *_layer("second", "first:pooled"),
        helper.make_node("GlobalAveragePool", ["second:pooled"], ["mean"]),
        helper.make_node("Flatten", ["mean"], ["maps"]),
        helper.make_node("Gemm", ["maps", "last.weight", "last.bias"], ["logit"], transB=1),
    ]
    return build_known(nodes, tensors, features=int(np.prod(shape[1:])))


def _layer(name: str, before: str) -> list[NodeProto]:
    return [
        helper.make_node("Conv", [before, f"{name}.weight", f"{name}.bias"], [f"{name}:out"], pads=[1, 1, 1, 1]),
        helper.make_node("Relu", [f"{name}:out"], [f"{name}:relu"]),
        helper.make_node("MaxPool", [f"{name}:relu"], [f"{name}:pooled"], kernel_shape=[2, 2], strides=[2, 2]),
    ]
