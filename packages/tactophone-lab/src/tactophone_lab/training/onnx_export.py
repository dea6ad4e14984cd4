"""Writes model files: ONNX graphs of the classifiers and the paper's network, with
their cards.

A model's graph is two joined: one from sound to features
(`tactophone_lab.training.features`; the paper's is here), and a classifier's, which
takes features and returns log-probabilities of none, smooth and rough. A channel whose
features are NaN is missing; the regression of the remaining channels is used. *None*
stands for sound unlike the training data.

The paper's network is written node by node: an exporter's graph is longer and harder to
quantise. Its weights may be stored in 8 bits, a scale for each output: ``W = int8 *
scale``. The graph says so in standard operators, `DequantizeLinear` in blocks and
`MatMul`, so that any runtime computes it, in float32. ONNX Runtime from 1.26 on makes
its own operator ``MatMulNBits`` of each pair while loading. That one multiplies the
bytes as they are, and reads a quarter of the memory that float32 takes. An update comes
every 10.67 ms, by when the weights have left the processor's caches, so that reading
them is most of its time. The operator rounds a layer's input to 8 bits too, block by
block, each by the block's own maximum. Blocks of the spectrum are short, 32 bins of 3.9
Hz, so that mains hum (under 125 Hz) does not round all other bins to zero.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, helper, numpy_helper

from tactophone.core.errors import ModelError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import FloatArray, Touch
from tactophone.core.version import __version__
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.model_file import (
    CARD_KEY,
    CLASSES,
    CONTACT_INPUT,
    FEATURES,
    FORMAT_VERSION,
    LOG_PROBABILITIES,
    SOUND,
    STATE,
    STATE_OUT,
    Gate,
    ModelCard,
    read_model,
)
from tactophone_lab.training.recipe_options import (
    NETWORK_HOP,
    NETWORK_RATE,
    NETWORK_WINDOW_SIZE,
)

Floats: TypeAlias = NDArray[np.float64]

Weights: TypeAlias = Mapping[str, FloatArray]
"""Each parameter of the paper's network by its torch name, such as
``layer_resnet.3.weight``, ``(outputs, inputs)``."""

Storage = Literal["int8", "float32"]

OPSET = 17
"""ONNX operator set, from 2022: every ONNX Runtime that the package admits reads it."""

IR_VERSION = 9
"""Version of the ONNX file format that goes with it."""

BLOCKED_OPSET = 21
"""ONNX operator set of the paper's network, from 2024: the first one whose
`DequantizeLinear` has a scale for each block. ONNX Runtime reads it since 1.18."""

BLOCKED_IR_VERSION = 10
"""Version of the file format that goes with it."""

UNTESTED = "none in training; untested, unless a score below names a real set"
"""What a card says about real sound if the training sound was simulated."""

SPECTRUM_BINS = 257
"""Magnitudes a channel that the paper's network takes: the real FFT of 512 samples."""

RESIDUALS = 10
"""Layers of the paper's network with a residual connection."""

STEEPNESS = 10.0
"""How fast sound becomes unknown around the limit: half known at it, 1 % at 1.5 times
the limit."""

KNOWN = -20.0
"""Logit of *unknown* for classifiers that never abstain."""

_BYTES = ":int8"
"""Suffix of the name of a weight stored in bytes, ``(inputs, outputs)``."""

_SCALE = ":scale"
"""Suffix of the name of a weight's scales in the file, one for each output."""

_SCALES = ":scales"
"""Suffix of the name of the same scales as the operator takes them, a row for each
block of inputs."""

_SPECTRUM_BLOCK = 32
"""Weights that share a scale in the layer that reads the spectrum."""

_BLOCK = 128
"""Weights that share a scale in all other layers."""

_FIRST = "layer1"
"""The layer that reads the spectrum."""

_LAST = "linear"
"""The last layer, 3 x 64 weights, stays in float32."""


