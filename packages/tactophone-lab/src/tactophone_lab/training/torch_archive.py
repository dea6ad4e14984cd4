"""Reads the tensors of a file that torch has written, without running any of it.

Both ``torch.save`` and TorchScript write a zip archive with ``data.pkl``, a pickle that
names tensors, and a file of numbers for each storage. A pickle is a program, so this
reader gives it nothing to call: what it asks for becomes an inert record, and anything
but tensors, numbers, text, lists and dictionaries is refused. The code of a TorchScript
archive is not even read.

A record says name, shape, type and place of a tensor. Numbers are read only when
somebody asks for them, so that what a file claims costs nothing.
"""

import io
import pickle
import pickletools
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from tactophone.core.errors import ModelError
from tactophone.core.types import FloatArray

MAX_PICKLE = 10_000_000
"""Bytes of ``data.pkl``; the authors' files have some thousand."""

DTYPES: dict[str, np.dtype[Any]] = {
    "FloatStorage": np.dtype("<f4"),
    "DoubleStorage": np.dtype("<f8"),
    "HalfStorage": np.dtype("<f2"),
}
"""Types of numbers that can be weights, by torch's name of their storage."""


class UnreadableArchiveError(Exception):
    """The archive asks for something that this reader does not do."""


@dataclass(frozen=True, slots=True)
class StoredTensor:
    """What an archive says of a tensor."""

    storage: str
    """Name of the archive's part with its numbers."""
    kind: str
    """Torch's name of the storage's type, such as ``FloatStorage``."""
    offset: int
    """First number within the storage."""
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    """In numbers, not bytes."""

    @property
    def contiguous(self) -> bool:
        """Whether the numbers lie one after another: only then there are as many as
        the shape says."""
        expected = 1
        for size, stride in zip(
            reversed(self.shape), reversed(self.strides), strict=True
        ):
            if size != 1 and stride != expected:
                return False
            expected *= size
        return True


class TorchArchive:
    """An archive of torch, open for reading.

    ``content`` is what ``torch.save`` was given, with a `StoredTensor` in place of each
    tensor; of TorchScript it is the module as nested dictionaries of its attributes.

    Raises `UnreadableArchiveError` where the archive holds anything else.
    """

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive
        pickles = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        if len(pickles) != 1:
            raise UnreadableArchiveError(f"{len(pickles)} parts named data.pkl, not 1")
        self._folder = pickles[0].removesuffix("data.pkl")
        order = self._folder + "byteorder"
        if order in archive.namelist() and self._part(order, 16) != b"little":
            raise UnreadableArchiveError("numbers in another byte order than little")
        self.content = _unpickle(self._part(pickles[0], MAX_PICKLE))

    def read(self, tensor: StoredTensor) -> FloatArray:
        """Read the numbers of a tensor whose shape is known to be wanted, as
        float32."""
        dtype = DTYPES[tensor.kind]
        end = (tensor.offset + prod(tensor.shape)) * dtype.itemsize
        name = f"{self._folder}data/{tensor.storage}"
        if tensor.offset < 0 or name not in self._archive.namelist():
            raise UnreadableArchiveError(f"no numbers at {tensor.storage!r}")
        numbers = self._archive.read(name)
        if len(numbers) < end:
            raise UnreadableArchiveError(
                f"{len(numbers)} bytes in {tensor.storage!r}, but its tensor ends at "
                f"{end}"
            )
        flat = np.frombuffer(numbers[:end], dtype)[tensor.offset :]
        weights: FloatArray = flat.reshape(tensor.shape).astype(np.float32)
        return weights

    def _part(self, name: str, most: int) -> bytes:
        if self._archive.getinfo(name).file_size > most:
            raise UnreadableArchiveError(f"{name} is over {most} bytes")
        return self._archive.read(name)


def tensors_of(content: Any) -> dict[str, StoredTensor]:
    """Return the tensors in nested dictionaries, by their names joined with dots.

    Raises `UnreadableArchiveError` where a dictionary is nested in itself.
    """
    found: dict[str, StoredTensor] = {}
    waiting: list[tuple[str, Any, int]] = [("", content, 0)]
    while waiting:
        name, value, depth = waiting.pop()
        if isinstance(value, StoredTensor):
            found[name] = value
        elif isinstance(value, Mapping):
            if depth > _DEEPEST or len(found) + len(waiting) > _MOST_NAMES:
                raise UnreadableArchiveError("dictionaries nested without end")
            for key, inner in value.items():
                if not isinstance(key, str | int):
                    raise UnreadableArchiveError("a name that is no text")
                path = f"{name}.{key}" if name else str(key)
                if len(path) > _LONGEST_NAME:
                    raise UnreadableArchiveError("a name without end")
                waiting.append((path, inner, depth + 1))
    return found


_DEEPEST = 20
"""Levels of modules within modules; the paper's network has 3."""

_MOST_NAMES = 10_000
"""Entries of all dictionaries; the paper's network has some hundred."""


_LONGEST_NAME = 500
"""Characters of a tensor's name, with the names of what it lies in."""


class _Module(dict[str, Any]):
    """A module of TorchScript, as the dictionary of its attributes."""

    def __init__(self) -> None:
        super().__init__()

    def __setstate__(self, state: Any) -> None:
        if not isinstance(state, dict) or len(state) > _LONGEST_COPY:
            raise UnreadableArchiveError("a module with a state of its own making")
        self.update(state)


