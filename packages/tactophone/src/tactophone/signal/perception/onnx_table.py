"""Checks what an ONNX file says it holds, before any of it is loaded.

A reader of protocol buffers, a few lines long, walks the messages in the file and
allocates nothing by the numbers that they state. ONNX Runtime would do both at loading:
it computes constants, fills sparse tensors up to their full size, and reads weights
from other files by their names.

The numbers of fields and types are those of ``onnx.proto3``.
"""

import itertools
from collections.abc import Iterable, Iterator
from enum import IntEnum
from math import prod
from typing import Any

import numpy as np

CONTROL_FLOW = frozenset({"Loop", "If", "Scan", "SequenceMap"})
"""Operators that hold graphs of their own: how long they run cannot be known
beforehand."""

SIZED_BY = {
    "AffineGrid": (1,),
    "BlackmanWindow": (0,),
    "CenterCropPad": (1,),
    "Col2Im": (1, 2),
    "ConstantOfShape": (0,),
    "DFT": (1,),
    "Expand": (1,),
    "HammingWindow": (0,),
    "HannWindow": (0,),
    "MaxUnpool": (2,),
    "MelWeightMatrix": (0, 1, 2, 3, 4),
    "OneHot": (1,),
    "Pad": (1,),
    "Range": (0, 1, 2),
    "Reshape": (1,),
    "Resize": (2, 3),
    "STFT": (1, 3),
    "SequenceAt": (1,),
    "SequenceErase": (1,),
    "Slice": (1, 2, 3, 4),
    "Split": (1,),
    "SplitToSequence": (1,),
    "Squeeze": (1,),
    "Tile": (1, 2),
    "TopK": (1,),
    "Unsqueeze": (1,),
    "Upsample": (1,),
    **dict.fromkeys(("Compress", "NonMaxSuppression", "NonZero", "Unique"), range(5)),
}
"""Operators whose output has the size or the shape that the values of these inputs say.
These values must not follow from the sound: such a model is small while it is tried,
and large at the first tap."""

CHOOSES_AXES = "Reduce"
"""How the names of operators begin whose second input says which axes are left."""

ALWAYS_FIXED = frozenset({"Constant", "Shape", "Size"})
"""Operators whose output is the same for every sound."""

NEVER_FIXED = frozenset(
    {
        "Bernoulli",
        "Multinomial",
        "RandomNormal",
        "RandomNormalLike",
        "RandomUniform",
        "RandomUniformLike",
    }
)
"""Operators whose output is another each time."""

MAX_NODES = 2_000
"""Operators of a graph: ten times the largest of the shipped models. How long ONNX
Runtime optimises a graph grows faster than its length."""

MAX_TENSORS = 10_000
"""Weights and constants of a graph."""


MAX_FIELDS = 100_000
"""Fields of a file, those of its messages included; the shipped models have 2,000 at
most."""

MAX_DIMENSIONS = 8
"""Dimensions of a weight: twice what any layer of a network has."""


class ModelField(IntEnum):
    """Fields of a ModelProto."""

    GRAPH = 7
    FUNCTIONS = 25


class GraphField(IntEnum):
    """Fields of a GraphProto."""

    NODE = 1
    INITIALIZER = 5
    INPUT = 11
    SPARSE_INITIALIZER = 15


class ValueField(IntEnum):
    """Fields of a ValueInfoProto."""

    NAME = 1


class NodeField(IntEnum):
    """Fields of a NodeProto."""

    INPUT = 1
    OUTPUT = 2
    OPERATOR = 4
    ATTRIBUTE = 5


class AttributeField(IntEnum):
    """Fields of an AttributeProto."""

    TENSOR = 5
    GRAPH = 6
    TENSORS = 10
    GRAPHS = 11
    SPARSE_TENSOR = 22
    SPARSE_TENSORS = 23


