from pathlib import Path

import numpy as np
import onnx
import pytest

from tactophone.perception.model_file import FEATURES, Engine, read_model
from tactophone.perception.models import model_path
from tests.models import write_tiny_model


def test_each_run_uses_new_features(tmp_path: Path) -> None:
    session = read_model(write_tiny_model(tmp_path / "tiny.onnx")).session
    engine = Engine(session)
    for features in np.random.default_rng(0).exponential(1.0, (3, 257)).astype(np.float32):
        (expected,) = session.run(None, {FEATURES: features[None]})[0]
        (found,) = engine.run([features])
        assert found == pytest.approx(np.exp(expected))


@pytest.mark.parametrize("name", ["paper", "paper-mono"])
def test_eight_bits_at_run_time_hardly_change_the_papers_network(name: str) -> None:
    path = model_path(name)
    engine = Engine(read_model(path).session)
    rng = np.random.default_rng(0)
    width = 257 * (1 + (name == "paper"))
    differences = []
    for features in rng.exponential(1.0, (50, width)).astype(np.float32):
        features[13] *= rng.uniform(1, 100)  # mains hum: 50 Hz of 3.9 Hz a bin
        differences.append(np.abs(np.subtract(engine.run([features])[0], in_float(str(path), features))).max())
    assert np.mean(differences) < 0.02
    assert np.max(differences) < 0.2


def in_float(path: str, features: np.ndarray) -> np.ndarray:
    """Run the paper's network in float32, with the 8-bit weights of the file."""
    from tactophone.training.export import read_graph

    weights = read_graph(onnx.load(path))

    def linear(layer: str, value: np.ndarray) -> np.ndarray:
        return weights[f"{layer}.weight"] @ value + weights[f"{layer}.bias"]

    value = features
    for layer in ("layer1", "layer2", "layer3"):
        value = np.maximum(linear(layer, value), 0)
    for number in range(10):
        value = value + np.maximum(linear(f"layer_resnet.{number}", value), 0)
    for layer in ("layer4", "layer5"):
        value = np.maximum(linear(layer, value), 0)
    logits = linear("linear", value)
    exponentials = np.exp(logits - logits.max())
    return exponentials / exponentials.sum()


@pytest.mark.parametrize("name", ["texture", "stylus"])
def test_rows_together_are_what_each_is_alone(name: str) -> None:
    """Of ten rows in one call of the runtime, one in a thousand of the stylus' differs in its last bit."""
    engine = Engine(read_model(model_path(name)).session)
    tensors = onnx.load(str(model_path(name))).graph.initializer
    centre = next(onnx.numpy_helper.to_array(tensor) for tensor in tensors if tensor.name == "centre")
    random = np.random.default_rng(1)
    spread = random.standard_normal((20_000, engine.width)) * random.uniform(0.1, 3, (20_000, 1))
    rows = list((centre + spread).astype(np.float32))
    together = [each for start in range(0, len(rows), 10) for each in engine.run(rows[start : start + 10])]
    assert together == [engine.run([row])[0] for row in rows]
