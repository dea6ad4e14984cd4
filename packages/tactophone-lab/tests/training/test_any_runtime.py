"""The shipped models are standard ONNX: other runtimes compute what ours computes, and
viewers show what they are."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import onnx
import pytest

from tactophone import __version__
from tactophone.signal.perception.model_file import (
    CONTACT_INPUT,
    LOG_PROBABILITIES,
    SOUND,
    STATE,
    STATE_OUT,
    read_model,
)
from tactophone.signal.perception.models import model_path, shipped_models

WINDOWS = 8
"""In a row, with the state that each leaves for the next."""

Inputs = Mapping[str, Any]
Run = Callable[[Inputs], Mapping[str, Any]]


def reference(path: str) -> Run:
    """ONNX's own evaluator, in NumPy."""
    from onnx.reference import ReferenceEvaluator

    evaluator = ReferenceEvaluator(onnx.load(path))

    def run(inputs: Inputs) -> Mapping[str, Any]:
        return dict(
            zip(evaluator.output_names, evaluator.run(None, dict(inputs)), strict=True)
        )

    return run


def openvino(path: str) -> Run:
    """Intel's runtime, in float32: by itself it may round to fewer bits."""
    library = pytest.importorskip("openvino")
    exact = {
        "INFERENCE_PRECISION_HINT": "f32",
        "DYNAMIC_QUANTIZATION_GROUP_SIZE": "0",
    }
    compiled = library.Core().compile_model(path, "CPU", exact)
    names = [output.any_name for output in compiled.outputs]

    def run(inputs: Inputs) -> Mapping[str, Any]:
        found = compiled(dict(inputs))
        return {name: np.array(found[name]) for name in names}

    return run


def onnx_runtime(path: str) -> Run:
    """The runtime of the live side."""
    import onnxruntime

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]

    def run(inputs: Inputs) -> Mapping[str, Any]:
        return dict(zip(names, session.run(names, dict(inputs)), strict=True))

    return run


def probabilities(run: Run, name: str) -> Any:
    """Return what a runtime makes of windows of noise that grows louder."""
    card = read_model(model_path(name)).card
    graph = onnx.load(str(model_path(name))).graph
    shapes = {
        value.name: [each.dim_value for each in value.type.tensor_type.shape.dim]
        for value in graph.input
    }
    noise = np.random.default_rng(0)
    state = np.zeros((1, *shapes.get(STATE, [1, 0])[1:]))
    found = []
    for window in range(WINDOWS):
        shape = (1, card.channels, card.window_size)
        sound = noise.normal(scale=0.02 * (1 + window), size=shape)
        inputs = {
            SOUND: sound.astype(np.float32),
            CONTACT_INPUT: np.ones(1, np.float32),
            STATE: state,
        }
        outputs = run({name: inputs[name] for name in shapes})
        state = outputs.get(STATE_OUT, state)
        found.append(np.exp(outputs[LOG_PROBABILITIES][0]))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_models())
@pytest.mark.parametrize("runtime", [reference, openvino])
def test_another_runtime_computes_the_same(
    runtime: Callable[[str], Run], name: str
) -> None:
    """In float32, all agree to the fifth digit. ONNX Runtime rounds the inputs of the
    paper's layers to 8 bits."""
    path = str(model_path(name))
    within = 0.05 if read_model(model_path(name)).card.kind == "paper" else 1e-4
    there = probabilities(runtime(path), name)
    assert there == pytest.approx(probabilities(onnx_runtime(path), name), abs=within)
    if runtime is not reference:
        expected = probabilities(reference(path), name)
        assert there == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("name", shipped_models())
def test_a_model_holds_standard_operators_alone(name: str) -> None:
    model = onnx.load(str(model_path(name)))
    onnx.checker.check_model(model, full_check=True)
    assert {entry.domain for entry in model.opset_import} == {""}
    assert {node.domain for node in model.graph.node} == {""}


@pytest.mark.parametrize("name", shipped_models())
def test_a_viewer_shows_what_a_model_is(name: str) -> None:
    model = onnx.load(str(model_path(name)))
    card = read_model(model_path(name)).card
    assert (model.producer_name, model.producer_version) == ("tactophone", __version__)
    assert model.model_version == 2
    assert model.doc_string
    assert model.graph.name == name
    assert str(card.sample_rate) in model.graph.doc_string
    assert all(each.doc_string for each in (*model.graph.input, *model.graph.output))
    shown = {entry.key: entry.value for entry in model.metadata_props}
    assert shown["kind"] == card.kind
    assert shown["classes"] == "none, smooth, rough"
    assert shown["licence"] == card.licence


@pytest.mark.parametrize("name", ["paper", "paper-mono"])
def test_onnx_runtime_multiplies_the_bytes_as_they_are(
    name: str, tmp_path: Any
) -> None:
    """Else an update takes three times as long."""
    import onnxruntime

    if tuple(map(int, onnxruntime.__version__.split(".")[:2])) < (1, 26):
        pytest.skip("ONNX Runtime before 1.26 computes in float32")
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 4
    options.optimized_model_filepath = str(tmp_path / "optimised.onnx")
    onnxruntime.InferenceSession(str(model_path(name)), options)
    graph = onnx.load(options.optimized_model_filepath).graph
    assert sum(node.op_type == "MatMulNBits" for node in graph.node) == 15
