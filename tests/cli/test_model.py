import json
from pathlib import Path

import pytest

from tactophone.cli import main
from tests.models import write_tiny_model


def test_a_card_is_shown_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_tiny_model(
        tmp_path / "tiny.onnx", scores={"test set": {"balanced accuracy": 0.875}}, licence="BSD-3-Clause"
    )
    assert main(["model", "show", str(path)]) == 0
    shown = capsys.readouterr().out
    for words in ("of kind paper", "256.0 ms; one every 10.67 ms", "-40.0 dBFS", "0.875", "BSD-3-Clause"):
        assert words in shown


def test_a_card_is_shown_to_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx")
    assert main(["model", "show", str(path), "--json"]) == 0
    card = json.loads(capsys.readouterr().out)
    assert (card["kind"], card["sample_rate"], card["hop"]) == ("paper", 2000, "64/3")
    assert card["bytes"] == path.stat().st_size


@pytest.mark.parametrize("content", [b"", b"\x80\x04pickled", b"PK\x03\x04torch", b"\x08\x09truncated"])
def test_what_is_no_model_is_one_line(content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad.onnx"
    path.write_bytes(content)
    assert main(["model", "show", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert str(path) in line
