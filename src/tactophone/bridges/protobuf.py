"""The few parts of Protocol Buffers that audio messages need: fields, and schemas that describe themselves.

Foxglove plays audio in protobuf only. The encoding (protobuf.dev/programming-guides/encoding) is a tag and a value for
each field, so its library, 3 MB with a generated module for each message, is not needed.
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5

TYPES = {
    "double": 1,
    "int64": 3,
    "int32": 5,
    "fixed32": 7,
    "bool": 8,
    "string": 9,
    "message": 11,
    "bytes": 12,
    "sint64": 18,
}
"""Field types, by their numbers in ``FieldDescriptorProto.Type``."""


@dataclass(frozen=True, slots=True)
class FieldType:
    """A field of a message; ``type`` is one of `TYPES`, or the full name of a message."""

    name: str
    type: str
    repeated: bool = False


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message whose fields are numbered from 1 in their order."""

    name: str
    fields: tuple[FieldType, ...]


def varint(value: int) -> bytes:
    """Encode a whole number from 0, seven bits a byte.

    >>> varint(300).hex()
    'ac02'
    """
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])


def integer(number: int, value: int) -> bytes:
    """Encode a whole number or a switch."""
    return varint(number << 3 | _VARINT) + varint(value)


def zigzag(values: Iterable[int]) -> bytes:
    """Encode whole numbers, small ones in a byte.

    >>> zigzag([-1, 64]).hex()
    '018001'
    """
    return b"".join(varint(2 * value if value >= 0 else -2 * value - 1) for value in values)


def signed(number: int, values: Iterable[int]) -> bytes:
    """Encode a packed field of whole numbers."""
    return octets(number, zigzag(values))


def octets(number: int, value: bytes) -> bytes:
    """Encode bytes, a text as UTF-8, or an encoded message."""
    return varint(number << 3 | _BYTES) + varint(len(value)) + value


def double(number: int, value: float) -> bytes:
    """Encode a floating-point number of 64 bits."""
    return varint(number << 3 | _FIXED64) + struct.pack("<d", value)


def fixed32(number: int, value: int) -> bytes:
    """Encode a whole number in four bytes."""
    return varint(number << 3 | _FIXED32) + struct.pack("<I", value)


def fields(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Return the fields of a message as number and value; a fixed one as its bytes.

    Raises `ValueError` when the bytes are not a message.
    """
    position = 0
    while position < len(message):
        tag, position = _read_varint(message, position)
        kind = tag & 7
        if kind == _VARINT:
            value, position = _read_varint(message, position)
            yield tag >> 3, value
            continue
        size = {_FIXED64: 8, _FIXED32: 4}.get(kind, -1)
        if kind == _BYTES:
            size, position = _read_varint(message, position)
        if size < 0 or position + size > len(message):
            raise ValueError(f"field {tag >> 3} of type {kind} at byte {position} does not fit {len(message)} bytes")
        yield tag >> 3, message[position : position + size]
        position += size


def varints(packed: bytes) -> Iterator[int]:
    """Return the whole numbers of a packed field.

    >>> list(varints(varint(1) + varint(300)))
    [1, 300]
    """
    position = 0
    while position < len(packed):
        value, position = _read_varint(packed, position)
        yield value


def signed_numbers(packed: bytes) -> Iterator[int]:
    """Return the whole numbers that `zigzag` has encoded."""
    return (value >> 1 ^ -(value & 1) for value in varints(packed))


def describe_file(package: str, messages: Sequence[MessageType], *, imports: Sequence[str] = ()) -> bytes:
    """Return one file of a schema; a schema, a ``FileDescriptorSet``, is several of them joined.

    ``imports`` are packages whose messages these contain; their files come before.
    """
    file = octets(1, _file_name(package)) + octets(2, package.encode())
    file += b"".join(octets(3, _file_name(other)) for other in imports)
    file += b"".join(octets(4, _describe(message)) for message in messages)
    return octets(1, file + octets(12, b"proto3"))


def _file_name(package: str) -> bytes:
    return f"{package.replace('.', '/')}.proto".encode()


def _describe(message: MessageType) -> bytes:
    described = octets(1, message.name.encode())
    for number, entry in enumerate(message.fields, 1):
        text = octets(1, entry.name.encode()) + integer(3, number) + integer(4, 3 if entry.repeated else 1)
        text += integer(5, TYPES.get(entry.type, TYPES["message"]))
        if entry.type not in TYPES:
            text += octets(6, f".{entry.type}".encode())
        described += octets(2, text)
    return described


def _read_varint(message: bytes, position: int) -> tuple[int, int]:
    value = shift = 0
    while position < len(message) and shift < 64:
        byte = message[position]
        position += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, position
        shift += 7
    raise ValueError(f"a number at byte {position} that does not end")
