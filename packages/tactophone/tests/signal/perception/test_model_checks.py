"""Hostile model files: each is refused in words, or runs; none hangs, and none raises
anything but `ModelError`."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from tactophone.core.errors import ModelError
from tactophone.core.types import AudioBlock
from tactophone.signal.perception import model_file as checks
from tactophone.signal.perception.model_file import (
    CARD_KEY,
    CONTACT_INPUT,
    FEATURES,
    LOG_PROBABILITIES,
    SOUND,
    STATE,
    STATE_OUT,
    _session,
    read_model,
)
from tactophone.signal.perception.models import open_touch_detector
from tactophone.signal.perception.onnx_table import ModelField, check_graph
from tests.models import CARD, write_tiny_model


@pytest.fixture(autouse=True)
def tried_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Try each model in this process: a child takes a second, and has tests of its
    own."""
    monkeypatch.setattr(checks, "try_in_child", checks.probe_model)


SHARES = numpy_helper.from_array(
    np.log(np.array([[0.1, 0.1, 0.8]], np.float32)), "shares"
)
ENTRIES = json.loads(CARD.to_json())


def with_card(path: Path, card: str) -> Path:
    model = onnx.load(str(write_tiny_model(path)))
    helper.set_model_props(model, {CARD_KEY: card})
    onnx.save(model, str(path))
    return path


def with_nodes(
    path: Path,
    nodes: list[onnx.NodeProto],
    weights: list[onnx.TensorProto],
    *,
    width: Any = (1, 1, 512),
    output: str = LOG_PROBABILITIES,
    size: tuple[int, ...] = (1, 3),
) -> Path:
    graph = helper.make_graph(
        [*nodes, helper.make_node("Flatten", [SOUND], [FEATURES])],
        "hostile",
        [helper.make_tensor_value_info(SOUND, TensorProto.FLOAT, width)],
        [
            helper.make_tensor_value_info(output, TensorProto.FLOAT, size),
            helper.make_tensor_value_info(FEATURES, TensorProto.FLOAT, None),
        ],
        weights,
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9
    )
    helper.set_model_props(model, {CARD_KEY: CARD.to_json()})
    onnx.save(model, str(path))
    return path


HOSTILE_ENTRIES: list[dict[str, Any]] = [
    *(
        {"hop": hop}
        for hop in (
            "1/0",
            "1e400",
            "1e99999999",
            "0",
            "-1",
            "1/1000000",
            "inf",
            "20001",
            0,
            True,
            None,
        )
    ),
    {"hop": [1]},
    *({"sample_rate": rate} for rate in (0, 10**12, "2000", -1, 2000.5, True)),
    *({"window_size": size} for size in (0, -5, 10**12, 512.0)),
    *({"channels": count} for count in (0, 9, "2")),
    *(
        {"gate": gate}
        for gate in (5, {"threshold_dbfs": float("nan")}, {"threshold_dbfs": "x"}, {})
    ),
    *(
        {"decision": rule}
        for rule in ([], {"rough_on": float("nan")}, {"confirm": "many"})
    ),
    *({"name": name} for name in (5, "", "x" * 5000)),
    {"kind": "__class__"},
    {"kind": ["paper"]},
    {"settings": 5},
    {"licence": 5},
    {"foo": 1},
    {"training": "x"},
]


