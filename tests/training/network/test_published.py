from pathlib import Path

import pytest
import torch

from tactophone import AudioBlock
from tactophone.errors import ModelError
from tactophone.perception import WindowDetector, magnitudes, read_model
from tactophone.training.network.model import PaperNetwork
from tactophone.training.network.published import import_published

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")


@pytest.mark.parametrize(("name", "channels"), [("general", 2), ("fine_tuned", 2), ("piezo_only", 1)])
def test_each_published_variant_predicts_as_before(tmp_path: Path, name: str, channels: int) -> None:
    network = PaperNetwork(channels=channels)
    torch.jit.script(network).save(tmp_path / f"{name}.pt")
    import_published(tmp_path / f"{name}.pt", tmp_path / "imported.onnx")
    model = read_model(tmp_path / "imported.onnx")
    assert model.card.name == f"authors-{name.replace('_', '-')}"
    sound = 0.1 * torch.randn(512, channels).numpy()
    (prediction,) = WindowDetector(model, sample_rate=2000).push(AudioBlock(sound, 2000))
    expected = network(torch.from_numpy(magnitudes(sound)[None])).exp()[0].tolist()
    assert prediction.probabilities == pytest.approx(expected, abs=1e-5)


def notebook(path: Path, **changes: object) -> PaperNetwork:
    """Save what the authors' training notebook saves."""
    network = PaperNetwork()
    state = {**network.state_dict(), "resampler.kernel": torch.zeros(1, 1, 301)}
    held = {"model": state, "RESAMPLE_FACTOR": 24, "PART_SIZE": 512, "contact_threshold": 0.02, "rough_stones": [0, 11]}
    torch.save({**held, **changes}, path)
    return network


def test_the_notebooks_state_is_read_with_its_threshold(tmp_path: Path) -> None:
    network = notebook(tmp_path / "model.pt")
    import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")
    model = read_model(tmp_path / "imported.onnx")
    assert model.card.gate.rule == "mean_absolute"
    assert model.card.gate.threshold_dbfs == pytest.approx(-33.98)
    assert model.card.training["rough_stones"] == [0, 11]
    sound = 0.1 * torch.randn(512, 2).numpy()
    (prediction,) = WindowDetector(model, sample_rate=2000).push(AudioBlock(sound, 2000))
    expected = network(torch.from_numpy(magnitudes(sound)[None])).exp()[0].tolist()
    assert prediction.probabilities == pytest.approx(expected, abs=1e-5)


class Trap:
    """Runs something while a careless reader unpickles it."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (Path("sprung"),)  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rough_stones": Trap()}, "restricted reader refuses it"),
        ({"PART_SIZE": 256}, "windows of 256 samples"),
        ({"model": {"weight": torch.zeros(3)}}, "layer1 takes nothing"),
    ],
)
def test_a_state_of_anything_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, object], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    notebook(tmp_path / "model.pt", **changes)
    with pytest.raises(ModelError, match=message):
        import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")
    assert not (tmp_path / "sprung").exists()