def write_graph(path: Path, model: onnx.ModelProto, card: ModelCard) -> None:
    """Write a graph with its card, and the folder if needed; after a kill the file is
    the old or the new one."""
    describe(model, card)
    with atomic_write(path) as unfinished:
        onnx.save(model, str(unfinished))


DESCRIPTION = (
    "Says whether a fingertip touches nothing, something smooth or something rough, "
    "from one window of the sound of its microphones."
)
"""What a viewer shows of any of our models."""

TENSORS = {
    SOUND: "float32 (fingers, channels, window_size), from -1 to 1: the newest window; "
    "channel 0 is the contact microphone, channel 1 the air microphone",
    CONTACT_INPUT: "float32 (fingers): 1 if the window's level is over the threshold "
    "of contact, else 0",
    STATE: "float64 (fingers, size): zeros at first, then state_out",
    STATE_OUT: "float64 (fingers, size): the state for the next window",
    FEATURES: "what the classifier takes; needed by no caller",
    LOG_PROBABILITIES: "float32 (fingers, 3): natural logarithms of the probabilities "
    "of none, smooth and rough",
}
"""What a viewer shows of each input and output."""


def describe(model: onnx.ModelProto, card: ModelCard) -> None:
    """Write the card into a graph, and beside it what viewers such as Netron show."""
    model.producer_name = "tactophone"
    model.producer_version = __version__
    model.model_version = FORMAT_VERSION
    model.doc_string = DESCRIPTION
    model.graph.name = card.name
    model.graph.doc_string = (
        f"Kind {card.kind}: {card.window_size} samples of {card.sample_rate} Hz, "
        f"{card.channels} channels; a window every {float(card.hop):g} samples."
    )
    for value in (*model.graph.input, *model.graph.output):
        value.doc_string = TENSORS.get(value.name, "")
    properties = {
        "name": card.name,
        "kind": card.kind,
        "sample_rate": str(card.sample_rate),
        "window_size": str(card.window_size),
        "hop": str(card.hop),
        "channels": str(card.channels),
        "classes": ", ".join(CLASSES),
        "licence": card.licence,
        CARD_KEY: card.to_json(),
    }
    onnx.helper.set_model_props(model, properties)


def join(front: onnx.ModelProto, classifier: onnx.ModelProto) -> onnx.ModelProto:
    """Return the graph of a model file: from sound to features, then the classifier."""
    model = onnx.ModelProto()
    model.CopyFrom(classifier)
    graph = model.graph
    before = front.graph
    (features,) = classifier.graph.input
    nodes = [*before.node, *graph.node]
    del graph.node[:], graph.input[:]
    graph.node.extend(nodes)
    graph.initializer.extend(before.initializer)
    graph.input.extend(before.input)
    graph.output.append(features)
    # The first axis is the number of fingers, by the name that the front gives it, or
    # 1.
    fingers = before.input[0].type.tensor_type.shape.dim[0]
    for state in (each for each in before.input if each.name == STATE):
        graph.output.append(state)
        graph.output[-1].name = STATE_OUT
    for each in graph.output:
        each.type.tensor_type.shape.dim[0].CopyFrom(fingers)
    domains = {each.domain for each in model.opset_import}
    model.opset_import.extend(
        each for each in front.opset_import if each.domain not in domains
    )
    onnx.checker.check_model(model)
    return model


def magnitudes(channels: int) -> onnx.ModelProto:
    """Return the graph of the paper's features: the magnitude of each channel's real
    FFT, one after another."""
    tensors = {
        "rows": np.array([channels, NETWORK_WINDOW_SIZE, 1]),
        "length": np.array(NETWORK_WINDOW_SIZE),
        "flat": np.array([1, channels * SPECTRUM_BINS]),
        "parts": np.array([3]),  # real and imaginary
    }
    nodes = [
        helper.make_node("Reshape", [SOUND, "rows"], ["signals"]),
        helper.make_node("STFT", ["signals", "length", "", "length"], ["spectrum"]),
        helper.make_node("ReduceL2", ["spectrum", "parts"], ["magnitudes"], keepdims=0),
        helper.make_node("Reshape", ["magnitudes", "flat"], [FEATURES]),
    ]
    stored = [numpy_helper.from_array(value, name) for name, value in tensors.items()]
    return _checked(
        nodes,
        stored,
        (SOUND, (1, channels, NETWORK_WINDOW_SIZE)),
        (FEATURES, (1, channels * SPECTRUM_BINS)),
        blocked=True,
    )


