import sys
from pathlib import Path

import numpy as np
import onnx
import pytest

from tactophone.perception.inference.litert import open_litert
from tactophone.perception.model_file import FEATURES, read_model
from tactophone.perception.model_registry import model_path
from tactophone.types import FloatArray
from tests.models import write_tiny_model

pytest.importorskip("ai_edge_litert")


def magnitudes(channels: int, count: int = 50) -> FloatArray:
    """Features of the size that real windows have: most bins small, a few large."""
    return (np.random.default_rng(0).exponential(1.0, (count, 257 * channels)) ** 2).astype(np.float32)


@pytest.mark.parametrize(("name", "channels"), [("paper", 2), ("paper-mono", 1)])
def test_it_answers_as_onnx_runtime_does(name: str, channels: int) -> None:
    model = read_model(model_path(name))
    engine = open_litert(model.content)
    assert engine is not None
    found = [engine.ask(row) for row in magnitudes(channels)]
    wanted = [np.exp(model.session.run(None, {FEATURES: row[None]})[0][0]) for row in magnitudes(channels)]
    assert np.abs(np.subtract(found, wanted)).max() < 0.05
    assert np.abs(np.subtract(found, wanted)).mean() < 0.005


def test_a_hum_does_not_drown_the_texture() -> None:
    model = read_model(model_path("paper"))
    engine = open_litert(model.content)
    assert engine is not None
    features = magnitudes(2, 1)[0]
    features[12] = 250.0
    (wanted,) = model.session.run(None, {FEATURES: features[None]})[0]
    assert engine.ask(features) == pytest.approx(np.exp(wanted), abs=0.05)


def test_digital_silence_is_judged_too() -> None:
    model = read_model(model_path("paper"))
    engine, silence = open_litert(model.content), np.zeros(514, np.float32)
    assert engine is not None
    (wanted,) = model.session.run(None, {FEATURES: silence[None]})[0]
    assert engine.ask(silence) == pytest.approx(np.exp(wanted), abs=0.01)


def test_it_says_nothing_on_standard_error(capfd: pytest.CaptureFixture[str]) -> None:
    assert open_litert(model_path("paper").read_bytes()) is not None
    assert capfd.readouterr() == ("", "")


def test_networks_of_others_are_left_to_onnx_runtime(tmp_path: Path) -> None:
    assert open_litert(write_tiny_model(tmp_path / "tiny.onnx").read_bytes()) is None


def test_a_weight_that_is_not_finite_is_left_to_onnx_runtime_to_show() -> None:
    model = onnx.load(str(model_path("paper-mono")))
    bias = next(one for one in model.graph.initializer if one.name == "layer2.bias")
    bias.CopyFrom(onnx.numpy_helper.from_array(np.full(512, np.inf, np.float32), bias.name))
    assert open_litert(model.SerializeToString()) is None


def test_without_the_package_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ai_edge_litert", None)
    assert open_litert(model_path("paper-mono").read_bytes()) is None
