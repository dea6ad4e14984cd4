import pickle
from pathlib import Path

import onnx
import pytest

from tactophone.core.errors import ModelError
from tactophone.signal.perception.model_file import CARD_KEY, ModelCard, read_model
from tests.models import CARD, write_tiny_model


def test_the_card_survives_the_file(tmp_path: Path) -> None:
    assert read_model(write_tiny_model(tmp_path / "tiny.onnx")).card == CARD


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"gone.onnx: cannot be read"):
        read_model(tmp_path / "gone.onnx")


def test_a_truncated_model_is_refused(tmp_path: Path) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ModelError, match="not a whole ONNX model"):
        read_model(path)


@pytest.mark.parametrize(
    "content", [pickle.dumps({"weights": 1}), b"PK\x03\x04 as torch.save writes"]
)
def test_pickles_are_refused_unopened(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "evil.pt").write_bytes(content)
    with pytest.raises(ModelError, match="import-model"):
        read_model(tmp_path / "evil.pt")


def test_an_onnx_model_of_others_is_refused(tmp_path: Path) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx")
    model = onnx.load(str(path))
    del model.metadata_props[:]
    onnx.save(model, str(path))
    with pytest.raises(ModelError, match="without a Tactophone card"):
        read_model(path)


@pytest.mark.parametrize("version", [1, 3])
def test_another_format_is_refused_and_the_next_step_named(
    tmp_path: Path, version: int
) -> None:
    path = write_tiny_model(tmp_path / "tiny.onnx")
    model = onnx.load(str(path))
    onnx.helper.set_model_props(
        model, {CARD_KEY: CARD.to_json().replace('"format": 2', f'"format": {version}')}
    )
    onnx.save(model, str(path))
    with pytest.raises(
        ModelError, match=rf"format {version}, but .* format 2.*; train the model again"
    ):
        read_model(path)


def test_a_card_written_down_reads_back_equal() -> None:
    assert ModelCard.from_json(CARD.to_json()) == CARD