@pytest.mark.parametrize("changes", HOSTILE_ENTRIES, ids=str)
def test_every_number_of_a_card_has_bounds(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    path = with_card(tmp_path / "hostile.onnx", json.dumps(ENTRIES | changes))
    with pytest.raises(ModelError):
        open_touch_detector(str(path), sample_rate=48_000)


@pytest.mark.parametrize(
    "card",
    [
        '"x"',
        "[1]",
        "5",
        "null",
        "{}",
        '{"format":' + "[" * 200_000 + "}",
        json.dumps(ENTRIES).replace("512", "9" * 5000),
    ],
    ids=lambda card: card[:12],
)
def test_a_card_of_another_shape_is_refused(card: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="card cannot be used"):
        read_model(with_card(tmp_path / "hostile.onnx", card))


@pytest.mark.parametrize(
    ("part", "entry", "value"),
    [
        *(
            ("decision", "abstain_from", value)
            for value in ("x", None, True, -1.0, 3.0)
        ),
        *(("decision", "confirm", value) for value in (1e308, 2.5, 0, 10_000)),
        *(("decision", "rough_on", value) for value in ("x", 2.0)),
        *(("gate", "threshold_dbfs", value) for value in ("x", None, 5.0)),
        ("decision", "unheard_of", 1.0),
    ],
)
def test_a_number_of_the_card_that_no_model_has_is_refused(
    part: str, entry: str, value: object, tmp_path: Path
) -> None:
    """A run ended at its start by what `read_model` had taken."""
    card = json.dumps(ENTRIES | {part: ENTRIES[part] | {entry: value}})
    with pytest.raises(ModelError, match="card cannot be used"):
        read_model(with_card(tmp_path / "hostile.onnx", card))


def test_a_card_of_many_megabytes_is_refused(tmp_path: Path) -> None:
    path = with_card(
        tmp_path / "long.onnx", json.dumps({**ENTRIES, "licence": "x" * 2_000_000})
    )
    with pytest.raises(ModelError, match="characters"):
        read_model(path)


def test_metadata_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = write_tiny_model(tmp_path / "hostile.onnx")
    path.write_bytes(
        path.read_bytes().replace(b'"kind": "paper"', b'"kind": "\xff\xfe\xff\xfe\xff"')
    )
    with pytest.raises(ModelError):
        read_model(path)


def test_names_never_carry_escape_sequences(tmp_path: Path) -> None:
    entries = ENTRIES | {
        "name": "\x1b]0;title\x07[red]x",
        "scores": {"\x1b[2J": ["\x1b[31m"]},
        "licence": "a\nb\x00",
    }
    card = read_model(with_card(tmp_path / "hostile.onnx", json.dumps(entries))).card
    texts = (card.name, card.licence, str(card.scores))
    assert not any(char in text for text in texts for char in "\x1b\x07\x00")
    assert card.licence.startswith("a\nb")


def test_control_flow_is_refused_before_it_runs(tmp_path: Path) -> None:
    value = helper.make_tensor_value_info
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["go"], ["goes"]),
            helper.make_node("Identity", ["v"], ["w"]),
        ],
        "body",
        [
            value("i", TensorProto.INT64, []),
            value("go", TensorProto.BOOL, []),
            value("v", TensorProto.FLOAT, [1, 1]),
        ],
        [value("goes", TensorProto.BOOL, []), value("w", TensorProto.FLOAT, [1, 1])],
    )
    steps = numpy_helper.from_array(np.array(2**62, np.int64), "steps")
    true = numpy_helper.from_array(np.array(True), "true")
    nodes = [
        helper.make_node("ReduceMax", [SOUND], ["most"], axes=[1, 2], keepdims=0),
        helper.make_node("Loop", ["steps", "true", "most"], ["last"], body=body),
        helper.make_node("Add", ["last", "shares"], [LOG_PROBABILITIES]),
    ]
    with pytest.raises(ModelError, match="control flow \\(Loop\\)"):
        read_model(with_nodes(tmp_path / "loop.onnx", nodes, [steps, true, SHARES]))


def test_an_operator_of_any_name_with_a_graph_of_its_own_is_refused(
    tmp_path: Path,
) -> None:
    """As the runtime's searches for sequences, which run a graph as often as their
    inputs say."""
    value = helper.make_tensor_value_info
    body = helper.make_graph(
        [helper.make_node("Identity", ["v"], ["w"])],
        "body",
        [value("v", TensorProto.FLOAT, [1])],
        [value("w", TensorProto.FLOAT, [1])],
    )
    node = helper.make_node(
        "BeamSearch", [SOUND], [LOG_PROBABILITIES], domain="com.microsoft", decoder=body
    )
    with pytest.raises(ModelError, match="a graph of its own \\(BeamSearch\\)"):
        read_model(with_nodes(tmp_path / "search.onnx", [node], []))