def add_scores(path: Path, name: str, scores: Mapping[str, Any]) -> None:
    """Write scores into a model file's card under a name; scores of the same name are
    replaced."""
    card = read_model(path).card
    write_graph(
        path,
        onnx.load(str(path)),
        replace(card, scores={**card.scores, name: dict(scores)}),
    )


def add_settings(path: Path, settings: Mapping[str, Any]) -> None:
    """Write settings into a model file's card; those of the same name are replaced."""
    card = read_model(path).card
    write_graph(
        path,
        onnx.load(str(path)),
        replace(card, settings={**card.settings, **settings}),
    )


def set_decision(
    path: Path, rule: DecisionRule, scores: Mapping[str, Any], *, out: Path
) -> None:
    """Write a model file again with another decision rule; its scores go into the card
    as ``operating point``."""
    card = read_model(path).card
    scores = {**card.scores, "operating point": dict(scores)}
    write_graph(out, onnx.load(str(path)), replace(card, decision=rule, scores=scores))


def make_card(
    weights: Weights, *, name: str, gate: Gate, licence: str = ""
) -> ModelCard:
    channels = channels_of(weights)
    return ModelCard(
        name,
        "paper",
        NETWORK_RATE,
        NETWORK_WINDOW_SIZE,
        NETWORK_HOP,
        channels,
        gate,
        licence=licence,
    )


def write_model(
    path: Path, card: ModelCard, weights: Weights, *, storage: Storage = "int8"
) -> None:
    """Write a network and its card; after a kill the file is the old one or the new
    one, never half."""
    write_graph(
        path,
        join(magnitudes(channels_of(weights)), build_graph(weights, storage=storage)),
        card,
    )


def read_weights(path: Path) -> dict[str, FloatArray]:
    """Read the parameters of the paper's network from a model file, to continue
    training.

    Raises `ModelError` if the file holds no such network.
    """
    card = read_model(path).card
    if card.kind != "paper":
        raise ModelError(
            f"{path}: a model of kind {card.kind}, but training can continue from "
            "kind paper only"
        )
    return read_graph(onnx.load(str(path)))


def caveats_of(dataset: Dataset) -> dict[str, str]:
    """Return the entries that a card's scores begin with."""
    return (
        {"real sound": UNTESTED} if all(map(is_simulation, dataset.recordings)) else {}
    )


def licence_of(dataset: Dataset) -> str:
    """Return the licences of the training sound; whoever distributes the weights needs
    to know them."""
    if all(map(is_simulation, dataset.recordings)):
        return "BSD-3-Clause, as the package; trained on simulated sound alone"
    licences = sorted(
        {recording.known("licence") for recording in dataset.recordings} - {""}
    )
    sources = (
        "simulated sound and sound"
        if any(map(is_simulation, dataset.recordings))
        else "sound"
    )
    return (
        f"weights alone, no recordings; trained on {sources} under: "
        f"{'; '.join(licences)}"
        if licences
        else ""
    )


def is_simulation(recording: Recording) -> bool:
    return recording.known("source") == "simulated"


@dataclass(frozen=True, slots=True, eq=False)
class LinearClassifier:
    """Parameters of the classifier."""

    centre: Floats
    scale: Floats
    """`centre` and `scale`: of the features, which are standardised first."""
    weights: Floats
    biases: Floats
    """`weights` and `biases`: a logistic regression for each set of working channels,
    shape ``(sets, features)``: all, then each alone."""
    whitening: Floats
    """Shape ``(features, features)``: maps a channel's standardised features to
    uncorrelated ones of unit variance."""
    limit: float
    """Mean square of the working channels' whitened features over which sound is
    unknown."""


