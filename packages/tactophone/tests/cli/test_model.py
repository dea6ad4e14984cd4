import json
from pathlib import Path

import pytest
import torch

from tactophone.cli import main
from tactophone_lab.training.paper_network import PaperNetwork
from tests.models import write_tiny_model


def test_a_card_is_shown_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_tiny_model(
        tmp_path / "tiny.onnx",
        scores={"test set": {"balanced accuracy": 0.875}},
        licence="BSD-3-Clause",
    )
    assert main(["model", "show", str(path)]) == 0
    shown = capsys.readouterr().out
    for words in (
        "of kind paper",
        "256.0 ms; one every 10.67 ms",
        "-40.0 dBFS",
        "0.875",
        "BSD-3-Clause",
    ):
        assert words in shown


def test_tables_of_numbers_are_shown_by_their_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_tiny_model(
        tmp_path / "tiny.onnx", settings={"prior": [[[0.0] * 20] * 2] * 2}
    )
    assert main(["model", "show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "2 x 2 x 20 numbers" in shown
    assert len(shown.splitlines()) < 80


def test_a_card_is_shown_to_programs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx")
    assert main(["model", "show", str(path), "--json"]) == 0
    card = json.loads(capsys.readouterr().out)
    assert (card["kind"], card["sample_rate"], card["hop"]) == ("paper", 2000, "64/3")
    assert card["bytes"] == path.stat().st_size


@pytest.mark.parametrize(
    "content", [b"", b"\x80\x04pickled", b"PK\x03\x04torch", b"\x08\x09truncated"]
)
def test_an_invalid_model_file_is_one_line(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bad.onnx"
    path.write_bytes(content)
    assert main(["model", "show", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert str(path) in line


@pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")
def test_a_published_model_is_converted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    torch.jit.script(PaperNetwork()).save("general.pt")
    assert main(["import-model", "general.pt"]) == 0
    assert capsys.readouterr().out == "general.onnx\n"
    assert main(["model", "show", "general.onnx"]) == 0
    assert "authors-general" in capsys.readouterr().out


def test_an_invalid_published_model_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "general.pt").write_bytes(b"\x80\x04pickled")
    assert main(["import-model", str(tmp_path / "general.pt")]) == 1
    error = capsys.readouterr().err
    assert "a plain pickle, which could run anything; it was not opened" in error
    assert error.count("\n") == 1


def test_a_card_of_endless_words_or_empty_lists_is_shown_on_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endless = {"licence": "B" * 700_000, "scores": {str(n): n for n in range(9_000)}}
    for changes in ({"settings": {"a": [[[]]], "b": []}}, endless):
        path = write_tiny_model(tmp_path / "tiny.onnx", **changes)
        assert main(["model", "show", str(path)]) == 0
        assert len(capsys.readouterr().out) < 100_000
