"""Height maps from anybody: a few bytes that claim gigabytes are refused in one line
before anything is unpacked."""

import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import DatasetError
from tactophone_lab.datasets.roughness import read_heights


def _npy(shape: object, kind: str = "<f8", data: bytes = b"") -> bytes:
    head = (
        f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}".ljust(117)
        + "\n"
    )
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(head)) + head.encode() + data


def _archive(path: Path, size: int) -> None:
    """Write an archive that claims so many bytes once it is unpacked."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("heights.npy", _npy((size // 8,)))
    content = bytearray(path.read_bytes())
    struct.pack_into("<I", content, content.index(b"PK\1\2") + 24, size)
    path.write_bytes(content)


FILES = {
    "20 GB.npy": _npy((2_500_000_000,)),
    "more.npy": _npy((2**62, 4)),
    "below.npy": _npy((-1, 4)),
    "objects.npy": _npy((1,), "|O", b"x"),
    "texts.npy": _npy((4,), "<U1000000000", bytes(64)),
    "no.png": b"\x89PNG\r\n\x1a\n" + bytes(100),
    "20 GB.png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"
    + struct.pack(">IIBBBBB", 50_000, 50_000, 16, 0, 0, 0, 0)
    + bytes(50),
    "empty.npz": b"PK\x05\x06" + bytes(18),
    "none.npz": b"nothing",
}


@pytest.mark.parametrize("name", FILES)
def test_what_claims_gigabytes_or_is_no_file_of_heights_is_refused_in_a_line(
    name: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(FILES[name])
    _refused(tmp_path / name)


def test_an_archive_that_grows_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    _archive(tmp_path / "bomb.npz", 3_000_000_000)
    _refused(tmp_path / "bomb.npz")


def test_a_step_of_several_numbers_is_refused_in_a_line(tmp_path: Path) -> None:
    np.savez(tmp_path / "steps.npz", heights=np.zeros(1000), step=np.zeros(3))
    _refused(tmp_path / "steps.npz")


def _refused(path: Path) -> None:
    tracemalloc.start()
    try:
        with pytest.raises(DatasetError) as refused:
            read_heights(path)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()
    assert str(refused.value).isprintable()