def build_classifier_graph(
    classifier: LinearClassifier, *, channels: int
) -> onnx.ModelProto:
    """Build the graph of the recipe ``texture``'s classifier."""
    count = len(classifier.centre)
    sets = len(classifier.biases)
    # Logits and whitened features are one matrix product; standardising is folded into
    # its weights.
    whitening = classifier.whitening * np.sqrt(STEEPNESS / classifier.limit / count)
    weights = np.hstack((classifier.weights.T, whitening)) / classifier.scale[:, None]
    tensors = {
        "centre": classifier.centre,
        "weights": weights,
        "biases": np.concatenate((classifier.biases, np.zeros(count)))
        - classifier.centre @ weights,
        "sizes": np.array([sets, count]),
        "firsts": np.arange(channels) * (count // channels),
        **_selection(channels),
        "steepness": np.array(STEEPNESS),
        "one": np.array([1]),
    }
    nodes = [
        *fill_missing("centre"),
        helper.make_node("Gemm", ["whole", "weights", "biases"], ["product"]),
        helper.make_node("Split", ["product", "sizes"], ["logits", "white"], axis=1),
        # A channel's first feature shows whether the channel is missing.
        helper.make_node("Gather", ["missing", "firsts"], ["missing:channels"], axis=1),
        helper.make_node("Cast", ["missing:channels"], ["gone"], to=TensorProto.FLOAT),
        helper.make_node("Gemm", ["gone", "votes", "votes:whole"], ["vote"]),
        helper.make_node("Relu", ["vote"], ["choice"]),
        helper.make_node("Mul", ["logits", "choice"], ["logits:chosen"]),
        helper.make_node("ReduceSum", ["logits:chosen", "one"], ["logit"], keepdims=1),
        helper.make_node(
            "ReduceSumSquare", ["white"], ["distance"], axes=[1], keepdims=1
        ),
        helper.make_node("MatMul", ["choice", "shares"], ["share"]),
        helper.make_node("Mul", ["distance", "share"], ["distance:working"]),
        helper.make_node("Sub", ["distance:working", "steepness"], ["unknown"]),
        *output_nodes(logit="logit", unknown="unknown"),
    ]
    return build(nodes, tensors, features=count)


def build_linear(centre: Floats, weights: Floats, bias: float) -> onnx.ModelProto:
    """Build the graph of a linear classifier, ``bias + (features - centre) @ weights``,
    that never abstains."""
    nodes = [
        *fill_missing("centre"),
        helper.make_node("Sub", ["whole", "centre"], ["off"]),
        helper.make_node("MatMul", ["off", "weights"], ["weighted"]),
        helper.make_node("Add", ["weighted", "bias"], ["logit"]),
    ]
    tensors = {"centre": centre, "weights": weights[:, None], "bias": np.array([bias])}
    return build_known(nodes, tensors, features=len(centre))


def build_known(
    nodes: Sequence[NodeProto],
    tensors: Mapping[str, NDArray[np.generic]],
    *,
    features: int,
) -> onnx.ModelProto:
    """Build the graph of a classifier that never abstains, from nodes that end in
    ``logit``, rough against smooth."""
    constants = {"zero": np.zeros(1), "known": np.array([KNOWN]), "one": np.array([1])}
    unknown = [
        # Of the logit's shape, and constant.
        helper.make_node("Mul", ["logit", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "known"], ["unknown"]),
    ]
    nodes = [*nodes, *unknown, *output_nodes(logit="logit", unknown="unknown")]
    return build(nodes, {**constants, **tensors}, features=features)


def fill_missing(centre: str) -> list[NodeProto]:
    """Replace missing features by their average; the result is ``whole``, and
    ``missing`` the mask."""
    return [
        helper.make_node("IsNaN", [FEATURES], ["missing"]),
        helper.make_node("Where", ["missing", centre, FEATURES], ["whole"]),
    ]


def output_nodes(*, logit: str, unknown: str) -> list[NodeProto]:
    """Turn two logits, rough against smooth (l) and unknown against known (u), into
    log-probabilities.

    None, smooth and rough are as (1 + e^l) e^u to 1 to e^l: the log-softmax of u +
    softplus(l), 0 and l.
    """
    return [
        helper.make_node("Softplus", [logit], ["softly"]),
        helper.make_node("Add", [unknown, "softly"], ["none"]),
        helper.make_node("Sub", [logit, logit], ["level"]),
        helper.make_node("Concat", ["none", "level", logit], ["scores"], axis=1),
        helper.make_node("LogSoftmax", ["scores"], [LOG_PROBABILITIES], axis=1),
    ]


def _selection(channels: int) -> dict[str, NDArray[np.float64]]:
    """Constants that select the regression of the working channels.

    ``gone @ votes + votes:whole``, negative values cut off, is 1 for that regression
    and 0 for the others; ``shares`` scales its distance up by the share of working
    channels. With no channel left all are 0.
    """
    if channels == 1:
        return {
            "votes": np.array([[-1.0]]),
            "votes:whole": np.ones(1),
            "shares": np.ones((1, 1)),
        }
    # A missing channel votes against the regression of both and its own, and for that
    # of the other channel.
    votes = np.hstack((np.full((2, 1), -1.0), 1 - 2 * np.eye(2)))
    return {
        "votes": votes,
        "votes:whole": np.array([1.0, 0, 0]),
        "shares": np.array([[1.0], [2], [2]]),
    }


def build(
    nodes: Sequence[NodeProto],
    tensors: Mapping[str, NDArray[np.generic]],
    *,
    features: int,
) -> onnx.ModelProto:
    """Build a checked model of nodes and the constants they use; integers keep their
    type, the rest is float32."""
    used = {name for node in nodes for name in node.input}
    stored = [
        numpy_helper.from_array(
            value
            if np.issubdtype(value.dtype, np.integer)
            else value.astype(np.float32),
            name,
        )
        for name, value in tensors.items()
        if name in used
    ]
    ends = (
        (FEATURES, ("windows", features)),
        (LOG_PROBABILITIES, ("windows", len(Touch))),
    )
    return _checked(nodes, stored, *ends)


_End: TypeAlias = tuple[str, Sequence[int | str]]


def _checked(
    nodes: Iterable[NodeProto],
    tensors: Iterable[TensorProto],
    first: _End,
    last: _End,
    *,
    blocked: bool = False,
) -> onnx.ModelProto:
    """Build a checked model between an input and an output, each with its shape.

    ``blocked``: in the operator set of the paper's network.
    """
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)
        for name, shape in (first, last)
    ]
    graph = helper.make_graph(list(nodes), "model", ends[:1], ends[1:], list(tensors))
    opset = BLOCKED_OPSET if blocked else OPSET
    model = helper.make_model(
        graph,
        opset_imports=[helper.make_opsetid("", opset)],
        ir_version=BLOCKED_IR_VERSION if blocked else IR_VERSION,
    )
    onnx.checker.check_model(model)
    return model


