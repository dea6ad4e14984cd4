from pathlib import Path

import numpy as np
import onnx
import pytest

from tactophone.perception.inference.onnxfile import read_constants
from tactophone.perception.model_registry import model_path
from tests.models import write_tiny_model


def theirs(path: Path) -> dict[str, np.ndarray]:
    return {one.name: onnx.numpy_helper.to_array(one) for one in onnx.load(str(path)).graph.initializer}


@pytest.mark.parametrize("name", ["paper", "tiny"])
def test_constants_are_those_that_the_onnx_package_reads(tmp_path: Path, name: str) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx") if name == "tiny" else model_path(name)
    wanted, found = theirs(path), read_constants(path.read_bytes())
    assert found.keys() == wanted.keys()
    for key, array in wanted.items():
        assert found[key].dtype == array.dtype
        assert np.array_equal(found[key], array)


def test_constants_of_other_types_are_left_out(tmp_path: Path) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx")
    model = onnx.load(str(path))
    model.graph.initializer.append(onnx.numpy_helper.from_array(np.arange(3), "whole"))
    assert read_constants(model.SerializeToString()).keys() == {"weights"}
