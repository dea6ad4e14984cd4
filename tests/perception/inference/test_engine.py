from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest

from tactophone.perception.inference.engine import OnnxEngine, open_engine
from tactophone.perception.inference.litert import LiteRtEngine
from tactophone.perception.model_file import FEATURES, read_model
from tactophone.perception.model_registry import model_path
from tests.models import write_tiny_model


def test_onnx_runtime_is_asked_anew_each_time(tmp_path: Path) -> None:
    session = read_model(write_tiny_model(tmp_path / "tiny.onnx")).session
    engine = OnnxEngine(session)
    for features in np.random.default_rng(0).exponential(1.0, (3, 257)).astype(np.float32):
        (wanted,) = session.run(None, {FEATURES: features[None]})[0]
        assert engine.ask(features) == pytest.approx(np.exp(wanted))


def test_the_papers_network_runs_on_litert_where_it_is_installed() -> None:
    pytest.importorskip("ai_edge_litert")
    assert isinstance(open_engine(read_model(model_path("paper-mono"))), LiteRtEngine)


def test_an_engine_that_answers_otherwise_is_not_trusted() -> None:
    model = read_model(model_path("paper-mono"))
    other = onnx.load_from_string(model.content)
    bias = next(one for one in other.graph.initializer if one.name == "linear.bias")
    bias.CopyFrom(onnx.numpy_helper.from_array(np.array([50.0, 0.0, 0.0], np.float32), bias.name))
    assert isinstance(open_engine(replace(model, content=other.SerializeToString())), OnnxEngine)