def build_graph(weights: Weights, *, storage: Storage = "int8") -> onnx.ModelProto:
    """Build the paper's network, from ``(1, 257 * channels)`` magnitudes to ``(1, 3)``
    log-probabilities."""
    tensors = (
        tensor
        for name, array in weights.items()
        for tensor in _tensors(name, array, storage)
    )
    ends = (
        (FEATURES, (1, SPECTRUM_BINS * channels_of(weights))),
        (LOG_PROBABILITIES, (1, len(Touch))),
    )
    return _checked(_layers(weights, storage), tensors, *ends, blocked=True)


def channels_of(weights: Weights) -> int:
    """Return the number of microphones that parameters were trained on."""
    return int(weights["layer1.weight"].shape[1]) // SPECTRUM_BINS


def read_graph(model: onnx.ModelProto) -> dict[str, FloatArray]:
    """Read the parameters from a graph that :func:`build_graph` wrote."""
    stored = {
        tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer
    }
    parameters = {}
    for name, array in stored.items():
        if name.endswith(_BYTES):
            weight = name.removesuffix(_BYTES)
            scaled = array.T.astype(np.float32) * stored[weight + _SCALE][:, None]
            parameters[weight] = scaled[:, : _inputs(weight, len(array))]
        elif name.endswith((".weight", ".bias")):
            parameters[name] = array
    return parameters


