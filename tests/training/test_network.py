import numpy as np
import pytest
import torch

from tactophone.training.network import PaperNetwork, channels_of, weights_of, with_weights


def test_the_paper_counts_1882755_parameters() -> None:
    assert sum(parameter.numel() for parameter in PaperNetwork().parameters()) == 1_882_755


def test_the_layers_compute_what_the_paper_specifies() -> None:
    network = PaperNetwork(channels=1)
    weights = weights_of(network)
    hidden = np.random.default_rng(0).random((5, 257), np.float32)

    def layer(name: str, x: np.ndarray) -> np.ndarray:
        return x @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]

    features = torch.from_numpy(hidden)
    for name in ("layer1", "layer2", "layer3"):
        hidden = np.maximum(layer(name, hidden), 0)
    for number in range(10):
        hidden = hidden + np.maximum(layer(f"layer_resnet.{number}", hidden), 0)
    for name in ("layer4", "layer5"):
        hidden = np.maximum(layer(name, hidden), 0)
    logits = layer("linear", hidden)
    expected = logits - np.log(np.exp(logits).sum(axis=1, keepdims=True))
    assert network(features).detach().numpy() == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("channels", [1, 2])
def test_weights_survive_a_round_trip(channels: int) -> None:
    weights = weights_of(PaperNetwork(channels=channels))
    assert channels_of(weights) == channels
    again = weights_of(with_weights(weights))
    assert all(np.array_equal(weights[name], again[name]) for name in weights)


def test_a_missing_layer_is_named() -> None:
    weights = weights_of(PaperNetwork())
    del weights["layer4.bias"]
    with pytest.raises(RuntimeError, match=r"layer4\.bias"):
        with_weights(weights)