class TensorField(IntEnum):
    """Fields of a TensorProto."""

    DIMS = 1
    DATA_TYPE = 2
    FLOAT_DATA = 4
    NAME = 8
    RAW_DATA = 9
    DOUBLE_DATA = 10
    EXTERNAL_DATA = 13
    DATA_LOCATION = 14


_FLOATS: dict[int, np.dtype[Any]] = {
    1: np.dtype("<f4"),
    10: np.dtype("<f2"),
    11: np.dtype("<f8"),
}
"""Data types of floating-point weights, as their raw data hold them."""

Field = tuple[int, memoryview | int]
"""Number of a field; its bytes where it has a length, else its value."""


def check_graph(content: bytes) -> None:
    """Raise `ValueError` for a file that is no ONNX file, or that holds what a model
    has no use for.

    That is control flow, graphs within operators, functions, weights in other files,
    sparse weights, weights that are not finite, operators whose size follows from the
    sound, and more than `MAX_NODES` operators.
    """
    left = iter(range(MAX_FIELDS))
    for number, value in _fields(memoryview(content), left):
        if number == ModelField.FUNCTIONS:
            raise ValueError("it defines functions of its own")
        if number == ModelField.GRAPH and isinstance(value, memoryview):
            _check_graph(value, left)


def _check_graph(graph: memoryview, left: Iterator[int]) -> None:
    tensors = 0
    fixed = {b""}  # an input that is left out
    given: set[bytes] = set()
    nodes: list[list[Field]] = []
    for number, value in _fields(graph, left):
        if number == GraphField.SPARSE_INITIALIZER:
            raise ValueError("it has sparse weights, whose size no byte of it limits")
        if not isinstance(value, memoryview):
            continue
        match number:
            case GraphField.NODE:
                if len(nodes) == MAX_NODES:
                    raise ValueError(f"it has over {MAX_NODES} operators")
                nodes.append(list(_fields(value, left)))
                _check_node(nodes[-1], left)
            case GraphField.INITIALIZER:
                tensors += 1
                if tensors > MAX_TENSORS:
                    raise ValueError(f"it has over {MAX_TENSORS} weights")
                fixed.add(_check_tensor(value, left, finite=True))
            case GraphField.INPUT:
                given.update(_texts(_fields(value, left), ValueField.NAME))
    # A weight may have the name of an input: then it is its value until one is given.
    fixed -= given
    # Weights and inputs may follow the operators that use them, so these are looked at
    # in the end; among themselves they stand in their order.
    for node in nodes:
        _check_size(node, fixed)


def _check_size(node: Iterable[Field], fixed: set[bytes]) -> None:
    """Refuse an operator whose output is as large as the sound says; add to ``fixed``,
    the names of what is the same for every sound, what it computes of these alone."""
    inputs = _texts(node, NodeField.INPUT)
    name = b"".join(_texts(node, NodeField.OPERATOR)[-1:]).decode(errors="replace")
    places = (1,) if name.startswith(CHOOSES_AXES) else SIZED_BY.get(name, ())
    for place in places:
        if place < len(inputs) and inputs[place] not in fixed:
            raise ValueError(f"the size of its {name} follows from the sound")
    follows = name in NEVER_FIXED or not fixed.issuperset(inputs)
    if name in ALWAYS_FIXED or not follows:
        fixed.update(_texts(node, NodeField.OUTPUT))


def _texts(fields: Iterable[Field], wanted: int) -> list[bytes]:
    """Return the values of a field that holds texts, in their order."""
    return [
        bytes(value)
        for number, value in fields
        if number == wanted and isinstance(value, memoryview)
    ]


def _check_node(node: Iterable[Field], left: Iterator[int]) -> None:
    operators = [
        name.decode(errors="replace") for name in _texts(node, NodeField.OPERATOR)
    ]
    if forbidden := CONTROL_FLOW.intersection(operators):
        raise ValueError(f"it has control flow ({', '.join(sorted(forbidden))})")
    for number, value in node:
        if number == NodeField.ATTRIBUTE and isinstance(value, memoryview):
            _check_attribute(value, left, of=", ".join(operators))


