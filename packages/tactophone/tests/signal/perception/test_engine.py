from pathlib import Path

import numpy as np
import onnx
import pytest

from tactophone.signal.perception.model_file import FEATURES, SOUND, Engine, read_model
from tactophone.signal.perception.models import model_path
from tests.models import classifier, write_tiny_model


def sounds(name: str, count: int) -> np.ndarray:
    card = read_model(model_path(name)).card
    random = np.random.default_rng(1)
    loud = 10 ** random.uniform(-4, -1, (count, 1, 1))
    return np.float32(
        loud * random.standard_normal((count, card.channels, card.window_size))
    )


def test_each_run_uses_new_sound(tmp_path: Path) -> None:
    session = read_model(write_tiny_model(tmp_path / "tiny.onnx")).session
    engine = Engine(session)
    for window in (
        np.random.default_rng(0).normal(0, 0.1, (3, 1, 512)).astype(np.float32)
    ):
        (expected,) = session.run(None, {SOUND: window[None]})[0]
        ((found, _),) = engine.run(window[None], [True], [engine.new_state()])
        assert found == pytest.approx(np.exp(expected))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "paper-mono"])
def test_eight_bits_at_run_time_hardly_change_the_papers_network(name: str) -> None:
    path = model_path(name)
    session = classifier(path)
    rng = np.random.default_rng(0)
    width = 257 * (1 + (name == "paper"))
    differences = []
    for features in rng.exponential(1.0, (50, width)).astype(np.float32):
        features[13] *= rng.uniform(1, 100)  # mains hum: 50 Hz of 3.9 Hz a bin
        found = np.exp(session.run(None, {FEATURES: features[None]})[0][0])
        differences.append(
            np.abs(np.subtract(found, in_float(str(path), features))).max()
        )
    assert np.mean(differences) < 0.02
    assert np.max(differences) < 0.2


def in_float(path: str, features: np.ndarray) -> np.ndarray:
    """Run the paper's network in float32, with the 8-bit weights of the file."""
    from tactophone_lab.training.onnx_export import read_graph

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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "within"), [("texture", 1e-5), ("stylus", 1e-5), ("paper", 0)]
)
def test_fingers_together_are_what_each_is_alone(name: str, within: float) -> None:
    engine = Engine(read_model(model_path(name)).session)
    together, alone = ([engine.new_state() for _ in range(10)] for _ in range(2))
    windows = sounds(name, 1000)
    for at in range(0, len(windows), 10):
        batch, contact = (
            windows[at : at + 10],
            [number % 7 != 0 for number in range(at, at + 10)],
        )
        found = [
            probabilities for probabilities, _ in engine.run(batch, contact, together)
        ]
        expected = [
            engine.run(batch[n : n + 1], contact[n : n + 1], alone[n : n + 1])[0][0]
            for n in range(len(batch))
        ]
        assert np.array(found) == pytest.approx(np.array(expected), abs=within)
