"""Reads the constants out of an ONNX file: the weights of a network that other engines than ONNX Runtime run.

The ``onnx`` package does so too, but takes 30 MB and a tenth of a second that the live side would have to spend.
Field numbers are those of onnx.proto; the wire format is protobuf's (protobuf.dev/programming-guides/encoding).
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MODEL_GRAPH, _GRAPH_CONSTANT = 7, 5
_TENSOR_DIMENSION, _TENSOR_TYPE, _TENSOR_NAME, _TENSOR_RAW = 1, 2, 8, 9
_TYPES: Mapping[Any, type[np.generic]] = {1: np.float32, 3: np.int8}

_VARINT, _EIGHT_BYTES, _PREFIXED, _FOUR_BYTES = 0, 1, 2, 5


def read_constants(content: bytes) -> dict[str, NDArray[Any]]:
    """Give each constant of a whole model file by its name; those that are not float32 or int8 are left out."""
    graph = dict(_fields(memoryview(content)))[_MODEL_GRAPH]
    tensors = [value for number, value in _fields(graph) if number == _GRAPH_CONSTANT]
    return dict(_constant(tensor) for tensor in tensors if dict(_fields(tensor))[_TENSOR_TYPE] in _TYPES)


def _constant(tensor: memoryview) -> tuple[str, NDArray[Any]]:
    fields = dict(_fields(tensor))
    shape = [value for number, value in _fields(tensor) if number == _TENSOR_DIMENSION]
    array = np.frombuffer(fields[_TENSOR_RAW], _TYPES[fields[_TENSOR_TYPE]])
    return bytes(fields[_TENSOR_NAME]).decode(), array.reshape(shape)


def _fields(message: memoryview) -> Iterator[tuple[int, Any]]:
    """Give the number and value of each field: a whole number, or the bytes of anything else."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        kind = key & 7
        if kind == _VARINT:
            value, at = _varint(message, at)
            yield key >> 3, value
            continue
        if kind == _PREFIXED:
            size, at = _varint(message, at)
        else:
            size = {_EIGHT_BYTES: 8, _FOUR_BYTES: 4}[kind]
        yield key >> 3, message[at : at + size]
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    """Read a whole number, seven bits a byte, the lowest first; give it and where it ends."""
    value = shift = 0
    while message[at] >= 0x80:
        value |= (message[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
    return value | message[at] << shift, at + 1