@pytest.mark.parametrize(
    "location", ["secret", "./secret", "../../../../etc/passwd", "/dev/zero"]
)
def test_weights_in_another_file_are_refused(
    location: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("secret").write_bytes(bytes(12))
    outside = TensorProto(name="shares", data_type=TensorProto.FLOAT, dims=[1, 3])
    outside.data_location = TensorProto.EXTERNAL
    for key, entry in (("location", location), ("offset", "0"), ("length", "12")):
        outside.external_data.add(key=key, value=entry)
    for weights, nodes in (
        ([outside], ADD),
        ([], [helper.make_node("Constant", [], ["shares"], value=outside), *ADD]),
    ):
        with pytest.raises(ModelError, match="weights lie in another file"):
            read_model(with_nodes(tmp_path / "hostile.onnx", nodes, weights))


def test_sparse_weights_are_refused_before_they_are_filled(tmp_path: Path) -> None:
    sparse = helper.make_sparse_tensor(
        numpy_helper.from_array(np.ones(1, np.float32), "sparse"),
        numpy_helper.from_array(np.zeros(1, np.int64), "places"),
        [2**40],
    )
    constant = helper.make_node("Constant", [], ["big"], sparse_value=sparse)
    with pytest.raises(ModelError, match="sparse constant"):
        read_model(with_nodes(tmp_path / "constant.onnx", [constant, *ADD], [SHARES]))
    path = with_nodes(tmp_path / "weights.onnx", ADD, [SHARES])
    model = onnx.load(str(path))
    model.graph.sparse_initializer.append(sparse)
    path.write_bytes(model.SerializeToString())
    with pytest.raises(ModelError, match="sparse weights"):
        read_model(path)


@pytest.mark.parametrize("count", [2_001, 50_000])
def test_a_graph_of_thousands_of_operators_is_refused_before_it_is_loaded(
    count: int, tmp_path: Path
) -> None:
    chain = [
        helper.make_node("Add", [f"c{step}", f"c{step}"], [f"c{step + 1}"])
        for step in range(count)
    ]
    zero = numpy_helper.from_array(np.zeros((1, 3), np.float32), "c0")
    with pytest.raises(ModelError, match="over 2000 operators"):
        read_model(with_nodes(tmp_path / "chain.onnx", [*chain, *ADD], [SHARES, zero]))


def test_an_operator_with_a_list_of_graphs_is_refused(tmp_path: Path) -> None:
    body = helper.make_graph([], "body", [], [])
    node = helper.make_node("Any", [SOUND], ["x"], domain="else", bodies=[body, body])
    with pytest.raises(ModelError, match="a graph of its own \\(Any\\)"):
        read_model(with_nodes(tmp_path / "graphs.onnx", [node, *ADD], [SHARES]))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", [np.float16, np.float32, np.float64])
def test_weights_that_are_not_finite_are_refused(
    bad: float, kind: type, tmp_path: Path
) -> None:
    weights = numpy_helper.from_array(np.array([0, bad, 0], kind), "unused")
    with pytest.raises(ModelError, match="not all finite"):
        read_model(with_nodes(tmp_path / "bad.onnx", ADD, [SHARES, weights]))
    listed = helper.make_tensor("listed", TensorProto.FLOAT, [1], [bad])
    with pytest.raises(ModelError, match="not all finite"):
        read_model(with_nodes(tmp_path / "bad.onnx", ADD, [SHARES, listed]))


def test_weights_of_another_size_than_they_claim_are_refused(tmp_path: Path) -> None:
    weights = numpy_helper.from_array(np.zeros(3, np.float32), "claims")
    weights.dims[:] = [2**40]
    with pytest.raises(ModelError, match="in 12 bytes"):
        read_model(with_nodes(tmp_path / "claims.onnx", ADD, [SHARES, weights]))


def test_the_runtimes_own_format_is_refused_though_it_may_parse_as_protocol_buffer(
    tmp_path: Path,
) -> None:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.add_session_config_entry("session.save_model_format", "ORT")
    options.optimized_model_filepath = str(tmp_path / "model.ort")
    options.log_severity_level = 3
    onnxruntime.InferenceSession(
        str(write_tiny_model(tmp_path / "model.onnx")),
        options,
        ["CPUExecutionProvider"],
    )
    content = (tmp_path / "model.ort").read_bytes()
    assert content[4:8] == b"ORTM"
    with pytest.raises(ModelError, match="not a whole ONNX model"):
        read_model(tmp_path / "model.ort")
    with pytest.raises(ModelError, match="not a whole ONNX model"):
        _session(
            tmp_path / "model.ort", content
        )  # what passes `check_graph` is refused by the runtime


def test_functions_are_refused() -> None:
    with pytest.raises(ValueError, match="functions"):
        check_graph(
            bytes(
                [
                    ModelField.FUNCTIONS << 3 & 0x7F | 2 | 0x80,
                    ModelField.FUNCTIONS >> 4,
                    0,
                ]
            )
        )


ADD = [
    helper.make_node("ReduceMax", [SOUND], ["most"], axes=[1, 2], keepdims=0),
    helper.make_node("Add", ["most", "shares"], [LOG_PROBABILITIES]),
]


@pytest.mark.parametrize(
    "width",
    [
        (1, 1, 2**40),
        (),
        (1, 512),
        ("fingers", "channels", "samples"),
        (2, 1, 512),
        (1, 1, 100),
        (1, 2, 512),
    ],
    ids=str,
)
def test_inputs_of_another_shape_are_refused(width: Any, tmp_path: Path) -> None:
    with pytest.raises(ModelError):
        open_touch_detector(
            str(with_nodes(tmp_path / "hostile.onnx", ADD, [SHARES], width=width)),
            sample_rate=48_000,
        )


def test_outputs_of_another_shape_or_name_are_refused(tmp_path: Path) -> None:
    four = numpy_helper.from_array(np.zeros((1, 4), np.float32), "shares")
    with pytest.raises(ModelError, match=r"\(1, 4\)"):
        read_model(with_nodes(tmp_path / "four.onnx", ADD, [four], size=(1, 4)))
    nodes = [helper.make_node("Identity", [SOUND], ["other"])]
    with pytest.raises(ModelError, match="output must be"):
        read_model(
            with_nodes(
                tmp_path / "named.onnx", nodes, [], output="other", size=(1, 1, 512)
            )
        )


def test_a_network_that_takes_all_memory_is_refused(tmp_path: Path) -> None:
    shape = numpy_helper.from_array(
        np.array([200_000, 200_000, 1_000], np.int64), "shape"
    )
    nodes = [
        helper.make_node("ConstantOfShape", ["shape"], ["big"]),
        helper.make_node("ReduceSum", ["big"], ["sum"], keepdims=0),
        helper.make_node("Add", ["sum", "shares"], [LOG_PROBABILITIES]),
    ]
    with pytest.raises(ModelError):
        read_model(with_nodes(tmp_path / "bomb.onnx", nodes, [shape, SHARES]))


def test_a_state_of_a_billion_numbers_is_refused_before_it_is_made(
    tmp_path: Path,
) -> None:
    state = helper.make_node("Identity", [STATE], [STATE_OUT])
    path = with_nodes(tmp_path / "state.onnx", [*ADD, state], [SHARES])
    model, size = onnx.load(str(path)), (1, 10**9)
    model.graph.input.append(
        helper.make_tensor_value_info(CONTACT_INPUT, TensorProto.FLOAT, (1,))
    )
    model.graph.input.append(
        helper.make_tensor_value_info(STATE, TensorProto.DOUBLE, size)
    )
    model.graph.output.append(
        helper.make_tensor_value_info(STATE_OUT, TensorProto.DOUBLE, size)
    )
    onnx.save(model, str(path))
    with pytest.raises(ModelError, match="its state has shape"):
        read_model(path)


@pytest.mark.parametrize("optimised", [False, True])
def test_an_inference_that_takes_too_long_is_ended(
    optimised: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of it is constant, so that the runtime would compute it while it loads, where
    nothing ends it."""
    monkeypatch.setattr(checks, "MODEL_PROBE_TIMEOUT", 0.05)
    size = 1_500
    nodes = [helper.make_node("Expand", ["one", "shape"], ["x0"])]
    nodes += [
        helper.make_node("MatMul", [f"x{k}", "x0"], [f"x{k + 1}"]) for k in range(200)
    ]
    nodes += [
        helper.make_node("ReduceMax", ["x200"], ["top"], keepdims=0),
        helper.make_node("ReduceMax", [SOUND], ["most"], axes=[1, 2], keepdims=0),
        helper.make_node("Mul", ["most", "top"], ["both"]),
        helper.make_node("Add", ["both", "shares"], [LOG_PROBABILITIES]),
    ]
    one = numpy_helper.from_array(np.full((1, 1), 1e-3, np.float32), "one")
    shape = numpy_helper.from_array(np.array([size, size], np.int64), "shape")
    if not optimised:
        monkeypatch.setattr(
            "tactophone.signal.perception.model_file._options", _unoptimised
        )
    with pytest.raises(ModelError, match="takes over"):
        read_model(with_nodes(tmp_path / "slow.onnx", nodes, [one, shape, SHARES]))


def _unoptimised() -> Any:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.graph_optimization_level = (
        onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    )
    return options


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_a_changed_file_gives_a_model_error_or_a_model_that_runs(
    data: st.DataObject,
) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = write_tiny_model(Path(folder) / "changed.onnx")
        content = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 4))):
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(
                st.integers(0, 255)
            )
        path.write_bytes(content)
        try:
            detector = open_touch_detector(str(path), sample_rate=48_000)
        except ModelError:
            return
        detector.push(AudioBlock(np.zeros((24_000, 1), np.float32), 48_000))


def test_a_model_that_is_slow_when_it_is_tried_is_refused_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A card of its own: a model that is open somewhere is not tried again.
    path = with_card(tmp_path / "slow.onnx", json.dumps(ENTRIES | {"name": "slow"}))
    monkeypatch.setattr(checks, "SLOWEST", 0.0)
    with pytest.raises(ModelError, match="too slow"):
        read_model(path)


def test_a_model_that_is_slow_in_the_run_ends_it_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = read_model(write_tiny_model(tmp_path / "slow.onnx"))
    monkeypatch.setattr(checks, "SLOWEST", 0.0)
    with pytest.raises(ModelError, match=r"too slow.*--model"):
        checks.Engine(model.session).run(
            np.ones((1, 1, 512), np.float32), [True], [np.zeros(0)]
        )


def test_shapes_that_depend_on_values_are_refused(tmp_path: Path) -> None:
    nodes = [
        helper.make_node("Greater", [SOUND, "half"], ["loud"]),
        helper.make_node("NonZero", ["loud"], ["places"]),
        helper.make_node("Cast", ["places"], ["numbers"], to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["numbers"], ["rows"], perm=[1, 0]),
        helper.make_node(
            "Concat", ["shares", "rows"], [LOG_PROBABILITIES], axis=0
        ),  # a row in silence
    ]
    path = with_nodes(
        tmp_path / "rows.onnx",
        nodes,
        [SHARES, numpy_helper.from_array(np.float32(0.5), "half")],
    )
    with pytest.raises(ModelError, match="size of its NonZero follows"):
        read_model(path)


@pytest.mark.parametrize("content", [b"\x80", b"\x0a\x80", b"\x3a\x02\x0a\xff"])
def test_a_file_that_ends_within_a_number_is_refused_in_words(content: bytes) -> None:
    with pytest.raises(ValueError, match="it ends within"):
        check_graph(content)


def test_weights_said_to_lie_elsewhere_are_refused_without_saying_where() -> None:
    tensor = onnx.TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[1])
    tensor.data_location = onnx.TensorProto.EXTERNAL
    model = onnx.ModelProto(graph=onnx.GraphProto(initializer=[tensor]))
    with pytest.raises(ValueError, match="another file"):
        check_graph(model.SerializeToString())


@pytest.mark.parametrize(
    ("operator", "weights"),
    [
        ("ConstantOfShape", []),
        ("Range", ["zero", "", "one"]),
        ("NonZero", []),
        ("Reshape", ["shares", ""]),
    ],
)
def test_an_operator_whose_size_follows_from_the_sound_is_refused(
    tmp_path: Path, operator: str, weights: list[str]
) -> None:
    """It is small for the sound of the trial, and takes gigabytes at a tap."""
    inputs = [name or "size" for name in weights] or ["size"]
    nodes = [
        helper.make_node("ReduceMax", [SOUND], ["most"], axes=[0, 1, 2], keepdims=1),
        helper.make_node("Cast", ["most"], ["size"], to=TensorProto.INT64),
        helper.make_node(operator, inputs, ["large"]),
        helper.make_node("Identity", ["shares"], [LOG_PROBABILITIES]),
    ]
    constants = [
        numpy_helper.from_array(np.array(value, np.int64), name)
        for name, value in (("zero", 0), ("one", 1))
    ]
    path = with_nodes(tmp_path / "tap.onnx", nodes, [*constants, SHARES])
    with pytest.raises(ModelError, match=f"size of its {operator} follows from"):
        read_model(path)


def test_a_weight_with_the_name_of_the_sound_makes_no_size_of_it_fixed(
    tmp_path: Path,
) -> None:
    """It would be the sound's value until one is given, which it is in every run."""
    nodes = [
        helper.make_node("ReduceMax", [SOUND], ["most"], axes=[0, 1, 2], keepdims=1),
        helper.make_node("Cast", ["most"], ["size"], to=TensorProto.INT64),
        helper.make_node("ConstantOfShape", ["size"], ["large"]),
        helper.make_node("Identity", ["shares"], [LOG_PROBABILITIES]),
    ]
    sound = numpy_helper.from_array(np.zeros((1, 1, 512), np.float32), SOUND)
    path = with_nodes(tmp_path / "tap.onnx", nodes, [sound, SHARES])
    with pytest.raises(ModelError, match="size of its ConstantOfShape follows from"):
        read_model(path)


def test_a_size_that_follows_from_shapes_and_weights_is_taken(tmp_path: Path) -> None:
    nodes = [
        helper.make_node("Shape", [SOUND], ["shape"]),
        helper.make_node("Mul", ["shape", "ones"], ["size"]),
        helper.make_node("ConstantOfShape", ["size"], ["zeros"]),
        helper.make_node("ReduceMax", ["zeros"], ["zero"], axes=[1, 2], keepdims=0),
        helper.make_node("Add", ["zero", "shares"], [LOG_PROBABILITIES]),
    ]
    ones = numpy_helper.from_array(np.ones(3, np.int64), "ones")
    assert read_model(with_nodes(tmp_path / "fixed.onnx", nodes, [ones, SHARES]))


def test_a_network_that_fails_at_some_sound_is_no_number_there(tmp_path: Path) -> None:
    """Row 1 of the shares is there for sound under full scale alone."""
    nodes = [
        helper.make_node("ReduceMax", [SOUND], ["most"], axes=[0, 1, 2], keepdims=0),
        helper.make_node("Div", ["most", "thousand"], ["part"]),
        helper.make_node("Cast", ["part"], ["row"], to=TensorProto.INT64),
        helper.make_node("Gather", ["shares", "row"], ["flat"], axis=0),
        helper.make_node("Reshape", ["flat", "shape"], [LOG_PROBABILITIES]),
    ]
    weights = [
        numpy_helper.from_array(np.array(1000.0, np.float32), "thousand"),
        numpy_helper.from_array(np.array([1, 3], np.int64), "shape"),
        SHARES,
    ]
    model = read_model(with_nodes(tmp_path / "rows.onnx", nodes, weights))
    engine = checks.Engine(model.session)
    quiet, huge = (np.full((1, 512), value, np.float32) for value in (0.1, 5e3))
    states = [engine.new_state()]
    assert engine.run([quiet], [True], states)[0][0][2] == pytest.approx(0.8)
    assert np.isnan(engine.run([huge], [True], states)[0][0]).all()
    assert engine.run([quiet], [True], states)[0][0][2] == pytest.approx(0.8)