class _Dictionary(dict[str, Any]):
    """An ordered dictionary; torch gives the one of a network's state a note of
    versions, which is left out."""

    def __init__(self) -> None:
        super().__init__()

    def __setstate__(self, state: Any) -> None:
        pass


def _unpickle(content: bytes) -> Any:
    try:
        _check_operations(content)
        return _Reader(io.BytesIO(content)).load()
    except UnreadableArchiveError:
        raise
    except Exception as error:
        # A malformed pickle raises whatever its operations happen to meet.
        first_line = str(error).strip().partition("\n")[0][:160]
        raise UnreadableArchiveError(first_line or type(error).__name__) from None


def _check_operations(content: bytes) -> None:
    """Refuse operations that torch does not write, or too many of them, before any is
    carried out: a few hundred bytes could take all time and memory.

    - A place in the memo makes a list as long as its number.
    - Tuples that are taken from the memo, each into the next one twice, make a name
      that takes 2^n steps to look up.
    - A large list that is copied at each step makes any number of large lists.
    """
    tuples: set[int] = set()
    made = ""
    for count, (operation, argument, _) in enumerate(pickletools.genops(content)):
        name = operation.name
        if name not in _OPERATIONS or count > _MOST_OPERATIONS:
            raise UnreadableArchiveError(f"operation {count} is {name}")
        if name in _MEMO_OPERATIONS:
            place = int(argument or 0)
            if not 0 <= place <= len(content):
                raise UnreadableArchiveError(f"a memo of {place} places")
            if name.endswith("PUT") and made.startswith("TUPLE"):
                tuples.add(place)
            elif place in tuples:
                raise UnreadableArchiveError("a tuple in many places")
        made = name


_MEMO_OPERATIONS = frozenset({"BINPUT", "LONG_BINPUT", "BINGET", "LONG_BINGET"})

_OPERATIONS = _MEMO_OPERATIONS | {
    *("PROTO", "STOP", "MARK", "NONE", "NEWTRUE", "NEWFALSE", "BINUNICODE"),
    *("BININT", "BININT1", "BININT2", "LONG1", "BINFLOAT"),
    *("EMPTY_TUPLE", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3"),
    *("EMPTY_LIST", "APPEND", "APPENDS", "EMPTY_DICT", "SETITEM", "SETITEMS"),
    *("GLOBAL", "REDUCE", "NEWOBJ", "BUILD", "BINPERSID"),
}
"""What ``torch.save`` and TorchScript write, by pickletools' names."""

_MOST_OPERATIONS = 20_000
"""Operations of a pickle; the paper's network takes some thousand."""

_LONGEST_COPY = 1_000
"""Entries of a list or dictionary that an operation copies."""


class _Reader(pickle.Unpickler):
    """Unpickles records of tensors and nothing that runs."""

    def find_class(self, module: str, name: str) -> Any:
        if module == "torch" and name.endswith("Storage"):
            return name
        if module.split(".", maxsplit=1)[0] == "__torch__":
            return _Module
        if (module, name) in _KNOWN:
            return _KNOWN[module, name]
        raise UnreadableArchiveError(f"it asks for {module}.{name}"[:160])

    def persistent_load(self, reference: Any) -> tuple[str, str]:
        match reference:
            case ("storage", str(kind), str(key), _, int()):
                return kind, key
        raise UnreadableArchiveError("a storage without kind and name")


def _tensor(
    storage: Any, offset: Any, shape: Any, strides: Any, *_: Any
) -> StoredTensor:
    match storage, offset, shape, strides:
        case (str(kind), str(key)), int(), tuple(), tuple():
            sizes = (*shape, *strides)
            if len(shape) == len(strides) and all(
                type(size) is int and 0 <= size < 1 << 40 for size in sizes
            ):
                return StoredTensor(key, kind, offset, shape, strides)
    raise UnreadableArchiveError("a tensor without storage and shape")


def _parameter(tensor: Any, *_: Any) -> Any:
    return tensor


def _plain_list(values: Any) -> list[Any]:
    if not isinstance(values, list) or len(values) > _LONGEST_COPY:
        raise UnreadableArchiveError("a list of its own making")
    return list(values)


_KNOWN = {
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch._utils", "_rebuild_parameter"): _parameter,
    ("torch.jit._pickle", "build_intlist"): _plain_list,
    ("torch.jit._pickle", "build_doublelist"): _plain_list,
    ("torch.jit._pickle", "build_boollist"): _plain_list,
    ("collections", "OrderedDict"): _Dictionary,
}
"""What a pickle may call, by the names of the real functions: each returns a record."""


def open_archive(path: Path, archive: zipfile.ZipFile, *, wanted: str) -> TorchArchive:
    """Open an archive; raises `ModelError`, which tells to give ``wanted``, where it
    holds anything but numbers and text."""
    try:
        return TorchArchive(archive)
    except (UnreadableArchiveError, zipfile.BadZipFile, NotImplementedError) as error:
        raise ModelError(
            f"{path}: a restricted reader refuses it ({error}); give {wanted}"
        ) from None
