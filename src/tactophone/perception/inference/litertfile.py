"""Writes networks in LiteRT's own format, a flat buffer that LiteRT's package brings the schema of."""

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

Operation: TypeAlias = Literal[
    "FULLY_CONNECTED", "ADD", "SOFTMAX", "REDUCE_MAX", "MUL", "MINIMUM", "SUB", "CONCATENATION", "SUM"
]

_OPERATIONS: dict[Operation, tuple[int, str]] = {
    "FULLY_CONNECTED": (9, "FullyConnectedOptions"),  # 9 brought a scale for each output
    "ADD": (1, "AddOptions"),
    "SOFTMAX": (1, "SoftmaxOptions"),
    "REDUCE_MAX": (1, "ReducerOptions"),
    "MUL": (1, "MulOptions"),
    "MINIMUM": (1, "MaximumMinimumOptions"),
    "SUB": (1, "SubOptions"),
    "CONCATENATION": (1, "ConcatenationOptions"),
    "SUM": (1, "ReducerOptions"),
}
"""Of each operation, the first version that has what is used here, and the table of its options."""

_POSITIVE_PART = 1
"""Among the format's activation functions."""


class LiteRtWriter:
    """Writes a network, value by value; a value is known by its place in the file, and its shape is ``(rows, size)``.

    Raises
    ------
    ImportError
        If LiteRT is not installed.
    """

    def __init__(self) -> None:
        from ai_edge_litert import schema_py_generated as schema

        self._schema = schema
        self._graph, self._model = schema.SubGraphT(), schema.ModelT()
        self._graph.tensors, self._graph.operators = [], []
        # The first buffer is empty by the format's rule: values that are computed have it.
        self._model.version, self._model.buffers, self._model.subgraphs = 3, [schema.BufferT()], [self._graph]

    def place(self, rows: int, size: int) -> int:
        """Make room for a value."""
        return self._tensor((rows, size), self._schema.TensorType.FLOAT32)

    def constant(self, array: NDArray[Any], scale: FloatArray | None = None) -> int:
        """Write a constant of float32, int32, or int8 with the scale of each of its rows."""
        buffer = self._schema.BufferT()
        buffer.data = np.frombuffer(array.tobytes(), np.uint8)
        self._model.buffers.append(buffer)
        kind = getattr(self._schema.TensorType, array.dtype.name.upper())
        place = self._tensor(array.shape, kind, len(self._model.buffers) - 1)
        if scale is not None:
            self._graph.tensors[place].quantization = self._quantization(scale)
        return place

    def connect(self, value: int, weights: int, biases: int, *, rectify: bool) -> int:
        """Write ``W x + b`` of each row, and of it the positive part if asked."""
        options = {"asymmetricQuantizeInputs": True, "fusedActivationFunction": _POSITIVE_PART * rectify}
        shape = self._shape(value)[0], self._shape(weights)[0]
        return self._operate("FULLY_CONNECTED", value, weights, biases, shape=shape, **options)

    def add(self, first: int, second: int, *, rectify: bool = False) -> int:
        """Write the sum of two values, and of it the positive part if asked."""
        options = {"fusedActivationFunction": _POSITIVE_PART * rectify}
        return self._operate("ADD", first, second, shape=self._shape(first), **options)

    def part(self, value: int, share: float) -> int:
        """Write two rows that sum up to a value: what is under a share of its maximum, and what is over it."""
        one, (_, size) = self.constant(np.array([1], np.int32)), self._shape(value)
        top = self._operate("REDUCE_MAX", value, one, shape=(1, 1), keepDims=True)
        limit = self._operate("MUL", top, self.constant(np.full((1, 1), share, np.float32)), shape=(1, 1))
        under = self._operate("MINIMUM", value, limit, shape=(1, size))
        over = self._operate("SUB", value, under, shape=(1, size))
        return self._operate("CONCATENATION", under, over, shape=(2, size), axis=0)

    def total(self, value: int) -> int:
        """Write the sum of a value's rows."""
        zero = self.constant(np.array([0], np.int32))
        return self._operate("SUM", value, zero, shape=(1, self._shape(value)[1]), keepDims=True)

    def softmax(self, value: int) -> int:
        """Write probabilities."""
        return self._operate("SOFTMAX", value, shape=self._shape(value), beta=1.0)

    def finish(self, value: int, answer: int) -> bytes:
        """Give the file of the network that leads from a value to an answer."""
        import flatbuffers

        self._graph.inputs, self._graph.outputs = [value], [answer]
        self._model.operatorCodes = [self._code(operation) for operation in _OPERATIONS]
        builder = flatbuffers.Builder()
        builder.Finish(self._model.Pack(builder), b"TFL3")
        return bytes(builder.Output())

    def _tensor(self, shape: tuple[int, ...], kind: int, buffer: int = 0) -> int:
        tensor = self._schema.TensorT()
        tensor.shape, tensor.type, tensor.buffer = shape, kind, buffer
        self._graph.tensors.append(tensor)
        return len(self._graph.tensors) - 1

    def _shape(self, value: int) -> tuple[int, int]:
        rows, size = self._graph.tensors[value].shape
        return rows, size

    def _quantization(self, scale: FloatArray) -> Any:
        quantization = self._schema.QuantizationParametersT()
        quantization.scale, quantization.zeroPoint = scale.tolist(), [0] * len(scale)
        return quantization

    def _operate(self, operation: Operation, *values: int, shape: tuple[int, int], **settings: Any) -> int:
        _, name = _OPERATIONS[operation]
        options = getattr(self._schema, f"{name}T")()
        for setting, value in settings.items():
            setattr(options, setting, value)
        operator, result = self._schema.OperatorT(), self.place(*shape)
        operator.opcodeIndex, operator.inputs = list(_OPERATIONS).index(operation), values
        operator.outputs = [result]
        operator.builtinOptions, operator.builtinOptionsType = options, getattr(self._schema.BuiltinOptions, name)
        self._graph.operators.append(operator)
        return result

    def _code(self, operation: Operation) -> Any:
        code = self._schema.OperatorCodeT()
        code.builtinCode = code.deprecatedBuiltinCode = getattr(self._schema.BuiltinOperator, operation)
        code.version, _ = _OPERATIONS[operation]
        return code
