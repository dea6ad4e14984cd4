"""A model file that is not shipped is first loaded by a child with limits."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from tactophone.core.errors import ModelError
from tactophone.signal.perception import model_trial
from tactophone.signal.perception.model_file import LOG_PROBABILITIES, read_model
from tactophone.signal.perception.models import model_path, shipped_models
from tests.models import write_tiny_model
from tests.signal.perception.test_model_checks import SHARES, with_nodes


def program(path: Path, text: str) -> str:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def test_a_model_that_takes_gigabytes_is_refused_by_a_child_in_one_line(
    tmp_path: Path,
) -> None:
    size = numpy_helper.from_array(np.array([1_500_000_000], np.int64), "size")
    nodes = [
        helper.make_node("ConstantOfShape", ["size"], ["big"]),
        helper.make_node("ReduceSum", ["big"], ["sum"], keepdims=0),
        helper.make_node("Cast", ["sum"], ["float"], to=TensorProto.FLOAT),
        helper.make_node("Add", ["shares", "float"], [LOG_PROBABILITIES]),
    ]
    path = with_nodes(tmp_path / "gigabytes.onnx", nodes, [SHARES, size])
    with pytest.raises(ModelError) as refused:
        read_model(path)
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_shipped_model_needs_no_child_and_any_other_file_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    for name in shipped_models():
        read_model(model_path(name))
    copy = tmp_path / "copy.onnx"
    copy.write_bytes(model_path("texture").read_bytes())
    read_model(copy)
    changed = tmp_path / "changed.onnx"
    # One more field, which nobody knows.
    changed.write_bytes(model_path("texture").read_bytes() + b"\xf8\x07\x00")
    with pytest.raises(ModelError, match="ends the process that loads it"):
        read_model(changed)


@pytest.mark.parametrize(
    ("ending", "message"),
    [
        ("kill -ABRT $$", "over 1 GB of memory"),
        ("kill -XCPU $$", "over 10 s of processor time"),
        ("echo 'terminate called'; exit 0", "ends the process"),
        ("cat > /dev/null; printf '\\n\"no good\"'", "^no good$"),
        ("exec sleep 60", "not loaded within 0.3 s"),
    ],
)
def test_however_the_child_ends_the_user_gets_one_line(
    ending: str, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", program(tmp_path / "python", ending))
    if "sleep" in ending:
        monkeypatch.setattr(model_trial, "TRIAL_TIMEOUT", 0.3)
    with pytest.raises(ModelError, match=message) as refused:
        model_trial.try_in_child(tmp_path / "model.onnx", os.urandom(20))
    assert "\n" not in str(refused.value)


def test_a_model_that_passed_is_tried_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx")
    content = path.read_bytes()
    model_trial.try_in_child(path, content)
    monkeypatch.setattr(sys, "executable", "/bin/false")
    model_trial.try_in_child(path, content)


@pytest.mark.skipif(sys.platform != "linux", reason="limits of Linux")
@pytest.mark.parametrize(
    ("work", "ending"),
    [
        ("bytearray(2_000_000_000)", 1),
        ("while True: pass", -signal.SIGXCPU if sys.platform == "linux" else 0),
    ],
)
def test_the_child_has_limits_of_memory_and_processor_time(
    work: str, ending: int
) -> None:
    code = (
        "from tactophone.signal.perception import model_trial\n"
        "model_trial.TRIAL_PROCESSOR_TIME = 1\n"
        f"model_trial.limit_this_process()\n{work}"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], stderr=subprocess.DEVNULL, timeout=60
    )
    assert done.returncode == ending
