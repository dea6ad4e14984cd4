"""What a model file may hold: it may come from anywhere, so every number and every operator in it has bounds.

The file is read as far as needed by a reader of protocol buffers of a few lines, before ONNX Runtime sees it: already
loading a graph computes parts of it.
"""

import re
import threading
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import onnxruntime

MAX_BYTES = 200_000_000
"""Of a model file; the paper's network in 32 bits takes 7.5 MB."""

MAX_FEATURES = 100_000
"""Inputs of a network: four hundred times the paper's."""

SAMPLE_RATES = (2_000, 192_000)
"""Hz: the lowest of a detector, and the highest of sound cards."""

MAX_DURATION = 10.0
"""Seconds of a window or a hop."""

MAX_TEXT = 200
"""Characters of a name."""

PROBE_TIMEOUT = 5.0
"""Seconds for one inference at reading; the live system has a hundredth of a second."""

CONTROL_FLOW = frozenset({"Loop", "If", "Scan", "SequenceMap"})
"""Operators that hold graphs of their own: how long they run cannot be known beforehand."""

_HOP = re.compile(r"\d{1,9}(/0*[1-9]\d{0,8}|\.\d{1,9})?")

_GRAPH, _FUNCTION, _NODE, _OPERATOR, _ATTRIBUTE = 7, 25, 1, 4, 5
_SUBGRAPHS = {6, 11}
"""Field numbers of ONNX's ModelProto, GraphProto and NodeProto, and those of AttributeProto that hold graphs."""


def check_graph(content: bytes) -> None:
    """Raise `ValueError` for a file with control flow or functions, or one that is no ONNX file."""
    for field, value in _fields(memoryview(content)):
        if field == _FUNCTION:
            raise ValueError("it defines functions of its own")
        if field != _GRAPH or value is None:
            continue
        for inner, node in _fields(value):
            if inner == _NODE and node is not None:
                _check_node(node)


def _check_node(node: memoryview) -> None:
    operators = [bytes(value or b"").decode(errors="replace") for field, value in _fields(node) if field == _OPERATOR]
    if forbidden := CONTROL_FLOW.intersection(operators):
        raise ValueError(f"it has control flow ({', '.join(sorted(forbidden))})")
    for attribute in (value for field, value in _fields(node) if field == _ATTRIBUTE and value is not None):
        # Also the runtime's own operators of this kind, such as searches, whatever their names will be.
        if any(field in _SUBGRAPHS for field, _ in _fields(attribute)):
            raise ValueError(f"an operator with a graph of its own ({', '.join(operators)})")


def _fields(message: memoryview) -> Iterator[tuple[int, memoryview | None]]:
    """Yield the fields of a protocol buffer: number, and content where it has a length."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        match key & 7:
            case 0:
                _, at = _varint(message, at)
                yield key >> 3, None
                continue
            case 1 | 5 as fixed:
                size = 8 if fixed == 1 else 4
            case 2:
                size, at = _varint(message, at)
            case wire:
                raise ValueError(f"wire type {wire} at byte {at}")
        if at + size > len(message):
            raise ValueError(f"{size} bytes announced at byte {at}, but only {len(message) - at} are left")
        yield key >> 3, message[at : at + size] if key & 7 == 2 else None
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise ValueError("it ends within a number")
        byte = message[at]
        value, at = value | (byte & 0x7F) << shift, at + 1
        if byte < 0x80:
            return value, at
    raise ValueError(f"a number of over ten bytes at byte {at}")


def check_entries(entries: Any) -> dict[str, Any]:
    """Return the entries of a card with every number in its bounds and every text printable.

    Raises `ValueError`, `KeyError` or `TypeError` for anything else.
    """
    if not isinstance(entries, dict):
        raise ValueError(f"a card of type {type(entries).__name__}, but it is an object with entries")
    clean: dict[str, Any] = printable(entries)
    for name in ("name", "kind"):
        if not isinstance(clean[name], str) or not 0 < len(clean[name]) <= MAX_TEXT:
            raise ValueError(f"{name} must be a text of 1 to {MAX_TEXT} characters")
    for name in ("settings", "training", "scores", "gate", "decision"):
        if not isinstance(clean.get(name, {}), Mapping):
            raise ValueError(f"{name} must be an object")
    if not isinstance(clean.get("licence", ""), str):
        raise ValueError("licence must be a text")
    rate = _whole(clean, "sample_rate", *SAMPLE_RATES)
    _whole(clean, "window_size", 1, round(MAX_DURATION * rate))
    _whole(clean, "channels", 1, 2)
    clean["hop"] = _hop(clean["hop"], longest=round(MAX_DURATION * rate))
    return clean


def _whole(entries: Mapping[str, Any], name: str, low: int, high: int) -> int:
    value = entries[name]
    if type(value) is not int or not low <= value <= high:
        raise ValueError(f"{name} must be a whole number from {low} to {high}")
    return value


def _hop(value: Any, *, longest: int) -> Fraction:
    # Checked as text first: the fraction of 1e99999999 would take all memory.
    text = value if isinstance(value, str) else str(value) if type(value) is int else ""
    if not _HOP.fullmatch(text):
        raise ValueError("hop must be a fraction of samples, such as 64/3")
    hop = Fraction(text)
    if not 1 <= hop <= longest:
        raise ValueError(f"hop must be from 1 to {longest} samples")
    return hop


def printable(value: Any) -> Any:
    """Replace what a terminal may interpret, such as escape sequences, in all texts of nested entries."""
    match value:
        case str():
            return "".join(
                char if char.isprintable() or char == "\n" else "\N{REPLACEMENT CHARACTER}" for char in value
            )
        case dict():
            return {printable(key): printable(entry) for key, entry in value.items()}
        case list():
            return [printable(entry) for entry in value]
    return value


def check_network(session: "onnxruntime.InferenceSession", *, features: str, output: str, classes: int) -> None:
    """Raise `ValueError` unless the network maps features to one row of classes, within `PROBE_TIMEOUT`."""
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if [(each.name, each.type) for each in inputs] != [(features, "tensor(float)")]:
        raise ValueError(f"its input must be {features}, of floats")
    if [(each.name, each.type) for each in outputs] != [(output, "tensor(float)")]:
        raise ValueError(f"its output must be {output}, of floats")
    shape = inputs[0].shape
    # The number of windows may be a name instead of 1: training and evaluation classify many at once.
    rows, width = shape if len(shape) == 2 else (0, 0)
    if type(width) is not int or not 0 < width <= MAX_FEATURES or (type(rows) is int and rows != 1):
        raise ValueError(f"its input has shape {shape}, but it must be (1, 1 to {MAX_FEATURES})")
    found = _probe(session, features, np.zeros((1, shape[1]), np.float32))
    if found.shape != (1, classes):
        raise ValueError(f"its output has shape {found.shape}, but it must be (1, {classes})")


def _probe(session: "onnxruntime.InferenceSession", features: str, zeros: Any) -> Any:
    """Run the network once, in a thread that is ended when it takes too long."""
    import onnxruntime

    options, results, failures = onnxruntime.RunOptions(), [], []
    options.log_severity_level = 4

    def run() -> None:
        try:
            results.append(session.run(None, {features: zeros}, options)[0])
        except Exception as error:  # ONNX Runtime raises a dozen types of its own
            failures.append(str(error).strip().partition("\n")[0][:160])

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PROBE_TIMEOUT)
    options.terminate = True
    if thread.is_alive():
        raise ValueError(f"one inference takes over {PROBE_TIMEOUT:g} s")
    if failures:
        raise ValueError(f"its network cannot run ({failures[0]})")
    return results[0]