def _inputs(weight: str, rows: int) -> int:
    """Return how many of a stored weight's rows are not padding."""
    if weight.startswith(_FIRST):
        return rows // SPECTRUM_BINS * SPECTRUM_BINS
    return rows


def _tensors(
    name: str, array: FloatArray, storage: Storage
) -> Iterator[onnx.TensorProto]:
    """Store one parameter; 8-bit weights have shape ``(inputs, outputs)``, with rows of
    zeros up to a whole number of blocks."""
    size = _block_size(name, storage)
    if not size:
        yield numpy_helper.from_array(array, name)
        return
    scale = np.maximum(np.abs(array).max(axis=1), np.finfo(np.float32).tiny) / 127
    outputs, inputs = array.shape
    blocks = -(-inputs // size)
    padded = np.zeros((blocks * size, outputs), np.int8)
    padded[:inputs] = np.round(array / scale[:, None]).T
    yield numpy_helper.from_array(padded, name + _BYTES)
    yield numpy_helper.from_array(scale.astype(np.float32), name + _SCALE)
    yield numpy_helper.from_array(np.array([blocks, outputs]), f"{name}:shape")
    if padding := blocks * size - inputs:
        yield numpy_helper.from_array(np.array([0, 0, 0, padding]), f"{name}:padding")


def _block_size(name: str, storage: Storage) -> int:
    """Return the length of a block of 8-bit weights; 0 for parameters that stay in
    float32."""
    if storage == "float32" or not name.endswith(".weight") or name.startswith(_LAST):
        return 0
    return _SPECTRUM_BLOCK if name.startswith(_FIRST) else _BLOCK


def _layers(weights: Weights, storage: Storage) -> Iterator[onnx.NodeProto]:
    residual = [f"layer_resnet.{number}" for number in range(RESIDUALS)]
    value = FEATURES
    for name in (_FIRST, "layer2", "layer3", *residual, "layer4", "layer5"):
        yield from _linear(name, value, weights, storage)
        yield helper.make_node("Relu", [f"{name}:out"], [f"{name}:relu"])
        if name in residual:
            yield helper.make_node("Add", [value, f"{name}:relu"], [f"{name}:sum"])
        value = f"{name}:sum" if name in residual else f"{name}:relu"
    yield from _linear(_LAST, value, weights, storage)
    yield helper.make_node("LogSoftmax", [f"{_LAST}:out"], [LOG_PROBABILITIES], axis=-1)


def _linear(
    name: str, value: str, weights: Weights, storage: Storage
) -> Iterator[onnx.NodeProto]:
    weight = f"{name}.weight"
    bias = f"{name}.bias"
    out = f"{name}:out"
    size = _block_size(weight, storage)
    if not size:
        yield helper.make_node("Gemm", [value, weight, bias], [out], transB=1)
        return
    if weights[weight].shape[1] % size:
        padded = f"{name}:padded"
        yield helper.make_node("Pad", [value, f"{weight}:padding"], [padded])
        value = padded
    # A row of scales for each block; each output has one for all, expanded once while
    # loading.
    yield helper.make_node(
        "Expand", [weight + _SCALE, f"{weight}:shape"], [weight + _SCALES]
    )
    yield helper.make_node(
        "DequantizeLinear",
        [weight + _BYTES, weight + _SCALES],
        [weight],
        axis=0,
        block_size=size,
    )
    yield helper.make_node("MatMul", [value, weight], [f"{name}:product"])
    # A sum and no `Add`, which ONNX Runtime would join with the product before it can
    # take the bytes.
    yield helper.make_node("Sum", [f"{name}:product", bias], [out])
