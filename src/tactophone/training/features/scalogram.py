"""A small convolutional network on time-frequency pictures, as for the noise of tyres on road surfaces."""

import numpy as np
import onnx
import torch
from onnx import NodeProto, helper
from torch import nn

from tactophone.perception.features.bands import BANDS
from tactophone.perception.model_file import FEATURES
from tactophone.training.features.linear_classifier import even_weights
from tactophone.training.features.onnx_graph import answer_nodes, build
from tactophone.training.features.training_set import TrainingSet

MAPS = (16, 32)
KERNEL = 3
STEPS, BATCH_SIZE, LEARNING_RATE = 400, 128, 2e-3
KNOWN = -20.0
"""Logit of *unknown*: it never abstains."""


class PictureNetwork(nn.Module):
    """Two layers of convolutions, each halved by pooling; then the mean over the picture, and one logit."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(channels, MAPS[0], KERNEL, padding=1)
        self.second = nn.Conv2d(MAPS[0], MAPS[1], KERNEL, padding=1)
        self.last = nn.Linear(MAPS[1], 1)

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        """Give logits, shape ``(windows,)``, of pictures, shape ``(windows, channels, bands, columns)``."""
        for layer in (self.first, self.second):
            pictures = torch.max_pool2d(torch.relu(layer(pictures)), 2)
        logits: torch.Tensor = self.last(pictures.mean(dim=(2, 3)))[:, 0]
        return logits


def build_scalogram(lesson: TrainingSet, *, seed: int = 0) -> onnx.ModelProto:
    """Train the network on a lesson's pictures, and write its graph."""
    examples = lesson.examples.thinned()
    centre, scale = float(examples.features.mean()), float(examples.features.std())
    shape = (-1, lesson.ear.channels, BANDS, examples.features.shape[1] // lesson.ear.channels // BANDS)
    pictures = torch.from_numpy((examples.features - centre) / scale).float().reshape(shape)
    weigh = torch.from_numpy(even_weights(examples.rough, examples.surface)).float()
    network = _trained(pictures, torch.from_numpy(examples.rough).float(), weigh, seed=seed)
    return _graph(network, shape, centre=centre, scale=scale)


def _trained(pictures: torch.Tensor, rough: torch.Tensor, weigh: torch.Tensor, *, seed: int) -> PictureNetwork:
    rng = np.random.default_rng(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = PictureNetwork(pictures.shape[1])
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=1e-2)
    loss_of = nn.functional.binary_cross_entropy_with_logits
    for _ in range(STEPS):
        which = torch.from_numpy(rng.integers(len(pictures), size=BATCH_SIZE))
        loss = loss_of(network(pictures[which]), rough[which], weight=weigh[which])
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]  # torch has no types for it
        optimiser.step()
    return network.eval()


def _graph(network: PictureNetwork, shape: tuple[int, ...], *, centre: float, scale: float) -> onnx.ModelProto:
    tensors = {name: value.detach().numpy() for name, value in network.named_parameters()}
    tensors |= {"shape": np.array(shape), "centre": np.array(centre), "scale": np.array(scale)}
    tensors |= {"zero": np.zeros(1), "known": np.array([KNOWN])}
    nodes = [
        helper.make_node("Sub", [FEATURES, "centre"], ["centred"]),
        helper.make_node("Div", ["centred", "scale"], ["standard"]),
        helper.make_node("Reshape", ["standard", "shape"], ["picture"]),
        *_layer("first", "picture"),
        *_layer("second", "first:pooled"),
        helper.make_node("GlobalAveragePool", ["second:pooled"], ["mean"]),
        helper.make_node("Flatten", ["mean"], ["maps"]),
        helper.make_node("Gemm", ["maps", "last.weight", "last.bias"], ["logit"], transB=1),
        helper.make_node("Mul", ["logit", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "known"], ["unknown"]),
        *answer_nodes(logit="logit", unknown="unknown"),
    ]
    return build(nodes, tensors, features=int(np.prod(shape[1:])))


def _layer(name: str, before: str) -> list[NodeProto]:
    return [
        helper.make_node("Conv", [before, f"{name}.weight", f"{name}.bias"], [f"{name}:out"], pads=[1, 1, 1, 1]),
        helper.make_node("Relu", [f"{name}:out"], [f"{name}:relu"]),
        helper.make_node("MaxPool", [f"{name}:relu"], [f"{name}:pooled"], kernel_shape=[2, 2], strides=[2, 2]),
    ]
