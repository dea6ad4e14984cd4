from pathlib import Path

import pytest
import torch

from tactophone import AudioBlock
from tactophone.perception import detector_for, read_model
from tactophone.perception.features.spectrum import magnitudes
from tactophone.training.network.importing import import_published
from tactophone.training.network.model import PaperNetwork

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")


@pytest.mark.parametrize(("name", "channels"), [("general", 2), ("fine_tuned", 2), ("piezo_only", 1)])
def test_each_published_variant_judges_as_it_did(tmp_path: Path, name: str, channels: int) -> None:
    network = PaperNetwork(channels=channels)
    torch.jit.script(network).save(tmp_path / f"{name}.pt")
    import_published(tmp_path / f"{name}.pt", tmp_path / "imported.onnx")
    model = read_model(tmp_path / "imported.onnx")
    assert model.card.name == f"authors-{name.replace('_', '-')}"
    sound = 0.1 * torch.randn(512, channels).numpy()
    (told,) = detector_for(model, sample_rate=2000).push(AudioBlock(sound, 2000))
    wanted = network(torch.from_numpy(magnitudes(sound)[None])).exp()[0].tolist()
    assert told.probabilities == pytest.approx(wanted, abs=1e-5)
