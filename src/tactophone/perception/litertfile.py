"""Writes networks in LiteRT's own format, a flat buffer that LiteRT's package brings the schema of."""

from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

Operation: TypeAlias = Literal["FULLY_CONNECTED", "ADD", "SOFTMAX"]

_VERSIONS: dict[Operation, int] = {"FULLY_CONNECTED": 9, "ADD": 1, "SOFTMAX": 1}
"""Of each operation, the first that has what is used here; 9 brought a scale for each output."""


class LiteRtWriter:
    """Writes a network, value by value; a value is known by its place in the file, and its shape is ``(1, size)``.

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

    def place(self, size: int) -> int:
        """Make room for a value."""
        return self._tensor((1, size), self._schema.TensorType.FLOAT32)

    def constant(self, array: FloatArray | NDArray[np.int8], scale: FloatArray | None = None) -> int:
        """Write a constant; of int8, with the scale of each of its rows."""
        kind = self._schema.TensorType.FLOAT32 if scale is None else self._schema.TensorType.INT8
        buffer = self._schema.BufferT()
        buffer.data = np.frombuffer(array.tobytes(), np.uint8)
        self._model.buffers.append(buffer)
        place = self._tensor(array.shape, kind, len(self._model.buffers) - 1)
        if scale is not None:
            self._graph.tensors[place].quantization = self._quantization(scale)
        return place

    def connect(self, value: int, weights: int, biases: int, *, rectify: bool) -> int:
        """Write ``W x + b``, and of it the positive part if asked."""
        options = self._schema.FullyConnectedOptionsT()
        # The unnamed activation functions are 0, none, and 1, the positive part.
        options.fusedActivationFunction, options.asymmetricQuantizeInputs = int(rectify), True
        size = int(self._graph.tensors[biases].shape[0])
        return self._operate("FULLY_CONNECTED", [value, weights, biases], size, options)

    def add(self, first: int, second: int) -> int:
        """Write the sum of two values."""
        return self._operate("ADD", [first, second], self._size(first), self._schema.AddOptionsT())

    def softmax(self, value: int) -> int:
        """Write probabilities."""
        options = self._schema.SoftmaxOptionsT()
        options.beta = 1.0
        return self._operate("SOFTMAX", [value], self._size(value), options)

    def finish(self, value: int, answer: int) -> bytes:
        """Give the file of the network that leads from a value to an answer."""
        import flatbuffers

        self._graph.inputs, self._graph.outputs = [value], [answer]
        self._model.operatorCodes = [self._code(operation) for operation in _VERSIONS]
        builder = flatbuffers.Builder()
        builder.Finish(self._model.Pack(builder), b"TFL3")
        return bytes(builder.Output())

    def _tensor(self, shape: tuple[int, ...], kind: int, buffer: int = 0) -> int:
        tensor = self._schema.TensorT()
        tensor.shape, tensor.type, tensor.buffer = list(shape), kind, buffer
        self._graph.tensors.append(tensor)
        return len(self._graph.tensors) - 1

    def _size(self, value: int) -> int:
        return int(self._graph.tensors[value].shape[-1])

    def _quantization(self, scale: FloatArray) -> Any:
        quantization = self._schema.QuantizationParametersT()
        quantization.scale, quantization.zeroPoint = scale.tolist(), [0] * len(scale)
        return quantization

    def _operate(self, operation: Operation, values: list[int], size: int, options: Any) -> int:
        operator = self._schema.OperatorT()
        operator.opcodeIndex, operator.inputs = list(_VERSIONS).index(operation), values
        operator.outputs = [self.place(size)]
        name = type(options).__name__.removesuffix("T")
        operator.builtinOptions, operator.builtinOptionsType = options, getattr(self._schema.BuiltinOptions, name)
        self._graph.operators.append(operator)
        return int(operator.outputs[0])

    def _code(self, operation: Operation) -> Any:
        code = self._schema.OperatorCodeT()
        code.builtinCode = code.deprecatedBuiltinCode = getattr(self._schema.BuiltinOperator, operation)
        code.version = _VERSIONS[operation]
        return code
