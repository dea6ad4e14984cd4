import numpy as np
import onnxruntime
import pytest
import torch

from tactophone.perception import FEATURES
from tactophone.training.export import Storage, build_graph, read_graph
from tactophone.training.network import PaperNetwork, weights_of
from tactophone.types import FloatArray


def magnitudes(channels: int, count: int = 20) -> FloatArray:
    """Features of the size that real windows have: most bins small, a few large."""
    return (np.random.default_rng(0).exponential(1.0, (count, 257 * channels)) ** 2).astype(np.float32)


def run(model: bytes, features: FloatArray) -> FloatArray:
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    return np.concatenate([session.run(None, {FEATURES: row[None]})[0] for row in features])


@pytest.mark.parametrize("channels", [1, 2])
def test_onnx_agrees_with_torch(channels: int) -> None:
    network = PaperNetwork(channels=channels)
    features = magnitudes(channels)
    expected = network(torch.from_numpy(features)).detach().numpy()
    model = build_graph(weights_of(network), storage="float32").SerializeToString()
    assert run(model, features) == pytest.approx(expected, abs=1e-5)


def test_eight_bits_cost_a_quarter_and_almost_nothing_in_probability() -> None:
    network = PaperNetwork()
    features = magnitudes(2)
    expected = network(torch.from_numpy(features)).detach().exp().numpy()
    model = build_graph(weights_of(network), storage="int8").SerializeToString()
    assert len(model) < 2_000_000
    assert np.exp(run(model, features)) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("storage", "tolerance"), [("float32", 0.0), ("int8", 1 / 127)])
def test_weights_are_read_back(storage: Storage, tolerance: float) -> None:
    weights = weights_of(PaperNetwork(channels=1))
    read = read_graph(build_graph(weights, storage=storage))
    assert read.keys() == weights.keys()
    for name, array in weights.items():
        assert np.abs(read[name] - array).max() <= tolerance * np.abs(array).max()


def test_a_row_of_zeros_is_stored_as_zeros() -> None:
    weights = weights_of(PaperNetwork(channels=1))
    weights["layer1.weight"][0] = 0
    assert not read_graph(build_graph(weights, storage="int8"))["layer1.weight"][0].any()
