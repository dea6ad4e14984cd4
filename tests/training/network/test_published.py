from pathlib import Path

import pytest
import torch

from tactophone import AudioBlock
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