def _check_attribute(attribute: memoryview, left: Iterator[int], *, of: str) -> None:
    for number, value in _fields(attribute, left):
        match number:
            case AttributeField.GRAPH | AttributeField.GRAPHS:
                # Also the runtime's own operators of this kind, such as searches,
                # whatever their names will be.
                raise ValueError(f"an operator with a graph of its own ({of})")
            case AttributeField.SPARSE_TENSOR | AttributeField.SPARSE_TENSORS:
                raise ValueError(f"an operator with a sparse constant ({of})")
            case AttributeField.TENSOR | AttributeField.TENSORS:
                if isinstance(value, memoryview):
                    # A constant may be infinite: the bound of a comparison is no
                    # weight.
                    _check_tensor(value, left, finite=False)


def _check_tensor(tensor: memoryview, left: Iterator[int], *, finite: bool) -> bytes:
    """Refuse weights that lie in another file, that claim another size than their bytes
    have, or that are not finite; return their name."""
    name = b""
    shape: list[int] = []
    kind = 0
    raw: memoryview | None = None
    numbers: list[tuple[memoryview, np.dtype[Any]]] = []
    for number, value in _fields(tensor, left):
        match number, value:
            case TensorField.EXTERNAL_DATA, _:
                raise ValueError("its weights lie in another file")
            case TensorField.DATA_LOCATION, location if location != 0:
                raise ValueError("its weights lie in another file")
            case TensorField.DIMS, int(size):
                shape.append(size)
            case TensorField.DIMS, memoryview() as packed:
                shape += itertools.islice(_varints(packed), MAX_DIMENSIONS + 1)
            case TensorField.DATA_TYPE, int(kind):
                pass
            case TensorField.FLOAT_DATA, memoryview() as packed:
                numbers.append((packed, _FLOATS[1]))
            case TensorField.DOUBLE_DATA, memoryview() as packed:
                numbers.append((packed, _FLOATS[11]))
            case TensorField.RAW_DATA, memoryview() as raw:
                pass
            case TensorField.NAME, memoryview() as text:
                name = bytes(text)
        if len(shape) > MAX_DIMENSIONS:
            raise ValueError(f"weights of over {MAX_DIMENSIONS} dimensions")
    if raw is not None and kind in _FLOATS:
        if len(raw) != prod(shape) * _FLOATS[kind].itemsize:
            raise ValueError(f"weights of shape {shape} in {len(raw)} bytes")
        numbers.append((raw, _FLOATS[kind]))
    for packed, dtype in numbers if finite else ():
        if (
            len(packed) % dtype.itemsize
            or not np.isfinite(np.frombuffer(packed, dtype)).all()
        ):
            raise ValueError("its weights are not all finite numbers")
    return name


def _fields(message: memoryview, left: Iterator[int]) -> Iterator[Field]:
    """Yield the fields of a protocol buffer, each of which takes one of those that are
    ``left`` of the whole file's."""
    at = 0
    while at < len(message):
        if next(left, None) is None:
            raise ValueError(f"it has over {MAX_FIELDS} fields")
        key, at = _varint(message, at)
        match key & 7:
            case 0:
                value, at = _varint(message, at)
                yield key >> 3, value
                continue
            case 1:
                size = 8
            case 5:
                size = 4
            case 2:
                size, at = _varint(message, at)
            case wire:
                raise ValueError(f"wire type {wire} at byte {at}")
        if at + size > len(message):
            raise ValueError(
                f"{size} bytes announced at byte {at}, but only {len(message) - at} "
                "are left"
            )
        yield key >> 3, message[at : at + size]
        at += size


def _varints(packed: memoryview) -> Iterator[int]:
    at = 0
    while at < len(packed):
        value, at = _varint(packed, at)
        yield value


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise ValueError("it ends within a number")
        byte = message[at]
        value = value | (byte & 0x7F) << shift
        at = at + 1
        if byte < 0x80:
            return value, at
    raise ValueError(f"a number of over ten bytes at byte {at}")
